"""Routes with resources: bad input, JSON, sums of a walk, figures, diagnosis, instances."""

import math

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances.resource_routing import generate_electric, generate_network
from crosstrack.models import Model, Resource, ResourceRouting, Route

PLACES = [[0, 0], [3, 1], [4, 0], [2, -2]]


def drive(**fields):
    fuel = Resource(
        "fuel", 1.0, limits={"station": 3.5, "end": 3.5}, resets={"station": 0}, unit="km"
    )
    data = {
        "kinds": ("start", "station", "end", "station"), "resources": (fuel,), "start": 0, "end": 2,
        "points": PLACES,
    }  # fmt: skip
    return ResourceRouting(**{**data, **fields})


def test_a_walk_adds_rates_uses_and_gains():
    one = Resource("a", 2.0, 0.5, limits={"end": 20}, gains={"mid": 1}, resets={"mid": 4}, unit="l")
    model = ResourceRouting(
        ("start", "mid", "end"), (one, Resource("b")), 0, 2,
        arcs=[[0, 1], [1, 2]], lengths=[3, 1], uses=[[0.25, 7], [0, 1]],
    )  # fmt: skip
    rows = model.details(Route((0, 1, 2)))
    assert [row["a (l)"] for row in rows] == [0.5, 0.5 + 6 + 0.25 + 1, 4 + 2]
    assert [row["a after"] for row in rows] == [0.5, 4, 6]
    assert [row["b"] for row in rows] == [0, 7, 8]
    assert rows[2]["limit of a"] == 20 and rows[1]["limit of a"] is None
    found = model.verify(Route((0, 1, 2)))
    assert found.ok and found.objective == 4
    assert model.verify(Route((0, 2))).objective is None  # missing arc
    assert Model.from_json(model.to_json()) == model


@pytest.mark.parametrize(
    ("route", "check"),
    [
        ([1, 2], "starts at the start"), ([0, 1], "ends at the end"), ([], "starts at the start"),
        ([0, 2, 1, 2], "neither start nor end between"), ([0, 1, 3, 1, 2], "no point twice"),
        ([0, 2], "fuel at end"), ([0, 1, 1, 2], "arcs that there are"),
    ],
)  # fmt: skip
def test_each_rule_is_checked(route, check):
    found = drive().verify(Route(tuple(route)))
    assert not found.ok
    assert check in [one.name for one in found.violated]


@pytest.mark.parametrize(
    ("fields", "field", "text"),
    [
        ({"end": 0}, "end", "must differ from start"),
        ({"start": 4}, "start", "must be < 4"),
        ({"points": None}, "points", "give points, or arcs and lengths"),
        ({"lengths": [1.0]}, "lengths", "goes with arcs"),
        ({"arcs": [[0, 4]]}, "arcs", r"arcs\[0, 1\] must be < 4"),
        ({"arcs": [[0, 1], [0, 1]]}, "arcs", "is there twice"),
        ({"arcs": [[1, 1]]}, "arcs", "to itself"),
        ({"arcs": [[0, 1]], "lengths": [-1.0]}, "lengths", ">= 0"),
        ({"arcs": [[0, 1]], "uses": [[1.0, 2.0]]}, "uses", "2 columns, but there are 1 resources"),
        ({"kinds": ("start", 3, "end", "x")}, "kinds", r"kinds\[1\] must be a word"),
        ({"resources": (Resource("a"), Resource("a"))}, "resources", r"resources\[1\].name is 'a'"),
        (
            {"resources": (Resource("a", limits={"statoin": 1}),)}, "resources",
            "no point is of kind 'statoin'; kinds: start, station, end",
        ),
    ],
)  # fmt: skip
def test_bad_input_names_field_and_value(fields, field, text):
    with pytest.raises(InvalidData, match=text) as raised:
        drive(**fields)
    assert raised.value.field == field


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"rate": -1}, "rate must be >= 0"),
        ({"limits": {"end": math.nan}}, r"limits\['end'\] must be finite"),
        ({"resets": [1]}, "resets must be an object of numbers by kind of point"),
    ],
)
def test_bad_resources(fields, text):
    with pytest.raises(InvalidData, match=text):
        Resource("a", **fields)


def test_diagnosis_names_conflicting_limits():
    found = ct.diagnose(ct.load("resource-routing/no-way"))
    assert found.feasible is False
    assert [one.data["resource"] for one in found.findings] == ["time"]
    assert ct.diagnose(drive()).feasible is True
    torn = drive(arcs=[[0, 1], [1, 3]])
    assert "no way of arcs" in ct.diagnose(torn).summary


def test_generators_draw_the_same_and_refuse():
    assert generate_electric(9, 4) == generate_electric(9, 4)
    assert generate_electric(9, 4) != generate_electric(9, 5)
    assert generate_electric(0, 1).words == ("start", "end")
    network = generate_network(4, 2)
    assert len(network.arcs) == 48 and (network.lengths >= 1).all()
    for bad in (lambda: generate_electric(-1, 1), lambda: generate_network(1, 1)):
        with pytest.raises(InvalidData):
            bad()


@pytest.mark.parametrize(
    ("model", "route", "axes"),
    [
        (drive(), None, 1), (drive(), [0, 1, 2], 2), (drive(), [0, 2], 2), (drive(), [0], 1),
        (drive(points=None, arcs=[[0, 1], [1, 2]], lengths=[3.0, 1.5]), [0, 1, 2], 1),
        (drive(points=None, arcs=[[0, 1], [1, 2]], lengths=[3.0, 1.5]), None, 1),
        (drive(points=[[0], [3], [4], [2]], resources=()), [0, 2], 1),
        (drive(points=np.c_[PLACES, [0, 1, 2, 3]]), [0, 1, 2], 2),
    ],
)  # fmt: skip
def test_pictures(model, route, axes):
    figure = ct.plot(model, route)
    assert len(figure.get_axes()) == axes
    figure.canvas.draw()


@pytest.mark.parametrize("rate", [1e-9, 1e-3, 1.0, 1e3])
@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_resource_of_any_rate_is_used_up(rate, share):
    """A check without rates up to 1e-3 passed all tests."""
    limit = 5.0 * rate
    model = ResourceRouting(
        ("start", "end"), (Resource("charge", rate, limits={"end": limit}),), 0, 1,
        points=[[0.0, 0.0], [5.0 * share, 0.0]],
    )  # fmt: skip
    assert model.verify(Route((0, 1))).ok == (share < 1)


def test_no_text_imitates_an_omitted_field_in_a_digest():
    def digest(**fields):
        fuel = Resource("fuel", 1.0, limits={"a": 3}, **fields)
        return ResourceRouting(["a", "a"], [fuel], 0, 1, points=[[0, 0], [1, 0]]).digest

    forged = "'\0floors\0(('a', 1.0),)"
    digests = {
        digest(),
        digest(floors={"a": 1}),
        digest(lower_limits={"a": 1}),
        digest(unit=forged),
    }
    assert len(digests) == 4
