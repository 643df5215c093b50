"""Obstacles that move as known, and the return of the last robot as the objective."""

import dataclasses

import numpy as np
import pytest
from fleet_mission.contacts import moving_contacts
from fleet_mission.missions import flown, legs, small
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import FleetMission, Trajectory
from crosstrack.models.fleet_mission import MissionPlan, MovingObstacle
from crosstrack.models.fleet_mission.curves import nearest

HOME, A, B, C = [1, 1], [8, 8], [8, 2], [2, 8]
CART = MovingObstacle(0.5, [0, 10, 20], [[0, 5], [8, 5], [8, 0]])


def test_an_obstacle_stays_at_its_ends():
    assert CART([-5, 0, 5, 15, 20, 99]).tolist() == [
        [0, 5],
        [0, 5],
        [4, 5],
        [8, 2.5],
        [8, 0],
        [8, 0],
    ]
    long = CART.during(-5.0, 30.0)
    assert (long.times[0], long.times[-1]) == (-5.0, 30.0)
    times = np.linspace(-5, 30, 36)
    assert long(times) == pytest.approx(CART(times))
    for time in (3.0, 1e300):
        standing = MovingObstacle(1.0, [time], [[2.0, 4.0]])
        assert standing.during(0.0, 9.0)([0.0, 9.0]).tolist() == [[2, 4], [2, 4]]


def test_polynomials_and_lines_describe_the_same_motion():
    same = MovingObstacle(0.5, CART.times, coefficients=CART.trajectory.coefficients)
    times = np.linspace(-1, 25, 53)
    assert same(times) == pytest.approx(CART(times))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.5, [0, 1]), "neither"),
        ((0.5, [0, 1], [[0, 0], [1, 1]], np.zeros((1, 2, 2))), "both"),
        ((-1, [0, 1], [[0, 0], [1, 1]]), "radius must be >= 0"),
        ((0.5, [1, 1], [[0, 0], [1, 1]]), "at least 1 strictly increasing"),
        ((0.5, [0, 1], [[0, 0]]), "positions"),
        ((0.5, [], np.zeros((0, 2))), "times"),
        ((0.5, [0, np.nan], [[0, 0], [1, 1]]), "times"),
        ((0.5, [0, 1], np.zeros((2, 4))), "1 to 3 dimensions"),
        ((0.5, [0, 1], np.zeros((2, 0))), "dimensions"),
        ((0.5, [0], None, np.zeros((0, 2, 2))), "at least 2 strictly"),
        ((0.5, [0, 1, 2], None, np.array([[[0.0], [1]], [[2], [0]]])), r"jump of 1 m"),
    ],
)
def test_impossible_motions_are_refused(arguments, message):
    with pytest.raises(InvalidData, match=message):
        MovingObstacle(*arguments)


def test_a_mission_names_the_row_of_a_wrong_obstacle():
    for wrong, message in (
        ([CART, 3], r"moving\[1\] must be a MovingObstacle, got 3"),
        (
            [{"radius": -1, "times": [0], "positions": [[1, 2]]}],
            r"moving\[0\]: radius must be >= 0",
        ),
        ([MovingObstacle(1, [0], [[1, 2, 3]])], r"moving\[0\] must have 2 dimensions, got 3"),
        (CART, "moving must be a list"),
    ):
        with pytest.raises(InvalidData, match=message) as caught:
            small(moving=wrong)
        assert caught.value.field == "moving"


def test_old_data_and_digests_stay():
    model = small()
    # Computed before missions had moving obstacles and an objective of their own.
    assert model.digest.startswith("7de3e83b1825")
    assert "moving" not in model.to_json()
    assert small(moving=[]).digest == small(moving=()).digest == model.digest
    changed = small(moving=[CART], objective="makespan")
    assert changed.digest != model.digest
    again = FleetMission.from_json(changed.to_json())
    assert again.digest == changed.digest
    assert again.moving[0](15).tolist() == [8, 2.5]
    assert changed.describe().endswith("1 obstacle, 1 moving obstacle, makespan")
    assert (changed.objective_unit, model.objective_unit) == ("s", "m")
    # Tables of answers have no unit, as it differs between missions.
    assert not isinstance(FleetMission.objective_unit, str)


def test_the_makespan_is_the_return_of_the_last_robot():
    plan = flown([HOME, (1, B), (0, A), (None, B)], [HOME, (2, C)])
    late = plan.trajectories[1]
    plan = dataclasses.replace(
        plan, trajectories=(plan.trajectories[0], Trajectory(late.times + 80.0, late.coefficients)),
        visits=(plan.visits[0], plan.visits[1] + 80.0),
    )  # fmt: skip
    result = small(objective="makespan").verify(plan)
    assert result.ok
    assert result.objective == pytest.approx(120.0)


def test_a_contact_with_a_moving_obstacle_is_located():
    plan = flown([HOME, (1, B), (0, A), (None, B)], [HOME, (2, C)])
    late = plan.trajectories[1]
    plan = dataclasses.replace(
        plan, trajectories=(plan.trajectories[0], Trajectory(late.times + 80.0, late.coefficients)),
        visits=(plan.visits[0], plan.visits[1] + 80.0),
    )  # fmt: skip
    # The first robot is half-way between (8, 2) and (8, 8) at 30 s.
    crossing = MovingObstacle(0.1, [20, 40], [[3, 5], [13, 5]])
    result = small(moving=[crossing]).verify(plan)
    (broken,) = result.violated
    assert broken.name == "distance to moving obstacles"
    assert broken.worst == pytest.approx(0.35)
    assert "robot 0 and moving obstacle 0 (t = 30 s)" in broken.where
    ((robot, obstacle, distance, _),) = moving_contacts(small(moving=[crossing]), plan)
    assert (robot, obstacle, distance) == (0, 0, pytest.approx(0.0, abs=1e-9))
    # A later motion beyond all rounding does not hide the contact.
    later = MovingObstacle(0.1, [20, 40, 100], [[3, 5], [13, 5], [1e20, 5]])
    assert not small(moving=[later]).verify(plan).ok
    # Before its first time the obstacle stays in the way, too.
    for times in ([90, 99], [1, 2]):
        standing = MovingObstacle(0.1, times, [[8, 5], [8, 5]])
        assert not small(moving=[standing]).verify(plan).ok


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_the_least_distance_in_any_dimension(seed):
    """A lower bound that is proven is at most every sampled distance, and is attained."""
    draw = np.random.default_rng(seed)
    dimensions = int(draw.integers(1, 4))
    curves = [
        Trajectory(np.cumsum(draw.uniform(0.1, 3, 4)), draw.normal(size=(3, 5, dimensions)))
        for _ in range(2)
    ]
    begin, end = max(one.times[0] for one in curves), min(one.times[-1] for one in curves)
    result = nearest(curves, 1e-9)
    if begin >= end:
        assert result.distance == np.inf
        return
    times = np.linspace(begin, end, 20_001)
    sampled = np.linalg.norm(curves[0](times) - curves[1](times), axis=1).min()
    assert result.distance <= sampled + 1e-9
    # Jumps at knots leave both sides as candidates, so the bound is compared with the continuous part.
    steep = max(np.abs(one(times, 1)).max() for one in curves) * np.sqrt(dimensions)
    sides = [entry for one in curves for entry in one.times if begin <= entry <= end]
    at_knots = min(
        (np.linalg.norm(
            curves[0](np.clip(t - 1e-9, begin, end)) - curves[1](np.clip(t - 1e-9, begin, end))
        ) for t in sides),
        default=np.inf,
    )  # fmt: skip
    assert result.distance >= min(sampled, at_knots) - 2 * steep * (end - begin) / 20_000


def test_departures_before_time_0_are_refused_if_the_clock_matters():
    model = small(nodes=[B], vehicles=1)
    plan = MissionPlan(((0,),), (legs([HOME, B, HOME], [-5, 15, 35]),), ([15.0],))
    assert model.verify(plan).ok
    for changes in ({"objective": "makespan"}, {"moving": [MovingObstacle(0.1, [0], [[5, 9]])]}):
        (broken,) = dataclasses.replace(model, **changes).verify(plan).violated
        assert broken.name == "departures at time 0 or later"
        assert (broken.worst, broken.where) == (5.0, "robot 0")


def test_robots_go_around_the_last_place_of_an_obstacle():
    cart = MovingObstacle(0.5, [0, 2], [[5, 4], [5, 2]])
    ahead = cart(cart.times[-1])
    depot, node = np.add(ahead, [[-3, 0], [1.5, 0]])
    model = FleetMission([], (0, -5, 15, 10), [node], depot, 1, 0.5, 0.25, moving=[cart])
    answer = ct.solve(model, seed=0, backend_options={"routing": "kmeans-ac"})
    assert answer.verified, answer
    assert not moving_contacts(model, answer.plan)
    bare = dataclasses.replace(model, moving=())
    shortest = ct.solve(bare, seed=0, backend_options={"routing": "kmeans-ac"})
    assert answer.verification.objective > shortest.verification.objective + 1e-3


@pytest.mark.parametrize(
    "far",
    [MovingObstacle(1, [0, 1], [[1e300, 0], [-1e300, 1]]), MovingObstacle(1e200, [0], [[0, 0]])],
)
def test_an_obstacle_beyond_all_distances_is_refused(far):
    with pytest.raises(InvalidData, match=r"moving\[0\].*1e\+100 m.*got [12]e"):
        small(moving=[far])
