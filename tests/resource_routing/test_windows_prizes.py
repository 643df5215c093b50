"""Windows with waiting, lower limits, prizes, negative lengths and several routes, against enumeration."""

import math
from dataclasses import replace

import numpy as np
import pytest
from resource_draws import neighbours, random_model, rng_of

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.models import Model, Resource, ResourceRouting, Route
from crosstrack.solvers import Request
from crosstrack.solvers.resource_routing import labelling, start
from crosstrack.solvers.resource_routing.elementary import Found, elementary
from crosstrack.solvers.resource_routing.outcomes import STOPPED

NAME = "resource-labelling"
#: Every fourth seed in the fast tests, all in the slow ones.
steps = pytest.mark.parametrize("step", [4, pytest.param(1, marks=pytest.mark.slow)])
ERRAND, NETWORK = "64db977cb4b9fe40", "6101d3ed5fdcb9a5"


def rich_model(seed, **fields):
    """Return a model of whole numbers with windows, lower limits, prizes and negative lengths."""
    draw = np.random.default_rng([36, seed])
    count = int(draw.integers(4, 8))
    kinds = [f"p{k}" for k in range(count)]  # one kind per point: windows of their own
    arcs = [
        [i, j] for i in range(count) for j in range(count) if i != j and draw.random() < 0.75
    ] or [[0, 1]]
    closes = {kind: int(draw.integers(6, 25)) for kind in kinds}
    floors = {kind: int(draw.integers(0, most + 1)) for kind, most in closes.items()}
    time = Resource(
        "time", limits=closes, floors={k: floors[k] for k in kinds if draw.random() < 0.6}
    )
    load = Resource(
        "load",
        limits={kinds[1]: 12} if draw.random() < 0.5 else dict.fromkeys(kinds, 9),
        gains={kind: int(draw.integers(0, 4)) for kind in kinds},
        resets={kinds[2]: 1} if draw.random() < 0.2 else {},
        lower_limits={kinds[1]: int(draw.integers(0, 7))} if draw.random() < 0.4 else {},
    )
    some = [time, load][: int(draw.integers(0, 3))]
    return ResourceRouting(
        kinds, some, 0, 1, arcs=arcs,
        lengths=draw.integers(-3 if draw.random() < 0.3 else 0, 9, len(arcs)),
        uses=draw.integers(0, 6, (len(arcs), len(some))),
        prizes=draw.integers(-2, 12, count) if draw.random() < 0.7 else None, **fields,
    )  # fmt: skip


def simple_routes(model):
    """Return the value of every feasible simple route, by depth-first enumeration without bounds."""
    leads, result = neighbours(model), {}
    prizes = np.zeros(len(model.kinds)) if model.prizes is None else model.prizes

    def extend(route, levels, value):
        if route[-1] == model.end:
            result[route] = value
            return
        for there, leg, uses in leads[route[-1]]:
            if there in route:
                continue
            word, after = model.kinds[there], []
            for resource, level, use in zip(model.resources, levels, uses, strict=True):
                level += resource.rate * leg + use + dict(resource.gains).get(word, 0)
                least = dict(resource.lower_limits).get(word, 0)
                if not least <= level <= dict(resource.limits).get(word, math.inf):
                    break
                level = max(level, dict(resource.floors).get(word, 0))
                after.append(min(level, dict(resource.resets).get(word, math.inf)))
            else:
                extend((*route, there), after, value + leg - prizes[there])

    extend((model.start,), [r.initial for r in model.resources], -prizes[model.start])
    return result


@steps
def test_500_routes_with_windows_and_prizes_are_optimal(step):
    feasible = negative = 0
    for seed in range(0, 500, step):
        model = rich_model(seed)
        routes = simple_routes(model)
        found = ct.solve(model, NAME)
        assert found.termination == ("optimal" if routes else "infeasible"), seed
        if routes:
            least = min(routes.values())
            assert found.primal_bound == pytest.approx(least, abs=1e-9), seed
            assert found.dual_bound == pytest.approx(least, abs=1e-9), seed
            assert routes[found.plan.route] == least, seed
            feasible, negative = feasible + 1, negative + (least < 0)
    assert 250 / step < feasible < 500 / step and negative > 100 / step


@steps
@pytest.mark.parametrize("count", [2, 10])
def test_several_routes_are_the_best_ones(count, step):
    for seed in range(0, 120, step):
        model = rich_model(seed, routes=count)
        routes = simple_routes(model)
        found = ct.solve(model, NAME)
        if not routes:
            assert found.termination == "infeasible"
            continue
        values = [routes[route] for route in (found.plan.route, *found.plan.others)]
        assert values == sorted(routes.values())[:count], seed
        assert model.verify(found.plan).ok
        assert Model.from_json(model.to_json()) == model
        assert model.plan_from_data(model.plan_to_data(found.plan)) == found.plan
        # The other routes may be longer than a warm start.
        again = ct.solve(model, NAME, warm_start=replace(found.plan, others=()))
        assert [routes[route] for route in (again.plan.route, *again.plan.others)] == values


@pytest.mark.parametrize("step", [12, pytest.param(1, marks=pytest.mark.slow)])
def test_any_number_of_routes_with_ties_and_resets_is_exact(step):
    for seed in range(0, 300, step):
        count = 1 + seed % 10
        model = replace(random_model(rng_of(seed), revisits=False), routes=count)
        routes = simple_routes(model)
        found = ct.solve(model, NAME)
        assert found.termination == ("optimal" if routes else "infeasible"), seed
        if routes:
            values = [routes[route] for route in (found.plan.route, *found.plan.others)]
            assert values == sorted(routes.values())[:count], seed


@pytest.mark.parametrize("revisits", [False, True])
def test_several_routes_need_few_points_near_the_straight_line(revisits):
    draw = np.random.default_rng(8)
    points = np.r_[[[0, 50]], draw.uniform(0, 100, (38, 2)), [[100, 50]]]
    fuel = Resource("fuel", rate=1.0, limits={"stop": 60.0}, resets={"stop": 5.0})
    model = ResourceRouting(
        ["stop"] * 40, [fuel], 0, 39, points=points, revisits=revisits, routes=10
    )
    pairs = [[i, j] for i in range(40) for j in range(40) if i != j]
    found, listed = (ct.solve(each, NAME) for each in (model, replace(model, arcs=pairs)))
    assert found.statistics["arcs"] < listed.statistics["arcs"] / 4
    assert found.plan == listed.plan and len(found.plan.others) == 9


def test_ten_walks_with_revisits_are_the_shortest_ones():
    for seed in range(8):
        draw = np.random.default_rng([7, seed])
        arcs = [[i, j] for i in range(6) for j in range(6) if i != j and draw.random() < 0.5]
        time = Resource("time", limits={"stop": 9.0})
        model = ResourceRouting(
            ["stop"] * 6, [time], 0, 5, arcs=arcs or [[0, 5]], routes=10, revisits=True,
            lengths=draw.integers(1, 5, max(len(arcs), 1)), uses=draw.integers(1, 5, (max(len(arcs), 1), 1)),
        )  # fmt: skip
        leads, partial, lengths = neighbours(model), [(0, 0.0, 0.0)], []
        while partial:
            here, length, level = partial.pop()
            for there, leg, (use,) in leads[here]:
                if there == 5 and level + use <= 9:
                    lengths.append(length + leg)
                elif there != 0 and level + use <= 9:
                    partial.append((there, length + leg, level + use))
        found = ct.solve(model, NAME)
        assert found.termination == ("optimal" if lengths else "infeasible"), seed
        if lengths:
            ways = [Route(way) for way in (found.plan.route, *found.plan.others)]
            assert [model.verify(way).objective for way in ways] == sorted(lengths)[:10], seed


@pytest.mark.parametrize(
    ("walks", "expected", "length"),
    [
        ([[0, 3], [0, 1, 2, 1, 3]], [[0, 3]], 1.0),
        ([[0, 1, 2, 1, 3], [0, 2, 3]], [[0, 2, 3]], math.inf),
        ([[0, 1, 2, 1, 3]], [[]], math.inf),
    ],
)
def test_a_stopped_search_keeps_its_simple_routes(walks, expected, length):
    first, *others = map(np.array, walks)
    stopped = Found(STOPPED, first, 1.0, 0.5, 1, 1, others=tuple(others))
    found = elementary(lambda *_: stopped, revisits=False)
    assert [way.tolist() for way in (found.route, *found.others)] == expected
    assert found.length == length and found.bound == 0.5


def test_a_stopped_search_of_several_routes_keeps_the_first_known_route(monkeypatch):
    """It may have found longer routes only."""
    model = bank(routes=2)
    worse = Found(STOPPED, np.array([0, 2, 3]), 3.0, -2.0, 1, 1, others=(np.array([0, 3]),))
    monkeypatch.setattr(labelling, "_under", lambda *_: (worse, 0))
    monkeypatch.setattr(start.Start, "begin", lambda self: self.keep(Route((0, 1, 3))))
    answer = labelling.ResourceLabelling().run(model, Request(time_limit=60))
    assert (answer.termination, answer.primal_bound) == ("feasible", -1.0)
    assert answer.point.route == (0, 1, 3) and len(answer.point.others) == 1


def bank(**fields):
    """Return two ways from 0 to 3: straight, or by a shop that opens at 5 and pays 4."""
    time = Resource(
        "time", rate=1, limits={"shop": 6, "end": 9}, floors={"shop": 5}, lower_limits={"end": 2}
    )
    data = {"points": [[0], [1], [2], [3]], "prizes": [0, 4, 0, 0], **fields}
    return ResourceRouting(["start", "shop", "street", "end"], [time], 0, 3, **data)


def test_waiting_is_in_the_details_of_a_plan():
    model = bank()
    found = ct.solve(model, NAME)
    assert found.plan.route == (0, 1, 3) and found.primal_bound == -1.0
    rows = model.details(found.plan)
    assert [row["time"] for row in rows] == [0, 1, 7]
    assert rows[1]["time after"] == 5


@pytest.mark.parametrize(
    ("route", "others", "check"),
    [
        ((0, 1, 3), ((0, 1, 3),), "different routes"),
        ((0, 3), ((0, 1, 3),), "routes in the order of their lengths"),
        ((0, 1, 3), ((0, 2),), "other routes within all limits"),
        ((0, 1, 3), ((0, 3), (0, 2, 3)), "at most as many routes as asked for"),
    ],
)
def test_wrong_other_routes_are_violations(route, others, check):
    found = bank(routes=2).verify(Route(route, others))
    assert [one.name for one in found.violated] == [check]


def test_a_lower_limit_is_checked():
    late = Resource("time", rate=1, lower_limits={"end": 4})
    model = ResourceRouting(["a", "b", "end"], [late], 0, 2, points=[[0], [5], [3]])
    assert [one.name for one in model.verify(Route((0, 2))).violated] == ["least time at end"]
    found = ct.solve(model, NAME)
    assert found.plan.route == (0, 1, 2) and found.primal_bound == 7.0


@pytest.mark.parametrize(
    ("make", "field", "text"),
    [
        (lambda: Resource("t", limits={"x": 3}, floors={"x": 5}), "floors", "must be <= limits"),
        (lambda: Resource("t", limits={"x": 3}, lower_limits={"x": 4}), "lower_limits", "got 4"),
        (lambda: bank(revisits=True), "revisits", "with prizes or negative lengths"),
        (lambda: bank(prizes=[1, 2]), "prizes", "prizes"),
        (lambda: bank(prizes=[1, 2, math.nan, 0]), "prizes", "finite"),
        (lambda: bank(routes=0), "routes", "must be >= 1"),
        (lambda: Resource("t", floors={"x": -1}), "floors", "must be >= 0"),
        (lambda: bank(arcs=[[0, 3]], lengths=[-1]), "lengths", r"lengths\[0\] must be >= 0"),
    ],
)
def test_bad_windows_and_prizes_are_refused(make, field, text):
    with pytest.raises(InvalidData, match=text) as raised:
        make()
    assert raised.value.field.startswith(field)


def test_default_fields_keep_digests():
    """The digests of two models before the fields were added."""
    model = ct.load("resource-routing/errand")
    assert "prizes" not in model.to_json() and "floors" not in model.to_json()
    assert model.digest.startswith(ERRAND)
    assert ct.load("resource-routing/network-5").digest.startswith(NETWORK)


def test_cycles_of_negative_length_that_use_nothing():
    """Points at one place with prizes: only the number of arcs bounds a walk."""
    model = ResourceRouting(
        ["x"] * 8, [], 0, 7, points=np.zeros((8, 1)), prizes=[0, 1, 2, 3, 4, 5, 6, 0]
    )
    found = ct.solve(model, NAME)
    assert found.termination == "optimal" and found.primal_bound == -21.0


def scaled(model, factor, **fields):
    """Return `model` with lengths and prizes times `factor`, a number or one per arc."""
    prizes = None if model.prizes is None else model.prizes * np.min(factor)
    return ResourceRouting(
        model.kinds, model.resources, 0, 1, arcs=model.arcs, lengths=model.lengths * factor,
        uses=model.uses, prizes=prizes, **fields,
    )  # fmt: skip


@steps
@pytest.mark.parametrize("scale", [1e-7, 1e-3, 1e7])
def test_scaled_prizes(scale, step):
    """The multipliers that exclude negative cycles grow with the number of points, not with lengths."""
    for seed in range(0, 100, step):
        model = scaled(rich_model(seed), scale)
        routes = simple_routes(model)
        found = ct.solve(model, NAME)
        if routes:
            wanted = pytest.approx(min(routes.values()), abs=1e-9 * scale)
            assert (found.primal_bound, found.dual_bound) == (wanted, wanted), seed


@steps
def test_short_arcs_beside_long_ones(step):
    for seed in range(0, 100, step):
        draw, model = np.random.default_rng(seed), rich_model(seed)
        model = scaled(model, np.where(draw.random(len(model.arcs)) < 0.2, 1e6, 1e-3))
        routes = simple_routes(model)
        found = ct.solve(model, NAME)
        if routes:
            assert found.primal_bound == pytest.approx(min(routes.values()), abs=1e-6), seed


@steps
def test_cutting_planes_change_no_optimum_of_tiny_networks(monkeypatch, step):
    """By default the number of arcs alone excludes negative cycles of so few points."""
    monkeypatch.setattr(labelling, "TINY", 0)
    for seed in range(0, 100, step):
        model = rich_model(seed)
        routes = simple_routes(model)
        found = ct.solve(model, NAME)
        assert found.primal_bound == (pytest.approx(min(routes.values())) if routes else None)


@steps
def test_routes_of_equal_lengths_are_ordered_despite_rounding(step):
    """Sums of tenths in two orders differ by rounding."""
    for seed in range(0, 80, step):
        model = scaled(rich_model(seed), 0.1, routes=5)
        found = ct.solve(model, NAME)
        assert found.verified or found.termination == "infeasible", seed


@steps
def test_arc_flow_agrees_with_enumeration(step):
    """The program with windows, prizes, lower limits at the end, and no separate cycles."""
    refused = feasible = 0
    for seed in range(2, 82, step):
        model = rich_model(seed)
        routes = simple_routes(model)
        if model.resources[1:] and model.resources[1].resets and model.lower_limits.any():
            with pytest.raises(UnsupportedFormulation, match="lower limits at the end alone"):
                model.formulate("arc-flow")
            refused += 1
            continue
        formulation = model.formulate("arc-flow")
        found = ct.solve(model, "highs")
        assert found.termination == ("optimal" if routes else "infeasible"), seed
        if routes:
            feasible += 1
            assert found.primal_bound == pytest.approx(min(routes.values()), abs=1e-6), seed
            plan = ct.solve(model, NAME).plan
            point = formulation.encode(plan)
            assert formulation.program.verify(point).ok, seed
            assert formulation.decode(point) == plan
    assert refused > 0 and feasible > 40 / step


def test_arc_flow_refuses_several_routes():
    with pytest.raises(UnsupportedFormulation, match="routes=2"):
        bank(routes=2).formulate("arc-flow")


def test_a_resource_without_resets_takes_one_row():
    model = rich_model(1)
    fuel = Resource("fuel", limits=dict.fromkeys(model.kinds, 30))
    plain = ResourceRouting(
        model.kinds, [fuel], 0, 1, arcs=model.arcs, lengths=abs(model.lengths),
        uses=[[1.0]] * len(model.arcs),
    )  # fmt: skip
    program = plain.formulate("arc-flow").program
    assert program.cost.size == len(plain.formulate("arc-flow").arcs)


def test_diagnosis_names_a_lower_limit():
    model = bank(arcs=[[0, 3]])
    late = Resource("time", rate=1, limits={"end": 9}, lower_limits={"end": 8})
    found = ct.diagnose(
        ResourceRouting(model.kinds, [late], 0, 3, points=model.points, arcs=[[0, 3]])
    )
    assert found.feasible is False
    assert [str(one.text) for one in found.findings] == ["time at least 8 at end (point 3)"]
