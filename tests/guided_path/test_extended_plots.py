"""Plots of guided tours with optional fields: lines of all vehicles, time windows, loops and trees."""

import numpy as np
import pytest
from guided_path.extended import CASES, random_extended
from pictures import artists

import crosstrack as ct
from crosstrack.errors import UnsupportedOption
from crosstrack.models import GuidedPathTour
from crosstrack.models.guided_path import GuidedPathPlan
from crosstrack.models.guided_path.plot import animate_tour

FEW = (CASES[0], CASES[3], CASES[4], CASES[9], CASES[15])


def test_each_vehicle_has_a_line_on_which_it_makes_room():
    model = GuidedPathTour([0, 9, 4], vehicles=[0, 4])
    (axes,) = ct.plot(model, GuidedPathPlan((2, 1), (1, 0)), parts=["tour"]).axes
    left, right = (found.get_xydata().tolist() for found in artists(axes, "vehicle"))
    assert left == [[0, 0], [0, 0], [9, 14], [0, 28]]
    assert right == [[4, 0], [4, 0], [9, 14], [4, 28]]


def test_time_shows_windows_waiting_and_service():
    model = GuidedPathTour(
        [0, 4, 6], speed=2.0, service=[1, 3, 0], windows=[[0, None], [5, 9], [0, 20]], end="free"
    )
    (axes,) = ct.plot(model, GuidedPathPlan((1, 2)), parts=["tour"], over="time").axes
    (line,) = (found.get_xydata().tolist() for found in artists(axes, "vehicle"))
    assert line[:6] == [[0, 0], [0, 1], [4, 3], [4, 5], [4, 8], [6, 9]]
    bars = [found.get_xydata().tolist() for found in artists(axes, "window")]
    assert [[4, 5], [4, 9]] in bars
    assert len(bars) == 3


@pytest.mark.parametrize("departs", [-50.0, 28_800.0])
def test_the_time_axis_begins_at_the_departure(departs):
    windows = [[departs, None], [departs + 2, departs + 9]]
    model = GuidedPathTour([0, 4], speed=2.0, windows=windows)
    (axes,) = ct.plot(model, GuidedPathPlan((1,)), parts=["tour"], over="time").axes
    end, begin = axes.get_ylim()
    assert departs - 1 < begin < departs < departs + 4 < end < departs + 5
    bars = [found.get_ydata().tolist() for found in artists(axes, "window")]
    assert bars[1] == [departs + 2, end]


def test_time_needs_a_speed_and_a_single_vehicle():
    plan = GuidedPathPlan((1, 2))
    for model, given in (
        (GuidedPathTour([0, 1, 2]), plan),
        (GuidedPathTour([0, 1, 2], vehicles=[0], speed=1), GuidedPathPlan((1, 2), (0, 0))),
    ):
        with pytest.raises(UnsupportedOption, match="a speed and a single vehicle"):
            ct.plot(model, given, over="time")


def test_a_loop_is_drawn_beyond_its_origin():
    model = GuidedPathTour([1, 9], track={"loop": 10}, end="free")
    (axes,) = ct.plot(model, GuidedPathPlan((1,)), parts=["tour"]).axes
    (line,) = (found.get_xydata().tolist() for found in artists(axes, "vehicle"))
    assert line == [[1, 0], [-1, 2], [-1, 2]]
    assert axes.get_xlim()[0] < -1


def test_all_vehicles_move_in_the_animation(tmp_path):
    model = GuidedPathTour([0, 9, 4], vehicles=[0, 4])
    film = animate_tour(model, GuidedPathPlan((2, 1), (1, 0)), frames=3)
    film.save(tmp_path / "tour.gif", writer="pillow", dpi=20)
    film._func(1)
    (vehicle,) = artists(film._fig.axes[0], "vehicle")
    assert vehicle.get_xydata().tolist() == [[9, 14], [9, 14]]


@pytest.mark.parametrize("fields", FEW, ids=["+".join(case) for case in FEW])
def test_every_combination_is_drawn(fields):
    model = next(m for k in range(50) if ct.solve(m := random_extended([k, 6], fields)).plan)
    plan = ct.solve(model).plan
    for over in (
        "walked",
        "stops",
        *["time"] * (model.speed is not None and model.vehicles is None),
    ):
        figure = ct.plot(model, plan, over=over)
        lines = artists(figure.axes[-1], "vehicle")
        assert len(lines) == (1 if model.vehicles is None else len(model.vehicles))
        assert all(np.isfinite(line.get_xydata()).all() for line in lines)
    wrong = GuidedPathPlan(plan.order[:-1], plan.vehicles[:-1])
    assert ct.plot(model, wrong).axes
