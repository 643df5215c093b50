"""The interior point solves feasible problems and proves others infeasible."""

import math
from dataclasses import replace

import numpy as np
import pytest
from minimum_snap.corridors import INF, OURS, agree, solved

import crosstrack as ct
from crosstrack.models import MinimumSnap
from crosstrack.models.minimum_snap import FREE, MinimumDerivative
from crosstrack.models.minimum_snap.trajectory import Trajectory


def flown(seed):
    """Return a model that a known plan keeps, by a margin, and the plan.

    The plan interpolates random derivatives, so nothing but arithmetic says that it is feasible.
    """
    generator = np.random.default_rng(seed)
    r, count = int(generator.integers(1, 5)), int(generator.integers(1, 9))
    axes = int(generator.integers(1, 4))
    long = 10 ** generator.uniform(-0.7, 0.7, count)
    times = np.concatenate([[0], np.cumsum(long)])
    size = generator.choice([0.1, 1, 1, 10])
    points = np.cumsum(generator.normal(size=(count + 1, axes)), axis=0) * size
    points += generator.choice([0, 0, 0, 1e3])
    degree = 2 * r - 1 + int(generator.choice([0, 0, 0, 2]))
    jets = generator.normal(size=(count + 1, r, axes)) * size
    jets[:, 0] = points
    jets[[0, -1], 1:] = 0
    ends = np.array(
        [
            [math.perm(p, j) * float(s or p == j) for p in range(2 * r)]
            for s in (0, 1)
            for j in range(r)
        ]
    )
    powers = []
    for k in range(count):
        scale = (long[k] ** np.arange(r))[:, None]
        powers.append(np.linalg.solve(ends, np.concatenate([jets[k] * scale, jets[k + 1] * scale])))
    plan = Trajectory(times, np.array(powers))
    gone = generator.random((count + 1, axes)) < 0.4
    gone[[0, -1]] = False
    points[gone] = FREE
    margin = 10 ** generator.uniform(-6, -0.5)
    options = {}
    if generator.random() < 0.8:
        found = plan.extremes(0)
        wide = margin * np.maximum(found.largest - found.least, 1e-9 * size)
        kept = generator.random((count, axes)) < 0.7
        if generator.random() < 0.7:
            options["corridor_lower"] = np.where(kept, found.least - wide, -INF)
        if generator.random() < 0.7:
            options["corridor_upper"] = np.where(kept, found.largest + wide, INF)
    for order, name in enumerate(("velocity_limit", "acceleration_limit", "jerk_limit"), start=1):
        if order < 2 * r and generator.random() < 0.4:
            found = plan.extremes(order)
            top = np.maximum(-found.least, found.largest)
            options[name] = (top if generator.random() < 0.5 else top.max()) * (1 + margin)
    return MinimumDerivative(points, times, order=r, degree=degree, **options), plan


# -- what is feasible is never called infeasible --------------------------------------------------------


@pytest.mark.sample(2)
@pytest.mark.parametrize("seed", range(0, 60, 4))
def test_bounds_of_a_known_plan_are_feasible(seed):
    check_flown(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(60, 300))
def test_bounds_of_a_known_plan_are_always_feasible(seed):
    check_flown(seed)


#: Where the warm start after an added instant stalls, although a cold one converges.
@pytest.mark.parametrize("seed", [10, 18, 39, 43, 59, 64, 72, 92, 93, 96])
def test_a_stall_after_added_instants_is_overcome(seed):
    check_flown(seed)


def check_flown(seed):
    model, plan = flown(seed)
    checked = model.verify(plan)
    assert checked.ok, checked
    answer = solved(model)
    assert answer.termination != "infeasible"
    if answer.dual_bound is not None:
        assert answer.dual_bound <= checked.objective * (1 + 1e-6) + 1e-9
    assert answer.termination == "optimal", answer
    assert answer.primal_bound <= checked.objective * (1 + 1e-6) + 1e-9


# -- proofs of infeasibility -----------------------------------------------------------------------------


def refuted(model):
    answer = ct.solve(model, OURS)
    assert answer.termination == "infeasible", answer
    assert answer.plan is None
    words = answer.message.split(" contradict")[0].split("segment")[1].removeprefix("s")
    return {int(word) for word in words.split(",")}


def test_too_slow_for_one_leg():
    model = MinimumSnap([[0.0], [1], [5], [6]], [0, 1, 2, 3], velocity_limit=[[9.0], [3.0], [9.0]])
    assert refuted(model) == {1}
    long = MinimumSnap(
        np.arange(30.0)[:, None], np.arange(30.0),
        velocity_limit=np.where(np.arange(29) == 17, 0.99, 9.0)[:, None],
    )  # fmt: skip
    assert refuted(long) == {17}


def test_boxes_that_do_not_meet():
    for gap in (1.0, 1e-3):
        lower = np.array([[-1.0], [-1], [2 + gap], [2]])
        upper = np.array([[2.0], [2], [6], [6]])
        model = MinimumSnap(
            [[0.0], [None], [None], [None], [5]], np.arange(5.0),
            corridor_lower=lower, corridor_upper=upper,
        )  # fmt: skip
        assert refuted(model) == {1, 2}


def test_boxes_that_touch_in_a_point_do_meet():
    model = MinimumSnap(
        [[0.0], [None], [5]], [0, 1, 2], corridor_lower=[[-1.0], [2]], corridor_upper=[[2.0], [6]]
    )
    agree(model, "piqp")


@pytest.mark.parametrize("legs", [1, 3])
def test_a_stop_that_no_brake_can_do(legs):
    points = np.full((legs + 1, 1), FREE)
    points[[0, -1], 0] = 0, 4
    model = MinimumDerivative(
        points, np.linspace(0, 1, legs + 1), order=2, degree=5, start=[[10.0]], end=[[0.0]],
        acceleration_limit=9.0,
    )  # fmt: skip
    assert refuted(model) <= set(range(legs))


@pytest.mark.parametrize("name", ["velocity_limit", "acceleration_limit"])
def test_a_flight_without_any_freedom(name):
    """One leg from rest to rest has one polynomial: its peaks and hence the outcome are known."""
    peaks = {"velocity_limit": 1.5, "acceleration_limit": 6.0}
    model = MinimumDerivative([[0.0], [1]], [0, 1], order=2)
    kept = replace(model, **{name: peaks[name] * 1.0001})
    assert solved(kept).termination == "optimal"
    assert refuted(replace(model, **{name: peaks[name] * 0.99})) == {0}


@pytest.mark.parametrize("side", ["lower", "upper"])
def test_proofs_with_bounds_on_one_side_only(side):
    """Beside a bound that is infinite: zero times infinity is no violation."""
    points = [[0.0], [None], [None], [0]]
    bound = np.full((3, 1), INF if side == "upper" else -INF)
    bound[1] = -3 if side == "upper" else 3
    model = MinimumSnap(points, [0, 1, 2, 3], velocity_limit=2.0, **{f"corridor_{side}": bound})
    assert refuted(model) <= {0, 1, 2}


def test_a_hair_of_room_is_room():
    """The mean speed is 1: a limit of 1 + 1e-6 is kept, one of 1 - 1e-6 is not."""
    free = {"start": np.zeros((0, 1)), "end": np.zeros((0, 1)), "order": 2, "degree": 5}
    for limit, verdict in ((1 + 1e-6, "optimal"), (1 - 1e-4, "infeasible")):
        model = MinimumDerivative([[0.0], [1], [2]], [0, 1, 2], velocity_limit=limit, **free)
        answer = ct.solve(model, OURS)
        assert answer.termination == verdict, answer
