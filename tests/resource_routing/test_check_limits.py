"""Limits of the checks of a route: 1.1 times the accepted violation is refused, 0.9 times is not."""

import numpy as np
import pytest
from check_limits import SCALES, assert_allowed, assert_count, names_of

from crosstrack.models import Resource, ResourceRouting, Route

TOLERANCE = 1e-6
#: Start, two stations, end, and a place off the route.
KINDS = ("start", "station", "station", "end", "place")
ROUTE = Route((0, 1, 2, 3))
#: Use of fuel and time on the arcs of the route, in addition to the rates.
USES = [[0.2, 0.0], [0.0, 0.3], [0.1, 0.0]]
RATE, INITIAL, GAIN, RESET = 2.0, 0.5, 0.1, 0.25
FUEL_LIMITS, TIME_LIMIT = {"station": 4.0, "end": 5.0}, 20.0
#: How the legs are given.
FORMS = ["points", "arcs", "arcs between points", "arcs without uses"]
COUNTS = [
    "starts at the start",
    "ends at the end",
    "neither start nor end between",
    "arcs that there are",
    "no point twice",
]
LIMITS = ["fuel at station", "fuel at end", "time at end"]


def model_for(unit, form="points", legs=(1.0, 1.0, 1.0), begin=0.0, **how):
    """Return a model whose route has these legs, and `begin` of the time used at its start."""
    fuel = Resource(
        "fuel", RATE, INITIAL * unit, {word: limit * unit for word, limit in FUEL_LIMITS.items()},
        {"station": GAIN * unit}, {"station": RESET * unit}, "l",
    )  # fmt: skip
    clock = Resource("time", 1.0, begin * unit, {"end": TIME_LIMIT * unit}, unit="s")
    along = np.concatenate([[0.0], np.cumsum(legs), [0.5]]) * unit
    given = {"resources": (fuel, clock), "points": along[:, None] * [0.6, 0.8]}
    if form != "points":
        given |= {"arcs": [[0, 1], [1, 2], [2, 3]], "uses": np.array(USES) * unit}
    if form == "arcs without uses":
        given["uses"] = None
    if form == "arcs":
        given |= {"points": None, "lengths": np.array(legs) * unit}
    return ResourceRouting(kinds=KINDS, start=0, end=3, **{**given, **how})


def limits(unit, form):
    """Yield the name of each check, its largest accepted violation, and the model for a share of it."""
    own = np.array(USES) if form in ("arcs", "arcs between points") else np.zeros((3, 2))
    for stop, word in enumerate(("station", "station", "end")):
        limit = FUEL_LIMITS[word]
        before = INITIAL if stop == 0 else RESET
        gain = GAIN if word == "station" else 0.0

        def thirsty(x, stop=stop, limit=limit, before=before, gain=gain):
            legs = [1.0, 1.0, 1.0]
            legs[stop] = (limit * (1.0 + x * TOLERANCE) - before - gain - own[stop, 0]) / RATE
            return model_for(unit, form, legs)

        yield f"fuel at {word}", TOLERANCE * limit * unit, thirsty

    def late(x):
        begin = TIME_LIMIT * (1.0 + x * TOLERANCE) - 3.0 - own[:, 1].sum()
        return model_for(unit, form, begin=begin)

    yield "time at end", TOLERANCE * TIME_LIMIT * unit, late


def counts(unit):
    """Yield each exact check, a model, and a route that breaks it."""
    # Without resources, nothing but the order of the points counts.
    for form in ("points", "arcs between points"):
        bare = model_for(unit, form, resources=(), uses=None)
        yield "starts at the start", bare, (1, 2, 3)
        yield "ends at the end", bare, (0, 1, 2)
        yield "ends at the end", bare, (0,)
    yield "arcs that there are", bare, (0, 2, 3)
    free = model_for(unit, resources=(), revisits=True)
    yield "arcs that there are", free, (0, 1, 1, 3)
    yield "neither start nor end between", free, (0, 3, 1, 3)
    yield "neither start nor end between", free, (0, 1, 0, 3)
    yield "no point twice", model_for(unit, resources=()), (0, 1, 2, 1, 3)


@pytest.mark.parametrize("unit", SCALES)
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", LIMITS)
def test_the_limit_of_each_resource(name, form, unit):
    cases = [case for case in limits(unit, form) if case[0] == name]
    assert cases
    for _, allowed, case in cases:
        assert_allowed(name, allowed, lambda x, case=case: case(x).verify(ROUTE))


@pytest.mark.parametrize("unit", SCALES)
@pytest.mark.parametrize("name", COUNTS)
def test_the_smallest_violation_of_each_exact_check(name, unit):
    cases = [case for case in counts(unit) if case[0] == name]
    assert cases
    for _, model, route in cases:
        assert_count(name, lambda bad, m=model, r=route: m.verify(Route(r) if bad else ROUTE))
        assert model.verify(Route(route)).violated[0].where.startswith("point ")
        assert all(check.where == "" for check in model.verify(ROUTE).checks)


def test_a_limit_of_0_has_no_tolerance():
    def found(level):
        drop = Resource("fuel", initial=level, limits={"end": 0.0})
        return model_for(1.0, resources=(drop,)).verify(ROUTE)

    assert found(0.0).ok
    assert [check.name for check in found(1e-300).violated] == ["fuel at end"]


def test_every_check_has_its_limit():
    for form in FORMS:
        found = model_for(1.0, form).verify(ROUTE)
        assert found.ok and names_of(found) == {*COUNTS, *LIMITS}
    found = model_for(1.0, revisits=True).verify(ROUTE)
    assert found.ok and names_of(found) == {*COUNTS, *LIMITS} - {"no point twice"}
