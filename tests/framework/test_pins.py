"""Pins of checks, animations, units and orientation in the pictures of all problems."""

import dataclasses
import json
import re
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
import strange
from carts import braking, cruising

import crosstrack as ct
from crosstrack.errors import CrosstrackError
from crosstrack.models import (
    BlackBoxMinimisation,
    ErrorCorrectionRouting,
    FleetMission,
    FleetRouting,
    GridPath,
    GuidedPathTour,
    Route,
    Trajectory,
)
from crosstrack.models.black_box import BlackBoxPoint
from crosstrack.models.fleet import FleetPlan
from crosstrack.models.fleet_mission import MissionPlan
from crosstrack.models.grid_path import GridPlan
from crosstrack.models.guided_path import GuidedPathPlan
from crosstrack.models.messenger import TourPlan
from crosstrack.models.model import Model
from crosstrack.models.plots import kit, plot
from crosstrack.models.problems import resolve, table
from crosstrack.models.sideslip import SideslipEstimate
from crosstrack.models.unknown_grid import NavigationRuns

PICTURES = table("crosstrack.models", "PICTURES")
ANIMATIONS = table("crosstrack.models", "ANIMATIONS")


@cache
def example(kind):
    """Return the last small instance of a kind with its plan."""
    pairs = [(json.loads(model), model, plan) for model, plan in strange.examples()]
    _, text, plan = next(entry for entry in reversed(pairs) if entry[0]["model"] == kind)
    model = Model.from_json(text)
    return model, model.as_plan(json.loads(plan))


@cache
def picture(kind):
    return plot(*example(kind))


def pins(model, plan, name):
    """Return the pins of the check called `name`, as (axes, position)."""
    figure = plot(model, plan)
    return [
        (pin.axes, [value for value in pin[2:] if value is not None])
        for pin in figure.crosstrack_pins
        if pin.check.name == name
    ]


def place_on(found, label):
    """Return the position of the pin in the axes whose y label begins with `label`."""
    (place,) = [place for axes, place in found if axes.get_ylabel().startswith(label)]
    return place


@pytest.mark.parametrize("kind", PICTURES)
def test_pins_are_inside_their_axes_and_belong_to_the_verification(kind):
    model, plan = example(kind)
    checks = model.verify(plan).checks
    for pin in getattr(picture(kind), "crosstrack_pins", []):
        assert pin.check in checks
        for name, value in zip("xyz", pin[2:], strict=True):
            if value is not None:
                low, high = sorted(getattr(pin.axes, f"get_{name}lim")())
                assert low <= value <= high


# -- violated plans, whose places are computed here --------------------------------------------------


def test_an_exceeded_error_is_pinned_at_its_point_and_in_its_panel():
    points = [[0, 0, 0], [3, 4, 0], [3, 4, 12], [9, 9, 9]]
    model = ErrorCorrectionRouting(
        points, ["A", "horizontal", "vertical", "B"], 9, 9, 1, 4, 99, delta=1
    )
    found = pins(model, Route((0, 1, 2, 3)), "horizontal error at horizontal points")
    ((_, place),) = [entry for entry in found if entry[0].name == "3d"]
    assert place == [3, 4, 0]
    # Five metres at a rate of 1 per metre.
    assert place_on(found, "horizontal error") == [5, 5]


def test_an_exceeded_level_is_pinned_on_arrival():
    model, _ = example("resource-routing")
    found = pins(model, Route((0, 1, 2)), "arcs that there are")
    assert place_on(found, "y") == [2, 2]  # the middle of the points 1 and 2
    found = pins(model, Route((0, 1, 3, 2)), "fuel at town")
    assert place_on(found, "fuel")[0] in (2.5, 3.5)


def test_a_missed_node_and_a_long_route_of_a_fleet_are_pinned():
    points = [[0, 0], [3, 4], [6, 8], [0, 9]]
    model = FleetRouting(2, points=points, battery=[15.0, 15.0])
    plan = FleetPlan(((2,), (1,)))
    ((axes, place),) = pins(model, plan, "each node visited once")
    assert (axes.get_xlabel(), place) == ("x (m)", [0, 9])
    ((axes, place),) = pins(model, plan, "route within battery")
    assert (axes.get_xlabel(), place) == ("length of route (m)", [20, 0])


def test_a_path_through_a_blocked_cell_is_pinned_in_the_cell():
    grid = {"blocked": ["....", ".@..", "...."], "cell": 2.0, "origin": [10.0, 0.0], "upward": True}
    model = GridPath(grid, (1, 0), [[1, 3]], connectivity="any")
    ((_, (x, y)),) = pins(model, GridPlan(([[11, 3], [17, 3]],)), "keeps to free cells")
    assert 12 <= x <= 14
    assert 2 <= y <= 4


def test_a_pair_in_the_wrong_order_is_pinned_at_its_late_customer():
    model = GuidedPathTour([0, 3, 5, 1], precedence=[[1, 2]])
    found = pins(model, GuidedPathPlan((2, 1, 3)), "precedence")
    assert place_on(found, "walked") == [3, 7]  # at 5 m, and 2 m back
    found = pins(model, GuidedPathPlan((1, 2, 1)), "each customer served once")
    assert place_on(found, "walked") == [3, 3]


def test_a_moved_encounter_of_a_tour_is_pinned_there():
    model, plan = example("messenger-tour")
    moved = TourPlan(
        plan.order, plan.times, [[0.0, 25.0], [7.0, 33.0]], plan.start, plan.primitives
    )
    ((_, place),) = pins(model, moved, "encounter at its point")
    assert place == [7, 33]


def test_the_highest_speed_of_a_trajectory_is_pinned_on_the_path_and_its_panel():
    from crosstrack.models import MinimumSnap

    _, plan = example("minimum-snap")
    model = MinimumSnap([[0.0, 0.0], [1.0, 2.0], [3.0, 2.0]], plan.times, velocity_limit=0.1)
    times = np.linspace(0, 3, 300_001)
    speeds = np.abs(plan(times, 1))
    row, axis = np.unravel_index(speeds.argmax(), speeds.shape)
    found = pins(model, plan, "velocity limit")
    time, speed = place_on(found, "velocity")
    assert time == pytest.approx(times[row], abs=1e-3)
    assert abs(speed) == pytest.approx(speeds[row, axis], rel=1e-3)
    assert place_on(found, "y") == pytest.approx(plan(times[row]), abs=1e-2)


def test_a_violated_bound_of_a_state_is_pinned_at_its_peak():
    # From rest to -1 m/s in a second by a constant force: the position x = t - t² peaks at 0.25 m.
    found = pins(braking(bound=0.1).build(), cruising(), "bounds of states")
    assert place_on(found, "x") == pytest.approx([0.5, 0.25])


def test_the_final_attitude_of_a_slew_is_pinned_at_the_end():
    # The example rests, so its final attitude is the initial one: q[1] is 0 after 20 s.
    found = pins(*example("satellite-slew"), "final attitude")
    assert place_on(found, "quaternion") == [20, 0]


def test_the_closest_approach_of_robots_is_pinned_at_both_and_in_the_panel():
    nodes = [[9.0, 1.0], [1.0, 9.0]]
    model = FleetMission((), (0, 0, 10, 10), nodes, (5, 5), 2, cell=0.5, radius=0.25, separation=1)
    smooth = np.array([0.0, 0, 0, 0, 35, -84, 70, -20])[:, None]

    def flight(node, start, half):
        there = smooth * (node - np.array([5.0, 5.0]))
        back = -there
        there[0], back[0] = (5.0, 5.0), node
        return Trajectory([start, start + half, start + 2 * half], [there, back])

    flights = [flight(np.array(nodes[0]), 0.0, 20.0), flight(np.array(nodes[1]), 1.0, 30.0)]
    plan = MissionPlan([[0], [1]], flights, [[20.0], [31.0]])
    found = pins(model, plan, "distance between robots")
    times = np.linspace(1.0, 40.0, 100_001)
    apart = np.hypot(*(flights[0](times) - flights[1](times)).T)
    closest = times[apart.argmin()]
    assert place_on(found, "distance") == pytest.approx([closest, apart.min()], abs=2e-2)
    robots = [place for axes, place in found if axes.get_ylabel() == "y (m)"]
    expected = [flight(closest) for flight in flights]
    assert np.allclose(robots, expected, atol=2e-2)


def test_an_angle_beyond_90_degrees_is_pinned_at_its_sample():
    model, plan = example("sideslip")
    angles = plan.sideslip.copy()
    angles[7] = np.deg2rad(100.0)
    changed = SideslipEstimate(angles, plan.deviation)
    ((_, place),) = pins(model, changed, "angle is below 90°")
    assert place == pytest.approx([model.recording.times[7], 100.0])


def test_a_claimed_slope_is_pinned_in_its_region():
    model, plan = example("attractor")
    ((axes, (x, y)),) = pins(model, plan, "exponent is the slope of its curve")
    assert plan.exponent.low * model.period <= x <= plan.exponent.high * model.period
    assert y == pytest.approx(np.interp(x, *axes.lines[0].get_data()))


def test_a_point_beyond_its_bounds_is_pinned():
    model = BlackBoxMinimisation("sphere", [[-1, 1], [-1, 1]], budget=9)
    ((_, place),) = pins(model, BlackBoxPoint((0.5, 1.5)), "bounds")
    assert place == [0.5, 1.5]


def test_a_false_claim_of_a_run_is_pinned_where_it_ends():
    model, plan = example("unknown-grid")
    claimed = NavigationRuns(("DD", plan.actions[1]), ("reached", plan.outcomes[1]))
    ((_, place),) = pins(model, claimed, "the target is where the run ends")
    assert place == [0, 2]  # column and row


def test_vehicle_with_a_colon_in_its_name_is_pinned_at_its_own_encounter():
    gap = ct.load("messenger/gap")
    model = dataclasses.replace(gap, ids=["a", "a:b"])
    plan = ct.solve(model, time_limit=2).plan
    place = plan.points[list(plan.order).index(1)]
    shift = np.where(plan.points == place, [2.0, 0.0], 0.0)
    wrong = dataclasses.replace(plan, points=plan.points + shift)
    ((_, spot),) = pins(model, wrong, "encounter at its point")
    assert spot == pytest.approx([place[0] + 2, place[1]])


# -- animations --------------------------------------------------------------------------------------


def frames_of(kind, frames=3):
    """Return the figure after the last frame, and the texts of the clock."""
    model, plan = example(kind)
    animation = resolve(ANIMATIONS[kind])(model, plan, frames=frames)
    animation._draw_was_started = True
    texts = []
    for frame in range(frames):
        animation._func(frame)
        texts.append([text.get_text() for text in animation._fig.texts])
    return animation._fig, texts


def test_every_problem_has_an_animation():
    assert set(ANIMATIONS) == set(PICTURES)


FOLLOWED = {
    "attractor": "x(t + ", "error-correction": "horizontal error", "fleet-routing": "y (m",
    "grid-path": "y (m", "minimum-snap": "y (m", "minimum-derivative": "y (m", "time-allocation": "y (m",
    "optimal-control": "w", "resource-routing": "fuel", "sideslip": "sideslip angle",
}  # fmt: skip


@pytest.mark.parametrize("kind", FOLLOWED)
def test_markers_follow_what_is_drawn(kind):
    model, plan = example(kind)
    figure, texts = frames_of(kind)
    assert len(set(map(tuple, texts))) == 3
    axes = next(axes for axes in figure.axes if axes.get_ylabel().startswith(FOLLOWED[kind]))
    markers = [line for line in axes.lines if line.get_gid() == "mover"]
    assert markers
    ends = {
        "error-correction": lambda: [
            model.walk(plan)[-1].distance,
            model.walk(plan)[-1].horizontal,
        ],
        "fleet-routing": lambda: model.points[0],
        "grid-path": lambda: plan.paths[0][-1],
        "minimum-snap": lambda: plan(plan.times[-1]),
        "minimum-derivative": lambda: plan(plan.times[-1]),
        "time-allocation": lambda: plan(plan.times[-1]),
        "sideslip": lambda: [model.recording.times[-1], np.degrees(plan.sideslip[-1])],
    }
    if kind in ends:
        expected = np.asarray(ends[kind](), float)
        places = np.array([np.ravel(marker.get_data()) for marker in markers])
        assert np.abs(places - expected).max(axis=1).min() < 1e-9 * max(1, np.abs(expected).max())
    figure.draw_without_rendering()


@pytest.mark.parametrize("kind", FOLLOWED)
def test_animations_refuse_wrong_frames_and_plans(kind):
    model, plan = example(kind)
    for options, content in (({"frames": 1}, plan), ({"interval": 0}, plan), ({}, 3)):
        with pytest.raises(CrosstrackError):
            resolve(ANIMATIONS[kind])(model, content, **options)


# -- units, orientation and scales -------------------------------------------------------------------


@pytest.mark.parametrize("kind", PICTURES)
def test_axes_have_units(kind):
    figure = picture(kind)
    figure.draw_without_rendering()
    for axes in figure.axes:
        for name in "xyz" if axes.name == "3d" else "xy":
            axis, label = getattr(axes, f"{name}axis"), getattr(axes, f"get_{name}label")()
            ticks = [text.get_text() for text in axis.get_ticklabels() if text.get_visible()]
            # Axes without ticks, with names as ticks, or below others with the same time have no label.
            numbers = [tick for tick in ticks if re.fullmatch(r"[−\d.,×⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+", tick)]
            assert re.search(r"\([^()]+(\([^()]+\))?\)$", label) or not numbers, (kind, name, ticks)


@pytest.mark.parametrize("kind", PICTURES)
def test_maps_have_equal_scales_and_y_upward(kind):
    for axes in picture(kind).axes:
        x, y = axes.get_xlabel(), axes.get_ylabel()
        if axes.name == "3d" or not (
            x.startswith(("x (", "column")) and y.startswith(("y (", "row"))
        ):
            continue
        assert axes.get_aspect() == 1
        assert axes.yaxis_inverted() == y.endswith("downward)")


def test_places_beyond_the_axes_move_to_their_edge_and_nan_is_ignored():
    axes = kit.Scene("", None, None, (3, 3)).axes(0.5, 0.5, 0.1, 0.3)
    axes.set_xlim(0, 1)
    axes.set_ylim(5, 2)
    check = SimpleNamespace(where="here")
    kit.pin_places(axes, SimpleNamespace(checks=[check]), {"here": [[7, 3], [np.nan, 3]]})
    ((_, _, *place),) = axes.figure.crosstrack_pins
    assert place == [1, 3, None]


@pytest.mark.parametrize(
    ("where", "time"),
    [("x at t = 1e-05 s of phase 'go'", 1e-5), ("robot 0 (t = -2.5 s)", -2.5), ("node t = 1.2.3", None),
     ("node t = nan", None), ("at = 3 s", None)],
)  # fmt: skip
def test_only_a_number_is_read_as_a_time(where, time):
    assert kit.time_of(SimpleNamespace(where=where)) == time


def test_a_label_like_a_place_does_not_break_the_picture():
    model, plan = example("fleet-mission")
    odd = dataclasses.replace(model, ids=("robot 0, segment 99",))
    missed = MissionPlan([[]], plan.trajectories, [[]])
    found = pins(odd, missed, "each node visited once")
    assert list(model.nodes[0]) in [place for _, place in found]


def test_marker_of_a_map_is_always_at_a_state():
    model = ct.load("attractor/henon")
    plan = ct.solve(model, "full-analysis").plan
    animation = resolve(ANIMATIONS[model.kind])(model, plan, frames=40)
    animation._draw_was_started = True
    states = model.states(plan.delay, 2)
    lines = [line for axes in animation._fig.axes for line in axes.lines]
    marker = next(line for line in lines if line.get_gid() == "mover")
    for frame in range(40):
        animation._func(frame)
        assert np.abs(states - marker.get_xydata()).sum(axis=1).min() == 0
