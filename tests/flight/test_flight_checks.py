"""The verification of flights against points and exact arithmetic, and refused data."""

import dataclasses

import numpy as np
import pytest
from flight.flights import WALL, around, boxes_of, clearance, is_clear, straight, world

from crosstrack.errors import InvalidData
from crosstrack.instances.catalogue import entry
from crosstrack.models import (
    DifferentialDrive,
    Flight,
    FlightPlan,
    GridMap,
    Model,
    PointMass,
    Quadrotor,
    Trajectory,
    VoxelMap,
)
from crosstrack.models.fleet_mission import MovingObstacle
from crosstrack.models.flight.boxes import Boxes


def violated(model, plan):
    return [check.name for check in model.verify(plan).violated]


def test_accepts_a_curve_that_rests_at_corners():
    assert around().verify(straight([[0, 0], [0, 5], [10, 5], [10, 0]])).ok


@pytest.mark.parametrize(
    ("points", "name"),
    [
        ([[0, 0], [10, 0]], "radius away from obstacles"),
        ([[0, 0], [0, 3.2], [10, 3.2], [10, 0]], "radius away from obstacles"),
        ([[0, 0], [0, 5], [10, 5], [10, 0.1]], "position at both ends"),
    ],
)
def test_names_a_violated_constraint(points, name):
    assert name in violated(around(), straight(points))


def test_finds_a_violation_between_knots_and_reports_depth_and_instant():
    model = around(radius=0.0)
    result = model.verify(straight([[0, 0], [0, 2.75], [10, 2.75], [10, 0]]))
    (check,) = [entry for entry in result.violated if entry.name.startswith("radius")]
    assert check.worst == pytest.approx(0.25, abs=1e-3)
    time = float(check.where.split("t = ")[1].split(" s")[0])
    assert 20 < time < 40


def test_names_the_limit_of_the_vehicle_and_its_instant():
    plan = straight([[0, 0], [0, 5], [10, 5], [10, 0]], pace=6.0)
    model = around()
    names = violated(model, plan)
    assert names == ["speed within its limit", "acceleration within its limit"]
    speed = max(np.linalg.norm(plan.trajectory(np.linspace(0, 18, 20001), 1), axis=1))
    (check,) = [c for c in model.verify(plan).checks if c.name.startswith("speed")]
    assert check.worst == pytest.approx(speed - 2.0, abs=1e-5)


def test_rejects_jumps_wrong_ends_and_missing_visits():
    model = around(waypoints=[[0, 5]])
    plan = straight([[0, 0], [0, 5], [10, 5], [10, 0]])
    assert model.verify(dataclasses.replace(plan, visits=[20.0])).ok
    assert violated(model, dataclasses.replace(plan, visits=[])) == ["a visit for each waypoint"]
    assert violated(model, dataclasses.replace(plan, visits=[30.0])) == ["waypoints passed"]
    curve = plan.trajectory
    powers = curve.coefficients.copy()
    powers[1, 0] += 1e-3
    jumped = FlightPlan(Trajectory(curve.times, powers))
    assert "continuity of position" in violated(around(), jumped)


def test_rejects_visits_out_of_order():
    model = around(waypoints=[[0, 5], [0, 5]])
    plan = straight([[0, 0], [0, 5], [0, 2], [0, 5], [10, 5], [10, 0]])
    assert model.verify(dataclasses.replace(plan, visits=[20.0, 60.0])).ok
    assert violated(model, dataclasses.replace(plan, visits=[60.0, 20.0])) == ["visits in order"]


def test_a_flight_among_moving_obstacles_begins_at_time_0():
    model = around(moving=[MovingObstacle(0.1, [0], [[20, 20]])])
    curve = straight([[0, 0], [0, 5], [10, 5], [10, 0]]).trajectory
    for delay in (0.0, 1e-3, -1e-3):
        delayed = FlightPlan(Trajectory(curve.times + delay, curve.coefficients))
        assert violated(model, delayed) == (["begins at time 0"] if delay else [])


def test_rejects_the_contact_with_a_moving_obstacle_and_names_it():
    cart = MovingObstacle(0.5, [0, 60], [[0, 6], [10, 6]])
    plan = straight([[0, 0], [0, 5], [10, 5], [10, 0]])
    assert around(moving=[cart]).verify(plan).ok
    near = MovingObstacle(0.8, [0, 60], [[0, 6], [10, 6]])
    model = around(moving=[MovingObstacle(0.1, [0], [[20, 20]]), near])
    (check,) = model.verify(plan).violated
    assert check.name == "distance to moving obstacles" and "moving[1]" in check.where


def test_a_vehicle_that_follows_its_path_may_not_turn_on_the_spot():
    model = around(vehicle=DifferentialDrive(5.0, None, 0.4))
    names = violated(model, straight([[0, 0], [0, 5], [10, 5], [10, 0]]))
    assert names == ["continuity of heading"]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("radius", [0.0, 0.7])
def test_distances_from_cells_equal_brute_force(seed, radius):
    draw = np.random.default_rng(seed)
    source = world(seed) if seed % 2 else GridMap(draw.random((20, 30)) < 0.1, 0.5, (3.0, -2.0))
    blocked = source.blocked if seed % 2 else source.blocked.T
    solids = Boxes.of_cells(blocked, source.cell, source.origin)
    axes = blocked.ndim
    points = source.origin + draw.random((400, axes)) * np.multiply(blocked.shape, source.cell)
    exact = clearance(source, points)
    depths = solids.depths(points, radius)
    outside = exact > 0
    np.testing.assert_allclose(depths[outside], radius - exact[outside], atol=1e-12)
    assert (depths[~outside] >= radius).all()


@pytest.mark.parametrize("seed", range(8))
def test_verification_of_random_curves_equals_exact_arithmetic(seed):
    """The floating-point proof agrees with rational arithmetic, also for curves near cells."""
    draw = np.random.default_rng(seed)
    source = world(seed, share=0.02)
    radius = [0.0, 0.4][seed % 2]
    low, high = boxes_of(source)
    agreed = set()
    for _ in range(6):
        middle = draw.random(3) * [12, 12, 4]
        control = middle + draw.normal(size=(1, 6, 3)) * 0.8
        curve = Trajectory.from_bezier([0.0, 2.0], np.clip(control, 0.5, [11.5, 11.5, 3.5]))
        ends = curve(np.array([0.0, 2.0]))
        if clearance(source, ends).min() <= radius:
            continue
        model = Flight(source, ends[0], ends[1], PointMass(100.0, 100.0), radius=radius)
        check = next(c for c in model.verify(FlightPlan(curve)).checks if c.name[:6] == "radius")
        samples = curve(np.linspace(0.0, 2.0, 4001))
        inside = ((samples[:, None] > low) & (samples[:, None] < high)).all(axis=2).any()
        hit = inside or clearance(source, samples).min() < radius - 1e-5
        assert check.ok != hit
        if check.ok and check.worst == 0:
            assert is_clear(curve, source, radius * (1 - 1e-6), depth=24)
        agreed.add(hit)
    assert agreed


def test_a_curve_along_a_wall_and_between_two_cells():
    """Contact is allowed; a face between two blocked cells is no way."""
    free = GridMap(["....", "@@@@"], 1.0)
    assert Flight(free, (0, 1), (4, 1), PointMass(9, 9)).verify(straight([[0, 1], [4, 1]])).ok
    split = GridMap([".@.", ".@."])
    outside = straight([[0.5, 1.0], [0.5, -1e-7], [2.5, -1e-7], [2.5, 1.0]])
    model = Flight(split, (0.5, 1.0), (2.5, 1.0), PointMass(9, 9))
    assert "radius away from obstacles" in violated(model, outside)
    closed = GridMap([".@@.", ".@@.", "...."], 1.0)
    model = Flight(closed, (0, 1), (4, 1), PointMass(9, 9))
    (check,) = model.verify(straight([[0, 1], [4, 1]])).violated
    assert check.name == "radius away from obstacles" and check.worst > 0.4


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"start": (5, 0)}, "start", "inside an obstacle"),
        ({"start": (3.8, 0)}, "start", "radius = 0.3"),
        ({"start": (np.nan, 0)}, "start", "finite"),
        ({"goal": (1, 2, 3)}, "goal", "entries"),
        ({"start": (0, 0, 0), "goal": (1, 2, 3)}, "start", "2 coordinates"),
        ({"start_velocity": (3, 0)}, "start_velocity", "speed"),
        ({"goal_acceleration": (0, 2)}, "goal_acceleration", "acceleration"),
        ({"vehicle": Quadrotor(1.0, (0.0, 20.0))}, "map", "3 axes"),
        ({"vehicle": PointMass()}, "vehicle", "limit"),
        ({"vehicle": 3}, "vehicle", "vehicle"),
        ({"radius": -1.0}, "radius", ">= 0"),
        ({"map": np.zeros((2, 2)), "radius": 0.0}, "radius", "> 0"),
        ({"map": {"cells": []}}, "map", "polygons"),
        ({"map": 3}, "map", "polygons"),
        ({"map": np.empty((0, 2))}, "map", "at least one point"),
        ({"map": [[[0, 0], [1, 1], [0, 1], [1, 0]]]}, "map", "cross"),
        ({"bounds": (0, 0, 0, 0)}, "bounds", "higher"),
        ({"bounds": (1, -9, 20, 9)}, "start", "within"),
        ({"waypoints": [[5, 0]]}, "waypoints", "obstacle"),
        ({"objective": "energy"}, "objective", "weighted"),
        ({"order": 2}, "order", ">= 3"),
        ({"cell": 0.0}, "cell", "> 0"),
        ({"moving": [MovingObstacle(1.0, [0], [[0, 0, 0]])]}, "moving", "2 axes"),
        ({"goal": (1e12, 0), "cell": 0.1}, "start", "1e9 cells"),
    ],
)
def test_refuses_bad_data(changes, field, words):
    with pytest.raises(InvalidData, match=words) as caught:
        around(**changes)
    assert caught.value.field == field


def test_refuses_a_start_outside_a_map_of_cells():
    with pytest.raises(InvalidData, match="within"):
        Flight(GridMap(["..", ".."]), (-1, 1), (1, 1), PointMass(1, 1))


@pytest.mark.parametrize(
    "source",
    [[WALL], GridMap(["...", ".@.", "..."], 2.0), world(0), np.ones((3, 2)), np.ones((3, 3))],
)
def test_every_form_of_a_map_is_read_from_its_json(source):
    axes = (
        3
        if isinstance(source, VoxelMap)
        else np.shape(source)[-1]
        if isinstance(source, np.ndarray)
        else 2
    )
    model = Flight(source, [0.5] * axes, [0.4] * axes, PointMass(1, 1), radius=0.1)
    again = Model.from_json(model.to_json())
    assert again.digest == model.digest and again == model


def test_moving_obstacles_keep_their_digests():
    """Absent fields of an obstacle are part of the digest, as in records of earlier versions."""
    assert entry("flight/crossing").build().digest[:16] == "d3d8f7ad3658a973"
