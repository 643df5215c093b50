"""The picture of a route: its points, its errors on the way, and the rules that it breaks."""

import numpy as np
import pytest
from pictures import artists, legend, render

from crosstrack import instances
from crosstrack.errors import InvalidData, UnknownName, UnsupportedOption
from crosstrack.models import ErrorCorrectionRouting, MixedIntegerProgram, Route
from crosstrack.models.error_correction.plot import violated_stops
from crosstrack.models.plots import plot

BEST = Route((0, 1, 2, 4))
RED = "#C8102E"


@pytest.fixture
def model():
    return instances.load("error-correction/example-1")


def texts(figure):
    from matplotlib.text import Annotation

    return [found.get_text() for found in figure.findobj(Annotation)]


def sawtooth(axes):
    (line,) = artists(axes, "curve " + axes.get_ylabel().partition("\n")[0])
    return np.column_stack(line.get_data())


def test_a_route_and_its_errors(model):
    figure = plot(model, BEST)
    assert figure.get_suptitle() == "error-correction/example-1  ·  4.500 m  ·  2 corrections"
    assert texts(figure) == ["A (1)", "2", "3", "B (5)"]
    assert sorted(axes.name for axes in figure.axes) == ["3d", "rectilinear", "rectilinear"]
    assert {"start A", "horizontal correction", "vertical correction", "end B"} <= set(
        legend(figure)
    )
    assert "rule broken" not in legend(figure)


def test_errors_rise_and_fall(model):
    upper, lower = (axes for axes in plot(model, BEST).axes if axes.name != "3d")
    assert (upper.get_ylabel(), lower.get_ylabel()) == (
        "horizontal error\n(–)",
        "vertical error\n(–)",
    )
    assert lower.get_xlabel() == "distance flown (m)"
    flown = [0, 0, 2, 2, 2.5, 2.5, 4.5, 4.5]
    assert sawtooth(upper)[:, 0] == pytest.approx(flown)
    assert sawtooth(upper)[:, 1] == pytest.approx([0, 0, 0.2, 0, 0.05, 0.05, 0.25, 0.25])
    assert sawtooth(lower)[:, 1] == pytest.approx([0, 0, 0.2, 0.2, 0.25, 0, 0.2, 0.2])


def test_thresholds_stand_at_each_stop():
    """Each error is drawn with the limit of its point's kind."""
    model = instances.load("error-correction/7")
    limits = {"horizontal": (20, 15), "vertical": (10, 20), "B": (20, 20)}
    route = Route((0, 89, 264, 159, 326))
    upper, lower = (axes for axes in plot(model, route).axes if axes.name != "3d")
    for column, axes in enumerate((upper, lower)):
        (drawn,) = artists(axes, "allowed there")
        bars = [float(bar[0, 1]) for bar in drawn.get_segments()]
        assert bars == [limits[str(model.kinds[k])][column] for k in route.route[1:]]
        assert axes.get_ylim()[1] > max(bars)


def test_distant_points_are_drawn_in_kilometres(tmp_path):
    model = instances.load("error-correction/1")
    figure = plot(model, Route((0, 10, 9, 2, 3, 14)))
    assert figure.get_suptitle() == "error-correction/1  ·  118.601 km  ·  4 corrections"
    space = next(axes for axes in figure.axes if axes.name == "3d")
    assert space.get_xlabel() == "x (km)"
    for suffix in ("png", "pdf", "svg"):
        figure.savefig(tmp_path / f"route.{suffix}", dpi=60)
        assert (tmp_path / f"route.{suffix}").stat().st_size > 10_000


def test_points_alone(model):
    figure = plot(model)
    assert [axes.name for axes in figure.axes] == ["3d"]
    assert texts(figure) == ["A (1)", "2", "3", "4", "B (5)"]
    assert "5 points" in figure.get_suptitle()
    crowd = instances.load("error-correction/7")
    assert texts(plot(crowd)) == []
    assert plot(crowd, Route(())).axes[0].name == "3d"


def test_a_stretched_flat_side_is_labelled():
    slab = instances.error_correction.uniform_slab(300, (25, 15, 20, 25, 30), seed=1)
    space = plot(slab).axes[0]
    assert space.get_zlabel() == "z (km, stretched ×3.0)"
    assert space.get_xlabel() == "x (km)"
    one = ErrorCorrectionRouting([[1, 1, 1]] * 2, ["A", "B"], 1, 1, 1, 1, 1, delta=1)
    render(plot(one, Route((0, 1))))


@pytest.mark.parametrize(
    ("route", "places"),
    [
        ((0, 1, 2, 4), []),
        ((0, 4), [1]),
        ((0, 2, 4), [2]),
        ((0, 1, 2), [2]),
        ((1, 2, 4), [0]),
        ((0, 1, 0, 2, 4), [2, 3, 4]),
        ((0, 1, 2, 1, 4), [3]),
        ((0,), [0]),
    ],
)
def test_broken_rules_are_drawn_in_red(model, route, places):
    from matplotlib.colors import to_hex

    plan = Route(route)
    assert violated_stops(model, model.walk(plan)) == places
    figure = plot(model, plan)
    assert ("rule broken" in legend(figure)) == bool(places)
    red = to_hex(figure._suptitle.get_color()) == RED.lower()
    assert red == bool(places)
    over = any(artists(axes, "rule broken") for axes in figure.axes if axes.name != "3d")
    bars = [artists(axes, "allowed there") for axes in figure.axes if axes.name != "3d"]
    shades = {to_hex(colour) for found in bars for colour in found[0].get_edgecolor()}
    assert over == (RED.lower() in shades)
    thresholds = [check for check in model.verify(plan).violated if check.unit == "error"]
    assert over == bool(thresholds)


def test_violations_are_red():
    rng = np.random.default_rng(1)
    seen = set()
    for seed in range(300):
        model = instances.error_correction.random_small(6, seed, revisits=seed % 2 == 0)
        inner = rng.integers(0, 6, rng.integers(0, 4)).tolist()
        route = Route((model.start, *inner, model.end) if seed % 5 else inner or (model.start,))
        found = model.verify(route)
        assert found.ok == (not violated_stops(model, model.walk(route)))
        seen.add(found.ok)
    assert seen == {True, False}


def test_what_cannot_be_drawn(model):
    with pytest.raises(InvalidData, match="plan must be a Route"):
        plot(model, "0-1-2")
    with pytest.raises(InvalidData, match=r"route\[1\]"):
        plot(model, Route((0, 9)))
    with pytest.raises(UnsupportedOption, match="no option 'color'; its options: labels, title"):
        plot(model, BEST, color="red")
    with pytest.raises(UnsupportedOption, match="size must be width and height"):
        plot(model, BEST, size=(0, 3))
    program = MixedIntegerProgram(
        cost=[1.0],
        matrix=[[1.0]],
        row_lower=[0],
        row_upper=[1],
        column_lower=[0],
        column_upper=[1],
        integral=[True],
    )
    with pytest.raises(UnknownName, match="picture of the model 'mixed-integer-program'"):
        plot(program)


def test_options(model):
    figure = plot(model, BEST, labels=False, title="Mine", size=(6, 3))
    assert texts(figure) == []
    assert figure.get_suptitle() == "Mine"
    assert figure.get_size_inches().tolist() == [6, 3]
