"""Figures of missions: drawn data equal those of the model and the plan."""

from types import SimpleNamespace

import numpy as np
import pytest
from fleet_mission.stop_and_go import stop_and_go
from pictures import artists, heights, legend, panels, render, words

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.models import FleetMission
from crosstrack.models.fleet_mission import MissionPlan, MovingObstacle
from crosstrack.models.fleet_mission.plot import animate_mission
from crosstrack.models.grid_path import trail

ROUTES = [[0, 1], [2, 3], [4]]


def mission(**changes):
    given = {
        "obstacles": [
            [[4, 4], [6, 4], [6, 6], [4, 6]],
            {"shell": [[1, 7], [4, 7], [4, 9], [1, 9]], "holes": [[[2, 7.5], [3, 7.5], [3, 8.5]]]},
        ],
        "bounds": (0, 0, 10, 10), "nodes": [[9, 1], [9, 3], [9, 9], [7, 9.5], [1, 5]], "depot": (1, 1),
        "vehicles": 3, "cell": 0.5, "radius": 0.25, "velocity_limit": (2.0, 1.0),
        "acceleration_limit": 0.8, "separation": 0.6, "name": "three",
    }  # fmt: skip
    return FleetMission(**given | changes)


@pytest.fixture(scope="module")
def three():
    """A valid plan: robots leave one after another and follow the map."""
    model = mission()
    stops = [np.concatenate([[model.depot], model.nodes[r], [model.depot]]) for r in ROUTES]
    ways = [trail(model.map, one, straightened=True) for one in stops]
    plan = stop_and_go(model, ROUTES, ways, starts=(0.0, 9.0, 80.0))
    assert model.verify(plan).ok, model.verify(plan)
    return model, plan


def lines(axes, gid):
    (found,) = artists(axes, gid)
    return [np.asarray(one) for one in found.get_segments()]


def chart_of(figure):
    """The axes of the map."""
    (found,) = (axes for axes in figure.axes if axes.get_xlabel().startswith("x ("))
    return found


def signed_area(ring):
    x, y = ring.T
    return 0.5 * float(np.dot(x[:-1], y[1:]) - np.dot(x[1:], y[:-1]))


def lengths(found):
    return [float(np.hypot(*np.diff(line, axis=0).T).sum()) for line in found]


def test_what_is_drawn(three, tmp_path):
    model, plan = three
    figure = ct.plot(model, plan)
    figure.savefig(tmp_path / "mission.png", dpi=40)
    found = panels(figure)
    assert list(found) == [
        "", "y (m)", "velocity x", "velocity y", "acceleration x", "acceleration y",
        "distance of robots",
    ]  # fmt: skip
    chart = chart_of(figure)
    assert chart.get_aspect() == 1
    curves = lines(chart, "curve that is flown")
    for curve, one in zip(curves, plan.trajectories, strict=True):
        assert curve[0] == pytest.approx(model.depot)
        ends = [one(t) for t in one.times]
        assert all(np.hypot(*(curve - end).T).min() < 1e-9 for end in ends)
    objective = model.verify(plan).objective
    loads = np.array(lengths(curves))
    assert loads.sum() + 0.4 * loads.std(ddof=1) == pytest.approx(objective, rel=1e-4)
    (bars,) = artists(found[""], "load")
    assert sorted(path.get_extents().width for path in bars.get_paths()) == pytest.approx(
        sorted(loads), rel=1e-4
    )
    (nodes,) = artists(chart, "node")
    assert nodes.get_offsets().tolist() == model.nodes.tolist()
    colours = [tuple(row) for row in nodes.get_facecolors()]
    assert colours[0] == colours[1] != colours[2] == colours[3] != colours[4]
    assert artists(chart, "depot")[0].get_offsets().tolist() == [[1, 1]]
    shapes = artists(chart, "obstacle")[0].get_paths()
    # A hole runs against its shell.
    areas = [sum(map(signed_area, shape.to_polygons())) for shape in shapes]
    assert areas == pytest.approx([4.0, 6.0 - 0.5])
    grown = artists(chart, "too near")[0].get_paths()
    assert any(shape.contains_point((6.2, 5.0)) for shape in grown)
    assert not any(shape.contains_point((6.3, 5.0)) for shape in grown)
    assert not artists(chart, "worst violation")
    title = (
        f"three  ·  3 robots, 5 nodes, sum + 0.4 × deviation {objective:.6g} m, {plan.end:.5g} s"
    )
    assert figure.get_suptitle() == title
    assert {"obstacle", "nearer than the radius", "mean", "limit"} <= set(legend(figure))
    assert {str(k) for k in range(5)} <= {text.get_text() for text in chart.texts}


def test_limited_quantities_are_drawn_over_time(three):
    model, plan = three
    figure = render(ct.plot(model, plan, parts=["velocity", "acceleration", "distance"]))
    found = panels(figure)
    for name, order, limits in (
        ("velocity", 1, [2.0, 1.0]), ("acceleration", 2, [0.8, 0.8]),
    ):  # fmt: skip
        for axis in (0, 1):
            panel = found[f"{name} {'xy'[axis]}"]
            assert heights(panel) == pytest.approx([-limits[axis], limits[axis]])
            drawn = [line for k in range(3) for line in artists(panel, f"curve robot {k}")]
            assert len(drawn) == 3
            for line, one in zip(drawn, plan.trajectories, strict=True):
                times, values = line.get_xydata().T
                assert values == pytest.approx(one(times, order)[:, axis])
                assert times[[0, -1]] == pytest.approx(one.times[[0, -1]])
    (line,) = artists(found["distance of robots"], "curve least distance")
    times, apart = line.get_xydata().T
    assert heights(found["distance of robots"]) == [0.6]
    for t, value in zip(times[::37], apart[::37], strict=True):
        here = [one(t) for one in plan.trajectories if one.times[0] <= t <= one.times[-1]]
        pairs = [np.hypot(*(a - b)) for k, a in enumerate(here) for b in here[:k]]
        if np.isfinite(value):
            assert value == pytest.approx(min(pairs))
    assert np.isfinite(apart).sum() > 100
    assert np.nanmin(apart) >= 0.6


def test_layers_beside_one_another(three):
    model, plan = three
    layers = ("cells", "grid", "smoothed", "curve")
    figure = render(ct.plot(model, plan, parts=["map"], layers=layers))
    (chart,) = figure.axes
    names = ("path on the grid", "shortened by lines of sight", "curve that is flown")
    grid, smoothed, curves = (lines(chart, name) for name in names)
    assert set(names) < set(legend(figure))
    assert {"robot 0", "robot 2"} < set(legend(figure))
    for long, short, curve in zip(*map(lengths, (grid, smoothed, curves)), strict=True):
        assert short <= long + 1e-9
        assert curve == pytest.approx(short, rel=1e-4)
    for line in grid:
        assert model.map.holds(model.map.cells_of(line)).all()
    (image,) = chart.images
    assert (image.get_array() == model.map.blocked).all()
    (alone,) = ct.plot(model, plan, parts=["map"], layers=["smoothed"]).axes
    assert not artists(alone, "curve that is flown")


def test_without_a_plan_the_field_is_drawn():
    model = mission(ids=["north", "b", "c", "d", "e"], obstacles=[], radius=0.0)
    figure = render(ct.plot(model, title="mine", size=(4, 3)))
    (chart,) = figure.axes
    assert "north" in words(figure)
    assert figure.get_suptitle() == "mine"
    assert figure.get_size_inches().tolist() == [4, 3]
    assert legend(figure) == ["obstacle", "depot", "node"]
    assert not artists(chart, "too near")
    assert "north" not in words(ct.plot(model, labels=False))


def test_violations_are_ringed(three):
    model, _ = three
    # Straight through the obstacle in the middle, node 4 left out, two robots on one line.
    plan = stop_and_go(model, [[2], [3], [0, 1]])
    figure = render(ct.plot(model, plan, parts=["map", "loads"]))
    chart = chart_of(figure)
    assert "NOT VALID" in figure.get_suptitle()
    (missed,) = artists(chart, "not visited once")
    assert missed.get_offsets().tolist() == [[1, 5]]
    (rings,) = artists(chart, "worst violation")
    middle = np.hypot(*(rings.get_offsets() - [5, 5]).T)
    assert middle.min() < 1.0
    assert "worst violation" in legend(figure)
    fast = mission(velocity_limit=0.5)
    wild = render(ct.plot(fast, three[1], parts=["map", "velocity"]))
    rings = artists(chart_of(wild), "worst violation")[0].get_offsets()
    assert len(rings) == 1
    (place,) = artists(panels(wild)["velocity x"], "worst violation")
    assert abs(place.get_ydata()[0]) == pytest.approx(2.0, rel=0.01)


@pytest.mark.parametrize(
    "model",
    [
        mission(vehicles=5, nodes=[[9, 1]] * 5, separation=0.0),
        mission(obstacles=[], vehicles=1, nodes=[[1, 1]], cell=10.0, radius=0.0),
        mission(bounds=(0, 0, 1e5, 10), nodes=[[1e5 - 1, 1]], vehicles=1, cell=2.5, obstacles=[]),
        mission(obstacles=[[[3, 0], [4, 0], [4, 8]], [[3, 0], [3.5, 0.1], [3.4, 0.5]]], radius=0.0),
    ],
)
@pytest.mark.filterwarnings("error")
def test_strange_missions_are_drawn(model, tmp_path):
    render(ct.plot(model))
    shares = np.array_split(np.arange(len(model.nodes)), model.vehicles)
    plan = stop_and_go(model, [share.tolist() for share in shares])
    figure = ct.plot(model, plan, parts=["map", "distance"], layers=["grid", "curve"])
    figure.savefig(tmp_path / "plan.png", dpi=30)
    curves = lines(chart_of(figure), "curve that is flown")
    assert len(curves) == model.vehicles


def test_plans_that_are_far_from_valid_are_drawn(three):
    wild = [{"times": [0, 1e-9], "coefficients": [[[1, 1], [1e200, -1e200]]]}] * 4
    for plan in (
        MissionPlan([], [], []),
        MissionPlan([[]] * 4, [None] * 4, [[]] * 4),
        MissionPlan([[0]] * 4, wild, [[5e8]] * 4),
    ):
        figure = render(ct.plot(three[0], plan))
        assert "NOT VALID" in figure.get_suptitle()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"parts": ["map", "jerk"]}, "parts must hold some of 'map', 'loads'"),
        ({"parts": []}, "parts must hold"),
        ({"layers": ["curves"]}, "layers must hold some of 'cells', 'grid'"),
        ({"layers": "grid"}, "layers must hold"),
        ({"labels": 1}, "labels must be True or False"),
        ({"tolerance": 0}, "tolerance must"),
        ({"size": (0, 1)}, "size must be"),
        ({"view": "map"}, "no option 'view'"),
    ],
)
def test_values_that_no_mission_takes(three, options, message):
    with pytest.raises(UnsupportedOption, match=message):
        ct.plot(*three, **options)
    if "parts" not in options:
        return
    with pytest.raises(UnsupportedOption, match="only with a plan"):
        ct.plot(three[0], parts=["map", "loads"])


# -- the animation -------------------------------------------------------------------------------


@pytest.mark.filterwarnings("error")
def test_the_mission_moves(three, tmp_path):
    pytest.importorskip("PIL", reason="a GIF is written by Pillow")
    from PIL import Image

    model, plan = three
    animation = animate_mission(model, SimpleNamespace(plan=plan), frames=4, size=(3, 3))
    animation.save(tmp_path / "mission.gif", writer="pillow", dpi=50)
    with Image.open(tmp_path / "mission.gif") as image:
        assert image.n_frames == 4
        assert image.size == (150, 150)
    figure = animation._fig
    (chart,) = figure.axes
    assert f"t = {plan.end:.2f} s of {plan.end:.2f} s, 5 of 5 nodes visited" in words(figure)
    for way, one in zip(artists(chart, "path"), plan.trajectories, strict=True):
        assert way.get_xydata()[-1] == pytest.approx(one(one.times[-1]))
    animation._func(1)
    (robots,) = artists(chart, "robot")
    time = plan.end / 3
    for body, one in zip(robots.get_paths(), plan.trajectories, strict=True):
        box = body.get_extents()
        here = one(np.clip(time, one.times[0], one.times[-1]))
        assert (box.x0 + box.x1) / 2 == pytest.approx(here[0])
        assert box.width == pytest.approx(2 * model.radius, rel=1e-3)
    met = sum(int((when <= time).sum()) for when in plan.visits)
    assert f"t = {time:.2f} s of {plan.end:.2f} s, {met} of 5 nodes visited" in words(figure)
    assert not artists(chart, "path")[2].get_xydata().size
    for options, field in (
        ({"frames": 1}, "frames"), ({"interval": 0}, "interval"), ({"size": 3}, "size"),
    ):  # fmt: skip
        with pytest.raises(UnsupportedOption, match=f"^{field} must be "):
            animate_mission(model, plan, **options)
    with pytest.raises(InvalidData, match="routes"):
        animate_mission(mission(vehicles=1, nodes=[[9, 1]]), plan)


def test_moving_obstacles_and_the_timeline_are_drawn(three):
    """Discs have their true size, and the timeline shows distances from the depot."""
    _, plan = three
    cart = MovingObstacle(0.5, [0, 30], [[5, 0], [5, 10]])
    model = mission(moving=[cart], objective="makespan")
    figure = render(ct.plot(model, plan, parts=["map", "timeline"]))
    assert f"makespan {plan.end:.6g} s" in figure.get_suptitle()
    assert "moving obstacle at 0 s" in words(figure)
    (disc,) = artists(chart_of(figure), "moving obstacle")[0].get_paths()
    assert disc.get_extents().bounds == pytest.approx((4.5, -0.5, 1.0, 1.0), rel=1e-3)
    (panel,) = (axes for axes in figure.axes if "depot" in axes.get_ylabel())
    (drawn, *_) = (line for line in panel.lines if len(line.get_xdata()) > 100)
    away = np.hypot(*(plan.trajectories[0](drawn.get_xdata()) - model.depot).T)
    assert drawn.get_ydata() == pytest.approx(away)
    film = animate_mission(model, plan, frames=4)
    render(film._fig)
    film._func(1)
    (discs,) = artists(film._fig.axes[0], "moving obstacle")
    box = discs.get_paths()[0].get_extents()
    assert 0.5 * (box.min + box.max) == pytest.approx(cart(plan.end / 3), abs=1e-6)
