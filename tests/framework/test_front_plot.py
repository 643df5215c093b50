"""Pictures of fronts: points, steps, bounds and what is proven."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from pictures import artists, legend, render, words

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.models import FleetRouting, MixedIntegerProgram
from crosstrack.models.plots.front import draw_front

MODEL = FleetRouting(2, points=[[0, 0], [3, 0], [0, 4], [5, 5]], objective="sum", name="four")


def point(second, objective, bound=None, proven=False):
    return SimpleNamespace(
        second=second, objective=objective, limit=second + 1.0, proven=proven,
        solution=SimpleNamespace(dual_bound=bound),
    )  # fmt: skip


def front(*points, dominated=(), second="max", field="battery"):
    return SimpleNamespace(
        model=MODEL, second=second, points=points, dominated=dominated, field=field
    )


def linear_program():
    """Return a linear program with a maximised objective and one row to trade it with."""
    return MixedIntegerProgram(
        cost=[-1.0, -2.0], matrix=[[1.0, 1.0]], row_lower=[-np.inf], row_upper=[4.0],
        column_lower=[0.0, 0.0], column_upper=[3.0, 3.0], integral=[False, False], maximise=True,
    )  # fmt: skip


def xy(axes, gid):
    return np.concatenate([line.get_xydata() for line in artists(axes, gid)]).tolist()


def test_points_steps_and_bounds(tmp_path):
    found = front(
        point(52, 85, 80), point(40, 100, 100, True), point(45, 92, 92, True), point(75, 80, 10),
        point(60, 84), dominated=(point(55, 90),),
    )  # fmt: skip
    figure = draw_front(found)
    figure.savefig(tmp_path / "front.png", dpi=40)
    (axes,) = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("max (m)", "sum (m)")
    assert xy(axes, "proven") == [[40, 100], [45, 92]]
    assert xy(axes, "not proven") == [[52, 85], [60, 84], [75, 80]]
    assert xy(axes, "dominated") == [[55, 90]]
    assert xy(axes, "bound") == [[40, 100], [45, 92], [52, 80]]
    assert xy(axes, "bound out of sight") == [[75, 0]]
    low, high = axes.get_xlim()
    assert low < 40 < 75 < high
    assert axes.get_ylim()[0] < 80
    (steps,) = artists(axes, "steps")
    assert steps.get_drawstyle() == "steps-post"
    assert steps.get_xydata()[1:-1].tolist() == [[40, 100], [45, 92], [52, 85], [60, 84], [75, 80]]
    assert steps.get_xydata()[[0, -1]].tolist() == [[40, axes.get_ylim()[1]], [high, 80]]
    assert "four  ·  2 vehicles, 3 nodes, sum" in words(figure)
    assert {"(40, 100)", "(75, 80)"} <= set(words(figure))
    assert legend(figure) == [
        "proven", "not proven", "proven bound", "bound out of sight", "dominated",
    ]  # fmt: skip


def test_points_above_the_steps_are_dominated():
    rng = np.random.default_rng(4)
    x = np.sort(rng.random(9))
    y = np.sort(rng.random(9))[::-1]
    (axes,) = draw_front(front(*map(point, x, y))).axes
    steps = artists(axes, "steps")[0].get_xydata()
    for a, b in rng.random((400, 2)) * 1.1:
        if not axes.get_xlim()[0] < a < axes.get_xlim()[1]:
            continue
        # The height of the steps at a: that of the last point at or left of it.
        row = int(np.searchsorted(steps[:, 0], a, side="right")) - 1
        height = steps[row, 1] if row >= 0 else math.inf
        assert (b >= height) == bool(((x <= a) & (y <= b)).any())


def test_several_fronts_beside_one_another():
    both = {
        "exact": front(point(1, 5, 5, True), point(2, 3, 3, True)),
        "rival": front(point(1.5, 6), dominated=(point(3, 7),)),
        "nothing": front(),
    }
    figure = render(draw_front(both, size=(5, 3), title="mine"))
    (axes,) = figure.axes
    colours = [line.get_color() for line in artists(axes, "steps")]
    assert len(set(colours)) == len(colours) == 2
    names = legend(figure)
    assert names[:3] == ["exact", "rival", "nothing"]
    assert figure.get_suptitle() == "mine"
    assert figure.get_size_inches().tolist() == [5, 3]
    assert "(1, 5)" not in words(figure)
    assert {"(1, 5)", "(1.5, 6)"} <= set(words(draw_front(both, labels=True)))
    assert "(1, 5)" not in words(draw_front(both["exact"], labels=False))
    assert draw_front(both, unit="").axes[0].get_xlabel() == "max (–)"


def test_a_sweep_names_its_values_and_has_no_bounds():
    """A proof for a weighted sum is not a bound on either objective."""
    found = front(
        point(9, 5, 4, True), point(7, 6, 4), dominated=(point(8, 7, 4),), field="q", second="deviation"
    )  # fmt: skip
    figure = render(draw_front(found))
    (axes,) = figure.axes
    assert not artists(axes, "bound")[0].get_xydata().size
    assert {"q = 10", "q = 8", "q = 9"} <= set(words(figure))
    assert legend(figure) == ["proven for its q", "not proven", "dominated"]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("deviation (m)", "objective (m)")
    found.first = "sum"
    assert draw_front(found).axes[0].get_ylabel() == "sum (m)"


def test_a_computed_front_is_drawn():
    places = [[0, 0], [4, 0], [5, 5], [5, -5], [-1, 1], [-2, -1]]
    found = ct.front(FleetRouting(2, points=places, objective="sum"), "max", step=1e-6)
    figure = render(ct.plot(found))
    (axes,) = figure.axes
    pairs = [[point.second, point.objective] for point in found.points]
    assert len(pairs) == 3
    assert xy(axes, "proven") == sorted(pairs)
    assert xy(axes, "bound") == [
        pytest.approx([point.second, point.solution.dual_bound]) for point in found.points[::-1]
    ]
    assert ct.plot({"one": found, "two": found}, labels=False).axes
    with pytest.raises(UnsupportedOption, match="no option 'zoom'"):
        ct.plot(found, zoom=True)


@pytest.mark.parametrize(
    "points",
    [
        [point(0, 0)],
        [point(3, 7, 7, True)] * 3,
        [point(1e9, 1e-9), point(1e9 + 1, 0.0, -1e9)],
        [point(1, 1, -math.inf), point(2, math.nan), point(math.inf, 0)],
        [point(1e6 * k, 1e-6 * (200 - k)) for k in range(200)],
        [point(1, 1 + 1e-15), point(2, 1)],
    ],
)
@pytest.mark.filterwarnings("error")
def test_strange_fronts_are_drawn(points, tmp_path):
    figure = draw_front(front(*points))
    figure.savefig(tmp_path / "front.png", dpi=30)
    (axes,) = figure.axes
    finite = [p for p in points if math.isfinite(p.objective) and math.isfinite(p.second)]
    assert len(xy(axes, "proven") + xy(axes, "not proven")) == len(finite)


@pytest.mark.parametrize(
    ("fronts", "options", "error", "message"),
    [
        (front(), {}, InvalidData, "at least one point"),
        ({}, {}, InvalidData, "at least one point"),
        (
            {"a": front(point(1, 1)), "b": front(point(1, 1), second="sum")},
            {},
            InvalidData,
            "same second objective",
        ),
        (front(point(1, 1)), {"labels": 1}, UnsupportedOption, "labels must be True or False"),
        (front(point(1, 1)), {"size": 1}, UnsupportedOption, "size must be"),
    ],
)
def test_fronts_that_cannot_be_drawn(fronts, options, error, message):
    with pytest.raises(error, match=message):
        draw_front(fronts, **options)


def test_a_maximised_objective_is_drawn_as_the_author_states_it(tmp_path):
    points = point(1, -2, -3), point(3, -6, -6, True), point(2, -4, -900)
    trade = front(*points, second="row", field="row_upper")
    trade.model = linear_program()
    figure = draw_front(trade)
    figure.savefig(tmp_path / "front.png", dpi=30)
    (axes,) = figure.axes
    assert xy(axes, "proven") == [[3, 6]] and xy(axes, "not proven") == [[1, 2], [2, 4]]
    assert xy(axes, "bound") == [[1, 3], [3, 6]] and xy(axes, "bound out of sight") == [[2, 1]]
    low, high = axes.get_ylim()
    assert low < 2 and high > 6
    assert xy(axes, "steps")[0] == [1, low]
    assert {"(1, 2)", "(2, 4)", "(3, 6)"} <= set(words(figure))
