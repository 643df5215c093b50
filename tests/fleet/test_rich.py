"""Rich fleets: data, exact schedules and verification against enumeration."""

import dataclasses
import math
import pickle

import numpy as np
import pytest
from fleet.rich_oracle import _raw, enumerate_best, reject, schedules
from fleet.rich_random import random_rich, scaled

import crosstrack as ct
from crosstrack.errors import CrosstrackError, InvalidData, UnsupportedFormulation
from crosstrack.instances import entry
from crosstrack.models import FleetRouting, Model
from crosstrack.models.fleet import FleetPlan
from crosstrack.models.fleet.features import FEATURES, features_of
from crosstrack.models.fleet.schedule import earliest_returns, schedule_route

LINE = [[0, 0], [3, 0], [0, 4], [5, 5]]


def timed(**fields):
    return FleetRouting(2, points=LINE, objective="sum", **fields)


def random_plan(rng, model):
    """Return routes that may break every rule, with their exact schedule or a shifted one."""
    free = [x for x in range(model.size) if rng.random() < 0.9 or x in model.customers]
    nodes = [x for x in free if x in model.customers or x in (model.reloads or ())]
    routes = [[] for _ in range(model.vehicles)]
    for node in rng.permutation(nodes):
        if rng.random() < 0.95:
            routes[rng.integers(model.vehicles)].append(int(node))
    plan = model.with_schedule(routes)
    if plan.starts is not None and rng.random() < 0.5:
        moved = [
            tuple(t + float(rng.choice([0.0, 0.0, -1.0, 2.0])) for t in row) for row in plan.starts
        ]
        plan = FleetPlan(plan.routes, tuple(moved))
    return plan


@pytest.mark.parametrize(
    "block", [0, *(pytest.param(block, marks=pytest.mark.slow) for block in (1, 2, 3))]
)
def test_verifies_optima_of_the_enumeration(block):
    feasible = 0
    for seed in range(block * 30, block * 30 + 30):
        model = random_rich(np.random.default_rng(seed))
        value, plan = enumerate_best(model)
        if plan is None:
            continue
        feasible += 1
        assert reject(model, plan) == []
        for candidate in (plan, model.with_schedule(plan.routes)):
            verified = model.verify(candidate)
            assert verified.ok, (seed, str(verified))
            assert verified.objective == pytest.approx(value, abs=1e-9, rel=1e-9)
    assert feasible > 15


@pytest.mark.parametrize("name", ["mixed-6", pytest.param("windows-7", marks=pytest.mark.slow)])
def test_optima_of_the_catalogue_are_those_of_the_enumeration(name):
    model = ct.load(f"fleet/{name}")
    value, plan = enumerate_best(model)
    assert value == pytest.approx(entry(f"fleet/{name}").published["optimum"], rel=1e-12)
    assert reject(model, plan) == []


def test_agrees_with_the_checker_on_random_plans():
    outcomes = []
    for seed in range(300):
        rng = np.random.default_rng(seed)
        model = random_rich(rng)
        plan = random_plan(rng, model)
        faults = reject(model, plan)
        verified = model.verify(plan)
        assert verified.ok == (not faults), (seed, faults, str(verified), plan, model.data())
        outcomes.append(verified.ok)
    assert 30 < sum(outcomes) < 270


def test_schedules_equal_the_enumeration_of_windows():
    counts = [0, 0]
    for seed in range(500):
        rng = np.random.default_rng(seed)
        model = random_rich(rng, {"windows", "releases", "service", "shifts", "max_duration", "reloads",
                                  "ends", "speed", "times", "time_cost", "cost"}, 4)  # fmt: skip
        if not model.has_times:
            continue
        k = int(rng.integers(model.vehicles))
        nodes = [*model.customers.tolist(), *(model.reloads or ())]
        route = rng.permutation(nodes)[: rng.integers(1, 5)].tolist()
        options = list(schedules(model, _raw(model), k, route))
        pieces = earliest_returns(model, k, route)
        counts[bool(options)] += 1
        assert bool(pieces) == bool(options), (seed, route, model.data())
        if not options:
            continue
        back, duration = min(o[0] for o in options), min(o[1] for o in options)
        assert min(p.earliest for p in pieces) == pytest.approx(back, abs=1e-9)
        assert min(p.duration for p in pieces) == pytest.approx(duration, abs=1e-9)
        times = schedule_route(model, k, route)
        if model.time_cost is not None and model.time_cost[k] > 0:
            assert times[-1] - times[0] == pytest.approx(duration, abs=1e-9)
        else:
            assert times[-1] == pytest.approx(back, abs=1e-9)
            least = min(o[1] for o in options if o[0] <= back + 1e-9)
            assert times[-1] - times[0] == pytest.approx(least, abs=1e-9)
    assert min(counts) > 50


def test_schedules_equal_a_search_over_whole_seconds():
    """With whole numbers an optimal schedule is whole, so that a search over whole seconds finds it."""
    feasible = 0
    for seed in range(150):
        rng = np.random.default_rng(seed)
        n, horizon = 4, 90
        times = rng.integers(0, 9, (n, n)) * (1 - np.eye(n, dtype=int))
        windows = [None, *(sorted_windows(rng) for _ in range(n - 1))]
        service, limit = rng.integers(0, 4, n), int(rng.integers(15, 60))
        model = FleetRouting(1, costs=times, objective="makespan", windows=windows, service=service,
                             max_duration=limit)  # fmt: skip
        best = []
        for departure in range(horizon):
            begins, stay = {departure}, 0
            for tail, head in zip([0, 1, 2, 3], [1, 2, 3, 0], strict=True):
                if not begins:
                    break
                first = min(begins) + stay + times[tail, head]
                spans = windows[head] or [(0, horizon)]
                begins = {t for a, b in spans for t in range(max(a, first), b + 1)}
                stay = service[head]
            if begins and min(begins) - departure <= limit:
                best.append((min(begins), -departure))
        pieces = earliest_returns(model, 0, [1, 2, 3])
        assert bool(best) == bool(pieces), seed
        if best:
            feasible += 1
            result = schedule_route(model, 0, [1, 2, 3])
            assert (result[-1], -result[0]) == min(best)
            duration = min(back + departure for back, departure in best)
            assert min(piece.duration for piece in pieces) == duration
    assert 30 < feasible < 150


def sorted_windows(rng):
    cuts = np.sort(rng.choice(60, 4, replace=False)).tolist()
    return [(cuts[0], cuts[1]), (cuts[2], cuts[3])]


def test_a_later_return_can_be_shorter():
    """The earliest return waits from the first window to the second; the least duration starts later."""
    model = timed(windows=[None, [(3, 4), (50, 60)], (58, 60), None])
    route = [1, 2]
    pieces = earliest_returns(model, 0, route)
    assert min(p.earliest for p in pieces) == 62
    assert min(p.duration for p in pieces) == 12
    assert schedule_route(model, 0, route) == (50.0, 53.0, 58.0, 62.0)
    late = timed(windows=[None, [(3, 4), (50, 60)], (20, 60), None])
    assert schedule_route(late, 0, route) == (1.0, 4.0, 20.0, 24.0)
    limited = dataclasses.replace(late, max_duration=15)
    assert schedule_route(limited, 0, route) == (47.0, 50.0, 55.0, 59.0)
    paid = dataclasses.replace(late, objective="cost", time_cost=1)
    assert schedule_route(paid, 0, route) == (47.0, 50.0, 55.0, 59.0)


def test_an_impossible_route_is_scheduled_early_and_named():
    model = timed(windows=[None, (0, 1), None, None], use_all=False)
    plan = model.with_schedule([[1, 2, 3], []])
    assert plan.starts[0][:2] == (0.0, 3.0)
    assert [check.name for check in model.verify(plan).violated] == ["service within a window"]


def test_reads_back_every_feature():
    data = {
        "times": np.ones((6, 6)) - np.eye(6), "speed": 2.0, "service": [0, 1, 1, 1, 1, 0],
        "windows": [None, (0, None), [(1, 2), (4, math.inf)], None, None, [5, 9]], "releases": [0] * 6,
        "demands": np.ones((6, 2)), "capacity": [[3, 4], [5, 6]], "pickups": np.ones((6, 2)),
        "backhauls": True, "pairs": [[1, 2]], "fixed_cost": 1, "distance_cost": 2, "time_cost": [3, 4],
        "shifts": [[0, 10], [5, None]], "max_duration": [7, math.inf], "ends": [-1, 0],
        "requires": [[], ["a"], [], [], [], []], "skills": [["a"], []],
        "prizes": [None, 1, 2, math.nan, 0, None], "groups": [[1, 2]], "reloads": [0],
        "max_reloads": 1, "stations": [5], "battery": 9, "objective": "cost",
    }  # fmt: skip
    points = [[0, 0], [1, 0], [2, 0], [3, 0], [4, 1], [5, 0]]
    model = FleetRouting(2, points=points, **data)
    assert features_of(model) == set(FEATURES) - {"makespan"}
    again = Model.from_json(model.to_json())
    assert again == model
    assert again.data() == model.data()
    assert pickle.loads(pickle.dumps(model)) == model
    assert not model.use_all
    assert model.customers.tolist() == [1, 2, 3, 4]
    for name in data:
        if name not in ("demands", "capacity", "pickups", "battery", "objective"):
            assert name in model.data()
            assert name not in FleetRouting(2, points=points).data()


def test_plans_have_times():
    model = timed(service=[0, 1, 1, 1])
    plan = model.with_schedule([[1], [2, 3]])
    data = model.plan_to_data(plan)
    assert model.plan_from_data(data) == plan
    assert FleetPlan([[1]]).to_data() == {"routes": [[1]]}
    for starts in (None, [[0, 3, 7]], [[0, 3], plan.starts[1]]):
        verified = model.verify(FleetPlan(plan.routes, starts))
        assert [check.name for check in verified.violated] == ["times of each route"]
    slow = dataclasses.replace(model, objective="makespan")
    assert slow.verify(FleetPlan(plan.routes)).objective is None


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"windows": [None, (5, 2), None, None]}, r"windows\[1\] must begin at a finite time and end"),
        ({"windows": [None, (5,), None, None]}, r"windows\[1\] must hold pairs"),
        ({"windows": [None, [], None, None]}, r"windows\[1\] must be None, a pair"),
        ({"windows": [None, ("a", 2), None, None]}, r"windows\[1\] must be a number"),
        ({"windows": [None]}, "windows has 1 entries where points has 4"),
        ({"windows": 3}, "windows must be a list"),
        ({"times": [[0, 1], [1, 0]]}, "times has 2 entries"),
        ({"times": 1 - 2 * np.eye(4)}, r"times\[0, 0\] must be >= 0"),
        ({"times": np.ones((4, 4))}, r"times\[0, 0\] must be 0"),
        ({"times": np.full((4, 4), np.inf)}, r"times\[0, 0\] must be finite"),
        ({"times": 1e308 * (1 - np.eye(4))}, "times must be small enough to add up"),
        ({"speed": 0}, "speed must be > 0, got 0"),
        ({"speed": 1e-320}, "times must be small enough"),
        ({"service": [0, -1, 0, 0]}, r"service\[1\] must be >= 0"),
        ({"releases": [0, np.nan, 0, 0]}, r"releases\[1\] must be finite"),
        ({"shifts": [5, 2]}, r"shifts\[0\] must begin at a finite time and end no earlier"),
        ({"shifts": [1, 2, 3]}, "shifts must have shape"),
        ({"shifts": [np.inf, np.inf]}, r"shifts\[0\] must begin at a finite time"),
        ({"max_duration": -1}, "max_duration must be >= 0"),
        ({"pickups": [0, 1, 1, 1]}, "capacity must be given together with pickups"),
        ({"capacity": [[1, 2], [3, 4]]}, "demands must be given together with capacity"),
        ({"capacity": [[1, 2], [3, 4]], "demands": [1] * 4}, "capacity must have as many dimensions"),
        ({"capacity": [[1, 2], [3, 4]], "demands": np.ones((4, 3))}, "capacity has 2 entries"),
        ({"pairs": [[1, 2]]}, "pairs must be given together with pickups"),
        ({"backhauls": True}, "backhauls must be given together with pickups"),
        ({"backhauls": 1}, "backhauls must be true or false"),
        ({"pairs": [[1, 0]], "pickups": [1] * 4, "capacity": 9}, r"pairs\[0\] must name nodes to visit"),
        ({"pairs": [[1, 1]], "pickups": [1] * 4, "capacity": 9}, r"pairs\[0\] must name each node once"),
        ({"pairs": [[1, 9]], "pickups": [1] * 4, "capacity": 9}, "pairs must be nodes 0 … 3, got 9"),
        ({"fixed_cost": 1}, "fixed_cost must not be given unless the objective is 'cost'"),
        ({"prizes": [1, 1, 1, 1]}, "prizes must not be given unless"),
        ({"objective": "cost", "prizes": [1, 1, -1, 1]}, r"prizes\[2\] must be >= 0"),
        ({"objective": "cost", "prizes": [1, 1, np.inf, 1]}, r"prizes\[2\] must be finite"),
        ({"objective": "cost", "prizes": [1, 1, True, 1]}, r"prizes\[2\] must be a number"),
        ({"objective": "cost", "prizes": [1, 1, None, 2], "groups": [[1, 2]]}, r"groups\[0\] must hold"),
        ({"groups": [[1, 2], [2, 3]]}, r"groups\[1\] must name each node once"),
        ({"groups": [[]]}, r"groups\[0\] must not be empty"),
        ({"groups": [[4]]}, r"groups\[0\] must name nodes to visit"),
        ({"ends": 4}, "ends must be nodes 0 … 3, got 4"),
        ({"ends": -2}, "ends must be >= -1"),
        ({"requires": [[], ["a"], [], []]}, "requires must be given together with skills"),
        ({"requires": [[], "a", [], []], "skills": [[], []]}, r"requires\[1\] must be a list"),
        ({"skills": [["a"]]}, "skills has 1 entries"),
        ({"releases": [0, 0, 0, 1e13]}, "releases must be at most 1e\\+12 s, got 1e\\+13"),
        ({"reloads": [0, 0]}, r"reloads must name each node once, got \[0, 0\]"),
        ({"stations": [3, 3], "battery": 9}, "stations must name each node once"),
        ({"reloads": [7]}, "reloads must be nodes 0 … 3, got 7"),
        ({"max_reloads": 1}, "max_reloads must be given together with reloads"),
        ({"stations": [3]}, "stations must be given together with battery"),
        ({"reloads": [1, 2, 3]}, "there must be a node to visit beside the depot"),
        ({"use_all": 1}, "use_all must be true or false"),
    ],
)  # fmt: skip
def test_bad_data(data, message):
    with pytest.raises(InvalidData, match=message) as caught:
        FleetRouting(2, points=LINE, **data)
    assert caught.value.field


@pytest.mark.parametrize("origin", [-1.7e9, 0.0, 1.7e9])
def test_tolerances_do_not_depend_on_the_origin_of_the_times(origin):
    """With times since 1970, a relative tolerance of 1e-6 would be half an hour."""
    model = timed(
        windows=[None, (origin, origin + 10), None, None], releases=[origin - 3] * 4,
        shifts=[origin - 3, origin + 60],
    )  # fmt: skip
    plan = model.with_schedule([[1, 2, 3], []])
    assert model.verify(plan).ok
    for place, moved, name in (
        (1, 20.0, "service within a window"),
        (2, -1.0, "travel and service take their time"),
        (4, 70.0, "route within shift"),
        (0, -1.0, "route within shift"),
    ):
        times = [time + moved * (k >= place or place == 0) for k, time in enumerate(plan.starts[0])]
        verified = model.verify(FleetPlan(plan.routes, [times, []]))
        assert name in [check.name for check in verified.violated]


def test_a_window_that_is_missed_far_from_time_zero_is_not_used():
    """The first window ends 3e-12 of the time before the arrival, so that the service waits for the second."""
    origin = 1e8
    spans = [(origin, origin + 3 - 3e-4), (origin + 10, origin + 20)]
    model = timed(windows=[None, spans, None, None], shifts=[origin, origin + 60])
    plan = model.with_schedule([[1, 2, 3], []])
    assert plan.starts[0][1] == origin + 10
    assert model.verify(plan).ok


def test_one_infinite_number_applies_to_all_vehicles():
    assert timed(max_duration=math.inf).max_duration.tolist() == [math.inf] * 2
    with pytest.raises(InvalidData, match="max_duration must be finite"):
        timed(max_duration=-math.inf)
    with pytest.raises(InvalidData, match="time_cost must be finite"):
        FleetRouting(2, points=LINE, objective="cost", time_cost=math.inf)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e7])
def test_scales_do_not_change_the_result(scale):
    for seed in range(40):
        model = random_rich(
            np.random.default_rng(seed), {"windows", "service", "releases", "shifts"}
        )
        other = scaled(model, scale)
        plan = random_plan(np.random.default_rng(seed + 1), model)
        moved = other.with_schedule(plan.routes)
        assert other.verify(moved).ok == model.verify(model.with_schedule(plan.routes)).ok
        for row, same in zip(
            moved.starts or (), model.with_schedule(plan.routes).starts or (), strict=True
        ):
            assert row == pytest.approx([scale * t for t in same], rel=1e-9, abs=1e-9 * scale)


def test_zero_capacity_and_asymmetric_times():
    empty = timed(demands=[0, 0, 1, 0], capacity=0, windows=[None, (0, 9), None, None])
    verified = empty.verify(empty.with_schedule([[1, 2], [3]]))
    assert [check.name for check in verified.violated] == ["load within capacity"]
    times = [[0, 1, 9, 9], [9, 0, 1, 9], [9, 9, 0, 1], [1, 9, 9, 0]]
    model = FleetRouting(1, points=LINE, times=times, objective="makespan")
    assert model.verify(model.with_schedule([[1, 2, 3]])).objective == 4
    assert model.verify(model.with_schedule([[3, 2, 1]])).objective == 36


def test_backends_name_the_features_that_they_lack():
    model = timed(
        windows=[None, (0, 9), None, None], requires=[[], ["a"], [], []], skills=[["a"], []]
    )
    for name in ("fleet-search", "tpha"):
        with pytest.raises(UnsupportedFormulation, match="windows, requires, skills"):
            ct.solve(model, name)
    for name in ("two-index", "three-index"):
        with pytest.raises(UnsupportedFormulation, match="not cover windows, requires, skills"):
            model.formulate(name)


def test_every_error_is_a_crosstrack_error():
    """Random garbage in every field ends in an error of the package, or in a model."""
    rng = np.random.default_rng(5)
    garbage = [None, 0, -1, 1e300, math.nan, math.inf, "x", [], [[]], [None] * 4, {}, True, [1, 2],
               [[0, 0]] * 4, np.zeros((4, 4)), [[1, 2], [3, 4]], b"a", np.array("x"), 1j]  # fmt: skip
    names = [name for name in FEATURES if name not in ("dimensions", "cost", "makespan")]
    for name in names:
        for value in garbage:
            try:
                model = FleetRouting(2, points=LINE, objective="cost", **{name: value})
            except CrosstrackError:
                continue
            plan = random_plan(rng, model)
            model.verify(plan)
            assert Model.from_json(model.to_json()) == model
