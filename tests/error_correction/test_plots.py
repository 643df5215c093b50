"""Pictures: what is drawn, without a display and without pyplot."""

import builtins
import subprocess
import sys

import numpy as np
import pytest

import crosstrack.models.plots as plots
from crosstrack import instances
from crosstrack.errors import BackendMissing, InvalidData, UnknownName, UnsupportedOption
from crosstrack.models import ErrorCorrectionRouting, MixedIntegerProgram, Route
from crosstrack.models.error_correction.plot import violated_stops
from crosstrack.models.plots import plot
from crosstrack.models.plots.labels import place_labels

BEST = Route((0, 1, 2, 4))
RED = "#C8102E"


@pytest.fixture
def model():
    return instances.load("error-correction/example-1")


def texts(figure):
    from matplotlib.text import Annotation

    return [found.get_text() for found in figure.findobj(Annotation)]


def words(figure):
    from matplotlib.legend import Legend

    return [text.get_text() for legend in figure.findobj(Legend) for text in legend.get_texts()]


def sawtooth(axes):
    return np.column_stack(axes.lines[0].get_data())


def test_a_route_and_its_errors(model):
    figure = plot(model, BEST)
    assert figure.get_suptitle() == "error-correction/example-1  ·  4.500 m  ·  2 corrections"
    assert texts(figure) == ["A (1)", "2", "3", "B (5)"]
    assert sorted(axes.name for axes in figure.axes) == ["3d", "rectilinear", "rectilinear"]
    assert {"start A", "horizontal correction", "vertical correction", "end B"} <= set(
        words(figure)
    )
    assert "rule broken" not in words(figure)


def test_errors_rise_and_fall(model):
    upper, lower = (axes for axes in plot(model, BEST).axes if axes.name != "3d")
    assert (upper.get_ylabel(), lower.get_ylabel()) == ("horizontal error", "vertical error")
    assert lower.get_xlabel() == "distance flown (m)"
    flown = [0, 0, 2, 2, 2.5, 2.5, 4.5, 4.5]
    assert sawtooth(upper)[:, 0] == pytest.approx(flown)
    assert sawtooth(upper)[:, 1] == pytest.approx([0, 0, 0.2, 0, 0.05, 0.05, 0.25, 0.25])
    assert sawtooth(lower)[:, 1] == pytest.approx([0, 0, 0.2, 0.2, 0.25, 0, 0.2, 0.2])


def test_thresholds_stand_at_each_stop():
    """Each error meets the limit of the kind of point where it arrives."""
    model = instances.load("error-correction/7")
    limits = {"horizontal": (20, 15), "vertical": (10, 20), "B": (20, 20)}
    route = Route((0, 89, 264, 159, 326))
    upper, lower = (axes for axes in plot(model, route).axes if axes.name != "3d")
    for column, axes in enumerate((upper, lower)):
        bars = [
            line.get_ydata()[0]
            for line in axes.lines[1:]
            if len(line.get_xdata()) == 2 and np.ptp(line.get_xdata()) > 0
        ]
        assert bars == [limits[str(model.kinds[k])][column] for k in route.route[1:]]
        assert axes.get_ylim()[1] > max(bars)


def test_kilometres_where_points_are_far_apart(tmp_path):
    model = instances.load("error-correction/1")
    figure = plot(model, Route((0, 10, 9, 2, 3, 14)))
    assert figure.get_suptitle() == "error-correction/1  ·  118.601 km  ·  4 corrections"
    space = next(axes for axes in figure.axes if axes.name == "3d")
    assert space.get_xlabel() == "x (km)"
    for suffix in ("png", "pdf", "svg"):
        figure.savefig(tmp_path / f"route.{suffix}")
        assert (tmp_path / f"route.{suffix}").stat().st_size > 10_000


def test_points_alone(model):
    figure = plot(model)
    assert [axes.name for axes in figure.axes] == ["3d"]
    assert texts(figure) == ["A (1)", "2", "3", "4", "B (5)"]
    assert "5 points" in figure.get_suptitle()
    crowd = instances.load("error-correction/7")
    assert texts(plot(crowd)) == []
    assert plot(crowd, Route(())).axes[0].name == "3d"


def test_a_flat_side_is_stretched_and_says_so():
    slab = instances.error_correction.uniform_slab(300, (25, 15, 20, 25, 30), seed=1)
    space = plot(slab).axes[0]
    assert space.get_zlabel() == "z (km, stretched ×3.0)"
    assert space.get_xlabel() == "x (km)"
    one = ErrorCorrectionRouting([[1, 1, 1]] * 2, ["A", "B"], 1, 1, 1, 1, 1, delta=1)
    plot(one, Route((0, 1))).canvas.draw()


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
    figure.canvas.draw()
    assert ("rule broken" in words(figure)) == bool(places)
    red = to_hex(figure._suptitle.get_color()) == RED.lower()
    assert red == bool(places)
    over = places and any(
        to_hex(line.get_color()) == RED.lower() for axes in figure.axes for line in axes.lines
    )
    thresholds = [check for check in model.verify(plan).violated if check.unit == "error"]
    assert bool(over) == bool(thresholds)


def test_red_is_what_the_verification_refuses():
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


def test_no_pyplot_and_no_display():
    code = (
        "import sys, crosstrack.models.plots as p, crosstrack.instances as i; "
        "assert 'matplotlib' not in sys.modules; "
        "p.plot(i.load('error-correction/1')).canvas.draw(); "
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, env={"MPLBACKEND": "TkAgg"})


def test_matplotlib_missing(model, monkeypatch):
    real = builtins.__import__

    def without(name, *rest):
        if name.startswith("matplotlib"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(BackendMissing, match=r"pip install 'crosstrack\[plot\]'"):
        plot(model)


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


def test_a_user_registers_a_picture(model, monkeypatch):
    monkeypatch.setattr(plots, "_REGISTERED", {})
    plots.register_plot("error-correction", lambda model, plan, **options: (model, plan, options))
    assert plot(model, BEST, anything=1) == (model, BEST, {"anything": 1})


def test_labels_hide_neither_one_another_nor_the_route():
    angles = np.linspace(0, 6, 30)
    points = np.column_stack([30 * angles, 60 * np.sin(angles)])
    offsets = place_labels(points, [14.0] * 30, height=8.0)
    centres = points + offsets
    for i in range(30):
        for j in range(i):
            apart = np.abs(centres[i] - centres[j])
            assert apart[0] >= 14 or apart[1] >= 8
    assert (np.abs(centres[:, None] - points[None]) > (7, 4)).any(axis=2).all()
    assert place_labels(np.zeros((0, 2)), []).shape == (0, 2)
