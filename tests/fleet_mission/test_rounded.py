"""Rounded polylines: continuity, limits, boxes, stops, lengths and times against a robot with stops."""

import dataclasses
import time

import numpy as np
import pytest
from fleet_mission.missions import small
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import UnsupportedOption
from crosstrack.instances.fleet_mission import random_mission
from crosstrack.models.fleet_mission import lengths_of
from crosstrack.solvers.fleet_mission import flight
from crosstrack.solvers.fleet_mission.corridor import Corridor
from crosstrack.solvers.fleet_mission.flight import slowed
from crosstrack.solvers.fleet_mission.rounded import rounded_curve


def mission(velocity=3.0, acceleration=2.0, cell=1.0):
    """Return a mission for its limits and its cell."""
    return small(
        obstacles=[], radius=0.0, bounds=np.array([0, 0, 10, 10]) * cell, nodes=np.array([[8, 8]]) * cell,
        depot=(cell, cell), vehicles=1, cell=cell, velocity_limit=velocity, acceleration_limit=acceleration,
    )  # fmt: skip


def corridor_of(knots, stops=None, margin=1.0):
    """Return the corridor with boxes around the segments of a polyline."""
    places = np.asarray(knots, float)
    low, high = np.minimum(places[:-1], places[1:]), np.maximum(places[:-1], places[1:])
    every = np.arange(len(places)) if stops is None else np.asarray(stops)
    return Corridor(low - margin, high + margin, places, every)


def curve_of(model, way, detour=1e-3):
    """Return the curve within its limits, and the knots of the stops."""
    with np.errstate(all="ignore"):
        curve, stops, _ = rounded_curve(model, way, detour)
        return slowed(model, curve), stops


def with_stops(model, knots):
    """Return the time with a stop at each corner and accelerations that jump: independent of the code."""
    total, at = 0.0, 0
    while at + 1 < len(knots):
        end = at + 1
        while end + 1 < len(knots):
            step, after = knots[end] - knots[at], knots[end + 1] - knots[end]
            if abs(np.cross(np.append(step, 0), np.append(after, 0))[2]) > 1e-9 * np.hypot(
                *step
            ) * np.hypot(*after) or (step @ after < 0):
                break
            end += 1
        long = np.abs(knots[end] - knots[at])
        at = end
        if not long.any():
            continue
        with np.errstate(divide="ignore"):
            fast = (model.velocity_limit / long).min()
            push = (model.acceleration_limit / long).min()
        total += 1 / fast + fast / push if fast * fast < push else 2 / np.sqrt(push)
    return total


def check_curve(model, way, detour=1e-3):
    """Assert continuity, limits, stops, length, and that the curve is in the boxes; return it."""
    curve, stops = curve_of(model, way, detour)
    scales = [model.cell, model.velocity_limit, model.acceleration_limit]
    for order, scale in enumerate(scales):
        begin, end = curve.at_ends(order)
        rounding = 1e-13 * np.abs(way.knots).max() / curve.durations.min() ** order
        assert (np.abs(begin[1:] - end[:-1]) <= 1e-7 * scale + rounding).all()
        if order:
            ends = np.abs([begin[0], end[-1]])
            assert (ends <= 1e-7 * scale + rounding).all()
            most = np.maximum(-curve.extremes(order).least, curve.extremes(order).largest)
            assert (most <= scale * (1 + 1e-7)).all()
    begin, end = curve.at_ends(3)
    rounding = 1e-12 * np.abs(way.knots).max() / curve.durations.min() ** 3
    assert (np.abs(begin[1:] - end[:-1]) <= 1e-6 * np.abs(begin).max() + rounding).all()
    assert (np.diff(stops) >= 0).all()
    gaps = np.hypot(*(curve(curve.times[stops]) - way.knots[way.stops]).T)
    assert gaps.max() <= 1e-7 * model.cell + 1e-13 * np.abs(way.knots).max()
    polyline = np.hypot(*np.diff(way.knots, axis=0).T).sum()
    length = lengths_of(curve).sum()
    assert polyline * (1 - 1e-9) <= length <= polyline * (1 + detour + 1e-9)
    inside_boxes(model, way, curve)
    return curve


def inside_boxes(model, way, curve):
    """Assert that each piece is on a segment of the polyline or in a box of the corridor."""
    control = curve.bezier()
    slack = 1e-7 * model.cell + 1e-12 * np.abs(way.knots).max()
    lows, highs = way.lower - slack, way.upper + slack
    in_box = ((control[:, None] >= lows[:, None]) & (control[:, None] <= highs[:, None])).all(
        axis=(2, 3)
    )
    for piece in control[~in_box.any(axis=1)]:
        # A straight piece through several boxes: a polyline is in its boxes.
        a, b = piece[0], piece[-1]
        chord = (b - a) / np.hypot(*(b - a))
        off = np.abs((piece - a) @ np.array([-chord[1], chord[0]]))
        assert off.max() <= slack
        for place in (a, b):
            ends = way.knots[:-1], way.knots[1:]
            step = ends[1] - ends[0]
            share = ((place - ends[0]) * step).sum(axis=1) / np.maximum(
                (step * step).sum(axis=1), 1e-300
            )
            foot = ends[0] + np.clip(share, 0, 1)[:, None] * step
            assert np.hypot(*(foot - place).T).min() <= slack


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_curves_along_random_polylines(seed):
    draw = np.random.default_rng(seed)
    count = int(draw.integers(2, 9))
    knots = draw.uniform(0, 30, (count, 2)) * 10.0 ** draw.uniform(-2, 1)
    if draw.random() < 0.5:
        knots = np.round(knots)
        knots = knots[np.append(True, np.hypot(*np.diff(knots, axis=0).T) > 0)]
    if len(knots) < 2:
        return
    model = mission(draw.choice([0.3, 3.0, 30.0], 2), draw.choice([0.2, 2.0, 20.0], 2))
    detour = float(draw.choice([0.0, 1e-3, 0.1]))
    way = corridor_of(knots, margin=float(draw.choice([0.01, 1.0, 100.0])))
    curve = check_curve(model, way, detour)
    assert curve.duration <= with_stops(model, knots) * (1 + 1e-3)


@pytest.mark.sample(2)
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
@pytest.mark.parametrize(
    "knots",
    [
        [[1, 1], [9, 1]],
        [[1, 1], [9, 1], [1, 1]],
        [[1, 1], [4, 1], [9, 1], [9, 1], [9, 8]],
        [[1, 1], [1, 1], [4, 1], [4.0000001, 1], [9, 1], [9, 8]],
        [[1, 1], [1 + 1e-6, 1], [9, 2], [9, 2 + 1e-7], [1, 2]],
        [[1, 1], [5, 1], [9, 1], [5, 1], [1, 1]],
    ],
)
def test_hard_polylines_at_every_scale(knots, scale):
    model = mission(3.0 * scale, 2.0 * scale, cell=scale)
    way = corridor_of(np.array(knots) * scale, margin=scale)
    curve = check_curve(model, way)
    assert curve.duration <= with_stops(model, way.knots) * (1 + 1e-3)


def test_limits_of_very_different_sizes():
    for velocity, acceleration in (([1e-3, 1e3], [1e3, 1e-3]), (1e-3, 1e9), (1e6, 1e-3)):
        check_curve(
            mission(velocity, acceleration), corridor_of([[1, 1], [8, 2], [9, 9], [1, 1.5]])
        )


def test_there_is_no_curve_if_all_knots_coincide():
    assert rounded_curve(mission(), corridor_of([[1, 1], [1, 1]]), 1e-3) is None
    assert rounded_curve(mission(), Corridor(*np.empty((2, 0, 2)), np.ones((1, 2)), np.zeros(3, int)), 0) is None  # fmt: skip


def test_stops_on_a_straight_leg_are_passed_at_speed():
    knots = np.array([[1, 1], [11, 1], [21, 1], [21, 15], [21, 30]], float)
    model = mission()
    curve, stops = curve_of(model, corridor_of(knots))
    assert np.allclose(curve(curve.times[stops]), knots, atol=1e-9)
    assert np.allclose(curve(curve.times[stops[[1, 3]]], 1), [[3, 0], [0, 3]], atol=1e-6)


def test_a_straight_leg_is_slower_than_the_bound_by_less_than_a_thousandth():
    """A continuous acceleration starts at 0, so the bound with jumps cannot be reached."""
    for length in (0.01, 1.0, 4.5, 100.0):
        knots = np.array([[0, 0], [length, 0]])
        curve, _ = curve_of(mission(), corridor_of(knots))
        bound = with_stops(mission(), knots)
        assert bound < curve.duration <= bound * (1 + 1e-3)


def test_corners_are_passed_without_a_stop_and_on_the_outside():
    knots = np.array([[0, 0], [20, 0], [20, 20]], float)
    way = corridor_of(knots)
    model = mission()
    times, speeds = [], []
    for detour in (0.0, 1e-3, 1e-2, 1e-1):
        curve = check_curve(model, way, detour)
        _, stops = curve_of(model, way, detour)
        times.append(curve.duration)
        speeds.append(float(np.hypot(*curve(curve.times[stops[1]], 1))))
        positions = curve(np.linspace(0, curve.duration, 2001))
        # The inside of the turn is to the left of the first leg and of the second one.
        assert ((positions[:, 1] <= 1e-9) | (positions[:, 0] >= 20 - 1e-9)).all()
    assert times == sorted(times, reverse=True) and times[0] > 1.02 * times[-1]
    assert speeds[0] == 0.0 and speeds == sorted(speeds) and speeds[-1] > 1.0


def test_boxes_limit_the_rounding():
    knots = np.array([[0, 0], [20, 0], [20, 20]], float)
    for margin in (1e-6, 1e-2, 1.0):
        check_curve(mission(), corridor_of(knots, margin=margin), 0.1)


@pytest.mark.parametrize(("name", "continuity"), [("pocket", 2), ("corridor", 3)])
def test_missions_are_faster_than_with_stops_and_shorter_than_minimum_snap(name, continuity):
    model = dataclasses.replace(ct.load(f"fleet-mission/{name}"), continuity=continuity)
    options = {"routing": "kmeans-ac"}
    fast = ct.solve(model, "staged", seed=0, backend_options=options)
    assert fast.verified and fast.statistics["minimum-snap problems"] == 0
    assert fast.statistics["robots that rest at knots"] == 0
    length = sum(lengths_of(curve).sum() for curve in fast.plan.trajectories)
    assert length <= fast.statistics["polyline length"] * (1 + 1e-3)
    snap = ct.solve(
        model, "staged", seed=0, backend_options={**options, "trajectories": "interior-point"}
    )
    seconds = [sum(curve.duration for curve in found.plan.trajectories) for found in (fast, snap)]
    assert fast.primal_bound < snap.primal_bound * (1 + 1e-3)
    assert seconds[0] < 0.75 * seconds[1]


def test_random_missions_are_faster_than_with_stops(monkeypatch):
    from crosstrack.solvers.fleet_mission import staged

    ways = []
    original = staged.fly

    def fly(problem, way, *rest):
        ways.append(way)
        return original(problem, way, *rest)

    monkeypatch.setattr(staged, "fly", fly)
    for seed in range(2):
        ways.clear()
        model = random_mission(5, 6, 2, seed, bounds=(0, 0, 60, 60), size=0.5)
        found = ct.solve(model, "staged", seed=0, backend_options={"routing": "kmeans-ac"})
        assert found.verified
        seconds = sum(curve.duration for curve in found.plan.trajectories)
        assert seconds <= sum(with_stops(model, way.knots) for way in ways)


def test_a_negative_detour_is_refused():
    with pytest.raises(UnsupportedOption, match="detour"):
        ct.solve(small(), "staged", backend_options={"detour": -1.0})


def test_robots_rest_at_every_knot_once_the_time_is_over(monkeypatch):
    flown = []

    def slow(*arguments):
        flown.append(time.sleep(0.5))
        return rounded_curve(*arguments)

    monkeypatch.setattr(flight, "rounded_curve", slow)
    nodes = [[8, 2 + k] for k in range(7)]
    model = small(nodes=nodes, vehicles=7)
    chosen = {"routing": "kmeans-ac"}
    answer = ct.solve(model, "staged", seed=0, threads=1, time_limit=1, backend_options=chosen)
    assert answer.verified, answer
    assert len(flown) < 7
