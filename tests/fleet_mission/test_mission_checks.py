"""Check of a mission: violations that it must report, and plans that it must accept."""

import json
from dataclasses import replace

import numpy as np
import pytest
from fleet_mission.missions import SQUARE, delayed, flown, legs, plain, small
from hypothesis import given, settings, strategies as st
from scipy.integrate import quad

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import FleetMission, Trajectory
from crosstrack.models.fleet_mission import MissionPlan, lengths_of


def violated(model, plan, **options):
    return {check.name: check for check in model.verify(plan, **options).violated}


def changed(plan, robot, **changes):
    """Return `plan` with another curve of one robot."""
    curves = list(plan.trajectories)
    curves[robot] = replace(curves[robot], **changes)
    return replace(plan, trajectories=tuple(curves))


def test_a_good_plan_passes_and_its_objective_is_that_of_its_lengths():
    model = small()
    plan = plain(model)
    found = model.verify(plan)
    assert found.ok, found
    first = np.hypot(7, 1) + 6 + 6 + np.hypot(7, 1)
    second = 2 * np.hypot(1, 7)
    loads = [first, second]
    assert found.objective == pytest.approx(sum(loads) + 0.4 * np.std(loads, ddof=1), rel=1e-12)
    stored = json.loads(json.dumps(model.plan_to_data(plan), allow_nan=False))
    again = model.plan_from_data(stored)
    assert again.to_data() == stored
    assert model.verify(again).to_dict() == found.to_dict()


@pytest.mark.parametrize(
    ("objective", "value"),
    [("sum", lambda loads: loads.sum()), ("max", max), ("range", np.ptp)],
)
def test_each_objective(objective, value):
    model = small(objective=objective)
    loads = np.array([12 + 2 * np.hypot(7, 1), 2 * np.hypot(1, 7)])
    assert model.verify(plain(model)).objective == pytest.approx(value(loads), rel=1e-12)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_lengths_are_those_of_adaptive_quadrature(seed):
    draw = np.random.default_rng(seed)
    one = Trajectory(np.cumsum(draw.uniform(0.1, 9, 3)), draw.normal(size=(2, 5, 2)))
    for k, length in enumerate(lengths_of(one)):
        wanted = quad(
            lambda t: np.hypot(*one(t, 1)), *one.times[k : k + 2], limit=400, epsabs=1e-11
        )[0]
        assert length == pytest.approx(wanted, rel=1e-8)


def test_a_cusp_costs_no_digits():
    one = Trajectory([0.0, 2.0], [[[0.0, 0], [-1, 0], [1, 0]]])  # back and forth: t² - t
    assert lengths_of(one).sum() == pytest.approx(0.5, rel=1e-10)


def test_a_thin_wall_between_samples():
    wall = [[5, 3], [5 + 1e-4, 3], [5 + 1e-4, 7], [5, 7]]
    model = small(obstacles=[wall], nodes=[[9, 5]], depot=(1, 5), vehicles=1, radius=0.0)
    plan = flown([[1, 5], (0, [9, 5])])
    assert violated(model, plan)["radius away from obstacles"].worst == pytest.approx(5e-5, rel=0.1)
    around = flown([[1, 5], (None, [5, 7.5]), (0, [9, 5]), (None, [5, 7.5])])
    assert model.verify(around).ok


def test_contact_is_no_collision_and_a_little_more_is():
    model = small(nodes=[[8, 3.75]], depot=(1, 3.75), vehicles=1, bounds=(0, -0.25, 10, 9.75))
    along = [[1, 3.75], (0, [8, 3.75])]
    assert model.verify(flown(along)).ok
    off = 3e-6
    beyond = flown([[1, 3.75], (None, [3, 3.75 + off]), (None, [7, 3.75 + off]), (0, [8, 3.75])])
    found = violated(model, beyond)["radius away from obstacles"]
    assert found.worst == pytest.approx(off, rel=1e-3)
    assert model.verify(beyond, tolerance=1e-5).ok


def test_a_bend_into_an_obstacle_between_its_ends():
    """The curve's knots lie well apart from the obstacle, which only its middle enters."""
    model = small(nodes=[[8, 3]], depot=(2, 3), vehicles=1)
    there = np.zeros((1, 9, 2))
    there[0, :8] = legs([[2, 3], [8, 3]], [0, 20]).coefficients[0]
    bump = np.polynomial.polynomial.polypow([0, 1], 4)
    bump = np.polynomial.polynomial.polymul(bump, np.polynomial.polynomial.polypow([1, -1], 4))
    for height, fine in ((0.74, True), (0.76, False), (2.0, False)):
        high = there.copy()
        high[0, :, 1] += height * 256 * bump
        back = np.zeros((1, 9, 2))
        back[0, :8] = legs([[8, 3], [2, 3]], [0, 20]).coefficients[0]
        curve = Trajectory([0.0, 20, 40], np.concatenate([high, back]))
        plan = MissionPlan([[0]], [curve], [[20.0]])
        bad = violated(model, plan)
        assert ("radius away from obstacles" not in bad) is fine
        if not fine:
            assert bad["radius away from obstacles"].worst == pytest.approx(height - 0.75, rel=0.02)


def test_too_fast_too_hard_and_out_of_bounds():
    model = small()
    quick = flown(
        [[1, 1], (1, [8, 2]), (0, [8, 8]), (None, [8, 2])], [[1, 1], (2, [2, 8])], pace=10
    )
    found = violated(model, delayed(quick, 40.0))
    assert set(found) == {"velocity within its limit"}
    assert found["velocity within its limit"].worst == pytest.approx(7 * 35 / 16 / 10 - 1, rel=1e-6)
    calm = small(acceleration_limit=[0.001, 1])
    assert set(violated(calm, plain(calm))) == {"acceleration within its limit"}
    out = flown([[1, 1], (1, [8, 2]), (0, [8, 8]), (None, [10.1, 2])], [[1, 1], (2, [2, 8])])
    assert violated(model, out)["inside the bounds"].worst == pytest.approx(0.1, rel=1e-6)


def test_a_node_missed_by_a_thousandth():
    model = small()
    off = flown([[1, 1], (1, [8, 2]), (0, [8.001, 8]), (None, [8, 2])], [[1, 1], (2, [2, 8])])
    found = violated(model, off)["nodes passed at their times"]
    assert found.worst == pytest.approx(1e-3, rel=1e-9)
    assert "node 0" in found.where
    plan = plain(model)
    late = replace(plan, visits=((20.0, 41.0), plan.visits[1]))
    assert "nodes passed at their times" in violated(model, late)
    back = flown([[1, 1], (0, [8, 8]), (1, [8, 2])], [[1, 1], (2, [2, 8])])
    swapped = replace(back, visits=(back.visits[0][::-1], back.visits[1]))
    assert "visits in order" in violated(model, swapped)


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_a_jump_of_each_derivative(order):
    model = small()
    plan = plain(model)
    one = plan.trajectories[0]
    powers = one.coefficients.copy()
    powers[1, order] += 0.01 * 20.0**order / max(1, np.prod(range(1, order + 1)))
    names = ("position", "velocity", "acceleration", "jerk")
    found = violated(model, changed(plan, 0, coefficients=powers))
    assert f"continuity of {names[order]}" in found
    assert found[f"continuity of {names[order]}"].worst == pytest.approx(0.01, rel=1e-6)


def test_ends_away_from_the_depot_or_under_way():
    model = small()
    plan = plain(model)
    one = plan.trajectories[1]
    powers = one.coefficients + 0.001 * (np.arange(8) == 0)[:, None]
    assert "begins and ends at the depot" in violated(model, changed(plan, 1, coefficients=powers))
    powers = one.coefficients.copy()
    powers[0, 1, 0] += 0.1
    powers[0, 2, 0] -= 0.1
    assert "velocity 0 at both ends" in violated(model, changed(plan, 1, coefficients=powers))


def test_routes_that_are_none():
    model = small()
    a, b, c = model.nodes.tolist()
    once = flown([[1, 1], (1, b), (0, a), (None, b)], [[1, 1], (1, b)])
    assert "each node visited once" in violated(model, once)
    idle = flown([[1, 1], (1, b), (0, a), (None, b), (None, [1, 1]), (2, c)])
    idle = MissionPlan((*idle.routes, ()), (*idle.trajectories, None), (*idle.visits, ()))
    assert set(violated(model, idle)) == {"every robot used"}
    plan = plain(model)
    lacking = replace(plan, trajectories=(plan.trajectories[0], None))
    assert "a trajectory for each route" in violated(model, lacking)
    alone = flown([[1, 1], (1, b), (0, a), (None, b), (None, [1, 1]), (2, c)])
    found = model.verify(alone)
    assert found.objective is None
    assert "one route for each robot" in {check.name for check in found.violated}
    with pytest.raises(InvalidData, match=r"routes\[0\]\[0\] must be in 0 … 2, got 3"):
        model.verify(replace(plan, routes=((3, 0), (2,))))


def test_robots_that_meet():
    model = small(separation=1.0)
    b, c = [8, 2], [2, 8]
    # Both pass the point (8, 4) at the same time, in opposite directions.
    met = flown(
        [[1, 1], (1, b), (None, [8, 6]), (None, b)],
        [[1, 1], (None, [8, 6]), (None, b), (None, [8, 6]), (2, c)],
    )
    found = violated(model, met)["distance between robots"]
    assert found.worst == pytest.approx(1.0, abs=1e-4)
    assert "robots 0 and 1" in found.where
    # The second robot leaves for the north while the first is on its way back: both count near the depot.
    plan = delayed(plain(model), -10.0)
    reported = model.verify(plan).checks[-1]
    one, other = (curve(np.linspace(70, 80, 200_001)) for curve in plan.trajectories)
    least = np.hypot(*(one - other).T).min()
    assert float(reported.where.split("s), ")[1].split(" m")[0]) == pytest.approx(least, rel=1e-3)
    assert reported.ok == (least >= 1.0)
    assert model.verify(plain(model)).checks[-1].where.startswith("never two under way")


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_distances_from_obstacles_and_robots_are_those_of_samples(seed):
    """Distances of a curve agree with dense samples and are never less strict."""
    draw = np.random.default_rng(seed)
    square = np.array(SQUARE) + draw.uniform(-1, 1, 2)
    radius = float(draw.choice([0.0, 0.3]))
    model = small(obstacles=[square], radius=radius, nodes=[[9.5, 9.5], [9, 1]], depot=(1, 1))
    curves = []
    for _ in range(2):
        middle = draw.uniform(0, 10, (3, 2))
        curves.append(legs([[1, 1], *middle, [1, 1]], [0, 20, 30, 60, 80]))
    plan = MissionPlan([[0], [1]], curves, [[20.0], [20.0]])
    checks = {check.name: check for check in model.verify(plan).checks}
    t = np.linspace(0, 80, 40_001)
    depth = 0.0
    low, high = square[0], square[2]
    for curve in curves:
        at = curve(t)
        outside = np.maximum(np.maximum(low - at, at - high), 0.0)
        inside = np.minimum(at - low, high - at).min(axis=1)
        depth = max(depth, (radius - np.hypot(*outside.T) + np.maximum(inside, 0.0)).max())
    found = checks["radius away from obstacles"]
    if depth > 1e-3:
        assert found.worst == pytest.approx(depth, abs=0.02)
    elif depth < -1e-3:
        assert found.worst == 0.0


def test_the_model_refuses_unreachable_places():
    cases = [
        ({"obstacles": [[[0, 0], [2, 2], [2, 0], [0, 2]]]}, r"obstacles\[0\] .* do not cross"),
        ({"depot": (5, 5)}, r"depot at \[5.0, 5.0\] must not lie within an obstacle"),
        ({"nodes": [[8, 8], [3.9, 5]]}, r"nodes\[1\] \(node 1\) .* at least radius = 0.25 m .* 0.1 m"),
        ({"nodes": [[8, 8], [11, 5]]}, r"nodes\[1\] .* must lie within the bounds"),
        ({"nodes": [[8, 8], [3.7, 5]], "cell": 1.0}, r"nodes\[1\] .* take a smaller cell"),
        ({"vehicles": 4}, "vehicles must be at most the 3 nodes to visit, got 4"),
        ({"nodes": [[8, 8], [np.nan, 5]]}, r"nodes\[1, 0\] must be finite"),
        ({"radius": 9.0}, "obstacles must leave a cell of 0.5 m free"),
        ({"nodes": []}, "nodes must hold at least one node"),
        ({"acceleration_limit": 0.0}, r"acceleration_limit\[0\] must be > 0"),
        ({"velocity_limit": [[1], [1, 2]]}, "velocity_limit must be an array of shape"),
        ({"velocity_limit": [1.0, -1.0]}, r"velocity_limit\[1\] must be > 0"),
        ({"bounds": (0, 0, 0, 10)}, "bounds must be least x"),
        (
            {"obstacles": [[[7, 0], [7.2, 0], [7.2, 10], [7, 10]]], "ids": ["a", "b", "c"]},
            r"nodes\[0\] \(node a\) .* cannot be reached from the depot",
        ),
    ]  # fmt: skip
    for changes, message in cases:
        with pytest.raises(InvalidData, match=message):
            small(**changes)


def test_a_model_travels():
    model = small(ids=["a", "b", "c"], separation=0.5)
    again = FleetMission.from_json(model.to_json())
    assert again == model
    assert again.to_json() == model.to_json()
    assert again.separation == 0.5
    assert ct.models.model_type("fleet-mission") is FleetMission


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (3, "trajectories[0] must be a trajectory or null, got 3"),
        ({"times": [0, 1]}, "trajectories[0]: key 'coefficients' is missing"),
        (Trajectory([0, 1], [[[0]]]), "trajectories[0] must be x, y, got 1 dimensions"),
    ],
)
def test_errors_of_a_trajectory_name_the_robot(entry, message):
    with pytest.raises(InvalidData) as caught:
        MissionPlan([[0]], [entry], [[0.5]])
    assert str(caught.value).startswith(message) and caught.value.field == "trajectories"
