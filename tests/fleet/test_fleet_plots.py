"""Figures of routes: drawn data equal those of the model and the plan."""

import itertools

import numpy as np
import pytest
from pictures import artists, legend, render, words

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.models import FleetRouting
from crosstrack.models.fleet import FleetPlan
from crosstrack.models.grid_path import GridMap

POINTS = np.array([[0, 0], [3, 0], [3, 4], [0, 4], [-6, 0], [-6, 8]], float)


@pytest.fixture(scope="module")
def six():
    model = FleetRouting(2, points=POINTS, battery=[13.0, 100.0], name="six")
    return model, FleetPlan([[1, 2, 3], [4, 5]])


@pytest.fixture(scope="module")
def walled():
    """A wall between two nodes; the way around it is longer."""
    grid = GridMap(["......", ".@@@@.", "......"], cell=2.0, upward=True)
    points = grid.centres([[0, 2], [2, 2], [2, 3]])
    return FleetRouting(1, points=points, map=grid, name="wall"), FleetPlan([[1, 2]])


def routes(axes):
    (found,) = artists(axes, "route")
    return [np.asarray(one) for one in found.get_segments()]


def length(line):
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def bars(axes):
    """Length and colour of every bar, from the top."""
    (found,) = artists(axes, "load")
    boxes = [path.get_extents() for path in found.get_paths()]
    order = np.argsort([box.y0 for box in boxes])
    return [boxes[k].width for k in order], [tuple(found.get_facecolor()[k, :3]) for k in order]


def test_what_is_drawn(six, tmp_path):
    model, plan = six
    figure = ct.plot(model, plan)
    figure.savefig(tmp_path / "fleet.png", dpi=40)
    chart, panel = figure.axes
    assert chart.get_aspect() == 1
    drawn = routes(chart)
    for line, route in zip(drawn, plan.routes, strict=True):
        assert line.tolist() == POINTS[[0, *route, 0]].tolist()
    loads = [14.0, 24.0]
    widths, colours = bars(panel)
    assert widths == pytest.approx(loads)
    (lines,) = artists(chart, "route")
    assert [tuple(row[:3]) for row in lines.get_colors()] == colours
    (nodes,) = artists(chart, "node")
    assert nodes.get_offsets().tolist() == POINTS[1:].tolist()
    faces = [tuple(row[:3]) for row in nodes.get_facecolors()]
    assert faces == [colours[0]] * 3 + [colours[1]] * 2
    (depot,) = artists(chart, "depot")
    assert depot.get_offsets().tolist() == [[0, 0]]
    (mean,) = artists(panel, "mean")
    assert mean.get_xdata() == pytest.approx([19, 19])
    (band,) = artists(panel, "deviation")
    assert band.get_extents().width > 0
    assert band.get_x() == pytest.approx(19 - np.std(loads, ddof=1))
    assert band.get_width() == pytest.approx(2 * np.std(loads, ddof=1))
    # Vehicle 0 goes beyond its battery; the other's is too far away to be drawn.
    (limit,) = artists(panel, "limit")
    assert [ends[:, 0].tolist() for ends in limit.get_segments()] == [[13, 13]]
    assert "NOT VALID: route within battery" in figure.get_suptitle()
    assert figure.get_suptitle().startswith("six  ·  2 vehicles, 5 nodes, max 24 m, sum 38 m")
    written = words(figure)
    assert {"vehicle 0", "vehicle 1", "14", "24", "0", "5"} <= set(written)
    assert {"limit 100, out of sight", "limit broken", "depot", "node"} <= set(legend(figure))
    edges = artists(panel, "load")[0].get_edgecolors()
    assert edges[0, 3] == 1
    assert len(edges) == 2
    assert edges[1, 3] == 0


def test_parts_of_it(six):
    model, plan = six
    (chart,) = render(ct.plot(model, plan, parts=["routes"], labels=False)).axes
    assert not chart.texts
    figure = render(ct.plot(model, plan, parts=["loads"], title="mine", size=(4, 2)))
    assert figure.get_suptitle() == "mine"
    assert figure.get_size_inches().tolist() == [4, 2]
    assert bars(figure.axes[0])[0] == pytest.approx([14, 24])
    assert {"vehicle 0", "vehicle 1"} <= set(legend(ct.plot(model, plan, parts=["routes"])))
    (alone,) = render(ct.plot(model)).axes
    assert not routes(alone)
    assert legend(ct.plot(model)) == ["depot", "node"]
    within = ct.plot(model, plan, tolerance=0.1)
    assert "NOT VALID" not in within.get_suptitle()


def test_legs_avoid_blocked_cells(walled, tmp_path):
    model, plan = walled
    figure = ct.plot(model, plan)
    figure.savefig(tmp_path / "map.png", dpi=40)
    chart = figure.axes[0]
    (line,) = routes(chart)
    assert length(line) == pytest.approx(model.verify(plan).objective)
    cells = model.map.cells_of(line)
    assert model.map.holds(cells).all()
    stops = model.points[[0, 1, 2, 0]]
    places = [int(np.flatnonzero((line == stop).all(axis=1))[0]) for stop in stops[:-1]]
    assert places == sorted(places)
    assert line[-1].tolist() == stops[-1].tolist()
    straight = ct.plot(model, plan, legs="straight").axes[0]
    assert routes(straight)[0].tolist() == stops.tolist()
    (image,) = chart.images
    assert (image.get_array() == model.map.blocked).all()
    assert list(image.get_extent()) == [0, 12, 0, 6]
    assert "blocked" in legend(figure)
    assert chart.get_ylim()[0] < chart.get_ylim()[1]


def test_maps_of_text_have_row_0_at_the_top(walled):
    grid = GridMap(["......", ".@@@@.", "......"])
    model = FleetRouting(1, points=grid.centres([[0, 0], [2, 2]]), map=grid, metric="euclidean")
    chart = ct.plot(model, FleetPlan([[1]])).axes[0]
    assert chart.get_ylim()[0] > chart.get_ylim()[1]
    assert len(routes(chart)[0]) == 3
    assert len(routes(ct.plot(model, FleetPlan([[1]]), legs="paths").axes[0])[0]) > 5


def test_costs_are_scaled_to_a_plane(six):
    apart = np.hypot(*(POINTS[:, None] - POINTS[None]).transpose(2, 0, 1))
    model = FleetRouting(2, costs=apart)
    figure = render(ct.plot(model, six[1]))
    chart, panel = figure.axes
    assert chart.get_xlabel() == "costs scaled to a plane, axis 1 (–)"
    for line, route in zip(routes(chart), six[1].routes, strict=True):
        ways = itertools.pairwise([0, *route, 0])
        steps = np.hypot(*np.diff(line, axis=0).T)
        assert steps == pytest.approx([apart[way] for way in ways])
    assert not artists(chart, "way")
    assert panel.get_xlabel() == "cost of route (–)"
    uneven = FleetRouting(2, costs=np.triu(apart) + 2 * np.tril(apart))
    assert len(artists(ct.plot(uneven, six[1]).axes[0], "way")) == 7


def test_nodes_that_are_missed_or_met_twice_are_ringed(six):
    figure = render(ct.plot(six[0], FleetPlan([[1, 2, 2], [5, 0]])))
    (rings,) = artists(figure.axes[0], "not visited once")
    assert rings.get_offsets().tolist() == POINTS[[0, 2, 3, 4]].tolist()
    assert "each node visited once" in figure.get_suptitle()
    assert "not visited once" in legend(figure)
    with pytest.raises(InvalidData, match=r"routes\[0\]\[0\] must be in 0 … 5"):
        ct.plot(six[0], FleetPlan([[6], []]))


@pytest.mark.parametrize(
    "routes_", [[], [[]], [[], []], [[1, 2, 3, 4, 5]], [[1], [2], [3, 4, 5]], [[0, 0, 0], [1] * 50]]
)
def test_plans_that_are_far_from_valid_are_drawn(six, routes_):
    figure = render(ct.plot(six[0], FleetPlan(routes_)))
    assert "NOT VALID" in figure.get_suptitle()


@pytest.mark.parametrize(
    "model",
    [
        FleetRouting(1, points=[[0, 0], [0, 0]]),
        FleetRouting(1, points=[[1e9, 1e9], [1e9 + 1, 1e9]], battery=0.0),
        FleetRouting(1, points=[[0, 0], [1e-6, 0]], objective="range"),
        FleetRouting(1, costs=[[0, 0], [0, 0]]),
        FleetRouting(1, costs=[[0, 1e6], [1e-6, 0]]),
        FleetRouting(1, points=[[k, 0] for k in range(200)], depots=[7]),
        FleetRouting(1, points=[[0.5, 0.5], [0.5, 0.5]], map=GridMap(["."])),
        FleetRouting(40, points=[[k % 7, k // 7] for k in range(41)], battery=9.0),
    ],
)
@pytest.mark.filterwarnings("error")
def test_strange_fleets_are_drawn(model, tmp_path):
    render(ct.plot(model))
    shares = np.array_split(model.customers, model.vehicles)
    plan = FleetPlan([share.tolist() for share in shares])
    figure = ct.plot(model, plan)
    figure.savefig(tmp_path / "routes.png", dpi=30)
    loads = [sum(model.distances[a, b] for a, b in itertools.pairwise([h, *r, h]))
             for h, r in zip(model.homes, plan.routes, strict=True)]  # fmt: skip
    assert bars(figure.axes[1])[0] == pytest.approx(loads)


def test_costs_between_many_nodes_have_no_map():
    count = 1501
    costs = np.abs(np.subtract.outer(np.arange(count), np.arange(count))).astype(float)
    model = FleetRouting(1, costs=costs)
    plan = FleetPlan([range(1, count)])
    (panel,) = render(ct.plot(model, plan)).axes
    assert bars(panel)[0] == [2.0 * (count - 1)]
    with pytest.raises(UnsupportedOption, match="costs of up to 1500 nodes, got 1501"):
        ct.plot(model, plan, parts=["routes"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"parts": ["loads", "tours"]}, "parts must hold some of 'routes', 'loads'"),
        ({"parts": "routes"}, "parts must hold"),
        ({"parts": []}, "parts must hold"),
        ({"legs": "curved"}, "legs must be 'paths' or 'straight', got 'curved'"),
        ({"legs": "paths"}, "only if the model has a map"),
        ({"labels": "yes"}, "labels must be True or False"),
        ({"tolerance": 0}, "tolerance must"),
        ({"size": (0, 1)}, "size must be"),
        ({"zoom": True}, "no option 'zoom'"),
    ],
)
def test_values_that_no_picture_of_routes_takes(six, options, message):
    with pytest.raises(UnsupportedOption, match=message):
        ct.plot(*six, **options)


def test_bars_need_a_plan(six):
    with pytest.raises(UnsupportedOption, match="only with a plan"):
        ct.plot(six[0], parts=["loads"])
