"""Fronts of two objectives: the whole Pareto set, limits, proven and dominated points."""

import itertools
import math

import numpy as np
import pytest
from fronts import (
    MODEL,
    PLACES,
    POINTS,
    Given,
    all_loads,
    matrix,
    measured,
    pareto_set,
    values,
)
from listening import solutions

import crosstrack as ct
from crosstrack.errors import (
    InvalidData,
    UnknownName,
    UnsupportedFormulation,
    UnsupportedOption,
)
from crosstrack.models import FleetRouting
from crosstrack.solvers import FrontPoint

KINDS = ("plane", "ties", "nothing", "places", "far", "line")


@pytest.mark.sample(2)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("objective", "second", "q"),
    [
        ("sum", "max", 0.0),
        ("max", "sum", 0.0),
        ("max-sum", "sum", 0.0),
        ("sum-deviation", "max", 0.7),
    ],
)
def test_the_front_is_the_whole_pareto_set(kind, objective, second, q):
    for seed, vehicles in ((1, 2), (2, 3), (3, 2)):
        costs = matrix(kind, seed)
        model = FleetRouting(vehicles, costs=costs, objective=objective, q=q)
        found = ct.front(model, second, backend="subset-dp", step=1e-9, points=500)
        loads = all_loads(costs, vehicles)
        wanted = pareto_set(measured(objective, loads, q), measured(second, loads))
        assert values(found) == [pytest.approx(pair, rel=1e-8) for pair in wanted]
        assert all(point.proven for point in found.points)
        for point in (*found.points, *found.dominated, *found.repeated):
            assert ct.verify(model, point.solution.plan).ok
        assert [one.termination for one in found.unsolved] in ([], ["infeasible"])


@pytest.mark.parametrize(
    ("objective", "second"),
    [("sum", "max"), ("sum", "deviation"), ("sum", "range"), ("range", "sum"), ("max", "range")],
)
def test_balance_by_branch_and_bound(objective, second):
    """Detours may pay: what hands out shortest tours is no answer here."""
    costs = np.rint(matrix("plane", 4)[:5, :5])
    model = FleetRouting(2, costs=costs, objective=objective)
    loads = all_loads(costs, 2)
    wanted = pareto_set(measured(objective, loads), measured(second, loads))
    # All are farther apart than the steps.
    whole = wanted[0][1]
    assert all(a[1] - b[1] > 2e-3 * whole for a, b in itertools.pairwise(wanted))
    found = ct.front(model, second, backend="highs", step=1e-3, points=100)
    assert values(found) == [pytest.approx(pair, rel=1e-6, abs=1e-6) for pair in wanted]
    assert all(point.proven for point in found.points)


def test_two_exact_backends_have_one_front():
    # Three indices, for two do not know how long a route is.
    by = {
        name: ct.front(MODEL, "max", backend=name, step=1e-3, points=50, formulation=formulation)
        for name, formulation in (("subset-dp", None), ("highs", "three-index"))
    }
    for found in by.values():
        assert values(found) == [pytest.approx(pair, rel=1e-5) for pair in POINTS]
        assert {point.proven for point in found.points} == {True}
        assert found.field == "battery"
    assert {s.backend for s in by["highs"].solutions} == {"highs"}


def test_points_and_step_bound_the_runs():
    ran = []
    found = ct.front(MODEL, "max", points=2, step=1e-6, on_event=solutions(ran.append))
    assert len(ran) == 2
    assert values(found) == [
        pytest.approx(POINTS[0], rel=1e-5),
        pytest.approx((34.9244, 20.7823), rel=1e-5),
    ]
    # A wide step misses what lies within it.
    wide = ct.front(MODEL, "max", step=0.5, points=50)
    assert values(wide) == [pytest.approx(pair, rel=1e-5) for pair in POINTS[::2]]


def test_one_vehicle_has_one_point():
    """Zero deviation cannot be less."""
    ran = []
    found = ct.front(
        FleetRouting(1, points=PLACES, objective="sum"), "deviation", on_event=solutions(ran.append)
    )
    assert [second for _, second in values(found)] == [0.0]
    assert len(ran) == 1


# -- limits --------------------------------------------------------------------------------------


def test_given_limits_are_used():
    """Unsorted and twice, as whole numbers and of NumPy: each is run once, from large to small."""
    ran = []
    found = ct.front(
        MODEL,
        "max",
        limits=np.array([18, 30, 20, 18, 1]),
        on_event=solutions(lambda s: ran.append(s.instance)),
    )
    assert ran == [f"six, max <= {limit}" for limit in (30, 20, 18, 1)]
    assert values(found) == [pytest.approx(pair, rel=1e-5) for pair in POINTS]
    assert [point.limit for point in found.points] == [30.0, 20.0, 18.0]
    assert [one.instance for one in found.unsolved] == ["six, max <= 1"]
    assert "six, max <= 1: infeasible" in str(found)
    # A generator is a list too; both limits allow the same plan, which is shown once.
    twice = ct.front(MODEL, "max", limits=(x for x in (25, 30)))
    assert (len(twice.points), len(twice.repeated), len(twice.dominated)) == (1, 1, 0)
    assert "repeated" in twice.summary()


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ([1.0, math.nan], "limits[1] must be finite"),
        ([math.inf], "limits[0] must be finite"),
        ([-1.0], "limits[0] must be >= 0"),
        (["20"], "limits[0] must be a number"),
        ([None], "limits[0] must be a number"),
        ([[20.0]], "limits[0] must be a number"),
        ([True], "limits[0] must be a number"),
        ("20,30", "limits must be a list"),
        ({20.0: 1}, "limits must be a list"),
        (20.0, "limits must be a list"),
        ([], "limits must hold 1"),
        (np.ones(10_001), "limits must hold 1"),
    ],
)
def test_invalid_limits_are_rejected(limits, words, tmp_path):
    record = tmp_path / "record.jsonl"
    with pytest.raises(InvalidData) as error:
        ct.front(MODEL, "max", limits=limits, record=record)
    assert words in str(error.value)
    assert not record.exists()


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"points": 0}, InvalidData, "points"),
        ({"points": 2.5}, InvalidData, "points"),
        ({"step": 0.0}, InvalidData, "step"),
        ({"step": 1.5}, InvalidData, "step"),
        ({"step": math.nan}, InvalidData, "step"),
        ({"resume": True}, UnsupportedOption, "record"),
        ({"isolate": "no"}, InvalidData, "isolate"),
        ({"backend": "subset-pd"}, UnknownName, "did you mean 'subset-dp'"),
        ({"backend": "subset-dp", "backend_options": {"x": 1}}, UnsupportedOption, "'x'"),
        ({"backend": "subset-dp", "seed": -1}, UnsupportedOption, "seed"),
        ({"time_limit": -1.0}, UnsupportedOption, "time_limit"),
        # The two-index formulation cannot limit the longest route, which raises before the first run.
        ({"backend": "highs", "formulation": "two-index"}, UnsupportedFormulation, "two-index"),
    ],
)
def test_a_rejected_call_runs_nothing(options, error, words, tmp_path):
    ran = []
    record = {} if "resume" in options else {"record": tmp_path / "record.jsonl"}
    with pytest.raises(error) as raised:
        ct.front(MODEL, "max", on_event=solutions(ran.append), **record, **options)
    assert words in str(raised.value)
    assert ran == []
    assert not any(tmp_path.iterdir())


def test_an_unsupported_limit_raises_first():
    ran = []
    with pytest.raises(UnsupportedFormulation, match="detour"):
        ct.front(MODEL, "deviation", backend="subset-dp", on_event=solutions(ran.append))
    assert ran == []


def test_names_of_second_objectives():
    for name in ("maximum", "", None, ["max"]):
        with pytest.raises(UnknownName, match="second objective of model 'fleet-routing'"):
            ct.front(MODEL, name)
    with pytest.raises(UnknownName, match="did you mean 'deviation'"):
        ct.front(MODEL, "deviaton")
    with pytest.raises(InvalidData, match="model must be a Model"):
        ct.front("fleet/example", "max")
    path = ct.load("grid-path/maze")
    with pytest.raises(UnsupportedFormulation, match="declares no second objective"):
        ct.front(path, "max")


def test_limits_of_the_model_stay():
    """The second vehicle's battery is less than every limit, the first one's is more."""
    battery = np.array([100.0, 12.0])
    model = FleetRouting(2, points=PLACES, objective="sum", battery=battery)
    loads = all_loads(model.distances.tolist(), 2)
    loads = loads[loads[:, 1] <= 12.0]
    wanted = pareto_set(measured("sum", loads), measured("max", loads))
    found = ct.front(model, "max", step=1e-6, points=100)
    assert values(found) == [pytest.approx(pair, rel=1e-9) for pair in wanted]
    tighter = model.limited("max", 20.0)
    np.testing.assert_array_equal(tighter.battery, [20.0, 12.0])
    np.testing.assert_array_equal(model.battery, battery)
    np.testing.assert_array_equal(tighter.limited("max", 50.0).battery, [20.0, 12.0])
    assert model.limited("sum", 40.0).limited("sum", 50.0).budget == 40.0


# -- what is proven, and what is dominated -------------------------------------------------------


def test_heuristic_points_are_not_proven():
    found = ct.front(MODEL, "max", backend="fleet-search", limits=[30, 20], time_limit=0.3, seed=1)
    assert len(found.points) == 2
    assert not any(point.proven for point in found.points)
    assert "proven" not in str(found)


def test_a_plan_without_a_bound_is_not_proven():
    plan = ct.front(MODEL, "max", limits=[30]).points[0].solution.plan.routes
    assert not ct.front(MODEL, "max", backend=Given(plan), limits=[30]).points[0].proven


def test_a_requested_gap_proves():
    """Within the gap, as the gap is part of what was asked."""
    found = ct.front(MODEL, "max", backend="highs", limits=[20], gap=0.5)
    (point,) = found.points
    assert point.proven == (point.solution.termination == "optimal")
    assert point.proven


def test_dominated_plans_are_removed_and_shown():
    good, worse, bad = (((2, 1, 3), (4, 5)), ((1, 2, 3), (4, 5)), ((1, 3, 2), (5, 4)))
    found = ct.front(MODEL, "max", backend=Given(worse, good, bad), limits=[300, 200, 100])
    (best,) = found.points
    assert best.solution.plan.routes == good
    assert len(found.dominated) == 2
    assert all(best.dominates(one) and not one.dominates(best) for one in found.dominated)
    assert "dominated" in found.summary()
    assert [d["limit"] for d in found.to_dict()["dominated"]] == [p.limit for p in found.dominated]


def pair(objective, second):
    return FrontPoint(objective, second, None, None, False)


@pytest.mark.parametrize(
    ("one", "other", "dominates", "equals"),
    [
        ((1, 2), (1, 3), True, False),
        ((1, 2), (2, 2), True, False),
        ((1, 2), (1, 2), False, True),
        ((1, 3), (2, 2), False, False),
        ((0, 0), (0, 0), False, True),
        ((0, 0), (1e-300, 0), True, False),
        ((1 + 1e-12, 2), (1, 3), True, False),
        ((1 + 1e-12, 2), (1, 2), False, True),
        ((1e6, 1e-6), (1e6, 2e-6), True, False),
    ],
)
def test_dominance(one, other, dominates, equals):
    one, other = pair(*one), pair(*other)
    assert one.dominates(other) is dominates
    assert one.equals(other) is other.equals(one) is equals
    assert not other.dominates(one) or not dominates
