"""The kit that every problem's picture is made of, and the verb that finds a picture."""

import builtins
import itertools
import os
import subprocess
import sys

import numpy as np
import pytest
from pictures import artists, heights, legend

import crosstrack.models.plots as plots
from crosstrack import instances
from crosstrack.errors import BackendMissing, UnsupportedOption
from crosstrack.models import Route
from crosstrack.models.plots import options, plot
from crosstrack.models.plots.curves import Curve, Limit, Mark, Panel, Span
from crosstrack.models.plots.layers import place_labels
from crosstrack.models.plots.panels import panel_sheet
from crosstrack.models.plots.style import number, pretty_unit

BEST = Route((0, 1, 2, 4))


@pytest.fixture
def model():
    return instances.load("error-correction/example-1")


def test_no_pyplot_and_no_display():
    """No picture of any problem opens a window or leaves a trace in pyplot."""
    code = (
        "import sys, crosstrack as ct; from crosstrack.models import MinimumSnap, SatelliteSlew; "
        "models = ct.load('error-correction/1'), MinimumSnap([[0, 0, 0], [1, 1, 1]], [0, 1]); "
        "assert 'matplotlib' not in sys.modules; "
        "figures = [*map(ct.plot, models), ct.plot(SatelliteSlew(), view='axis')]; "
        "[figure.draw_without_rendering() for figure in figures]; "
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run(
        [sys.executable, "-c", code], check=True, env=os.environ | {"MPLBACKEND": "TkAgg"}
    )


def test_matplotlib_missing(model, monkeypatch):
    real = builtins.__import__

    def without(name, *rest):
        if name.startswith("matplotlib"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(BackendMissing, match=r"pip install 'crosstrack\[plot\]'"):
        plot(model)


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


def test_numbers_and_units_for_people():
    assert number(6566.4812) == "6566.48"
    assert number(-1.5) == "−1.5"
    assert number(1.234567e9) == "1.23457×10⁹"
    assert number(2e-7) == "2×10⁻⁷"
    assert pretty_unit("m/s^2") == "m/s²"
    assert pretty_unit("m²/s^11") == "m²/s¹¹"
    assert pretty_unit("m") == "m"


# -- options -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("check", "message"),
    [
        (lambda: options.check_size((0, 3), (1, 1)), r"size must be width.* got \(0, 3\)"),
        (lambda: options.check_size("big", (1, 1)), "size must be width .* got 'big'"),
        (lambda: options.check_size((1, 101), (1, 1)), "each > 0 and <= 100"),
        (lambda: options.check_flags(mesh=True, paths=1), "paths must be True or False, got 1"),
        (lambda: options.check_list("axes", "xy", str.isalpha, "hold x"), "axes must hold x"),
        (lambda: options.check_list("axes", 0, bool, "hold x"), "got 0"),
        (lambda: options.check_list("axes", [1, 1], bool, "hold x"), r"got \[1, 1\]"),
        (lambda: options.check_list("axes", [], bool, "hold x"), "got"),
        (lambda: options.check_list("axes", (1, 2), bool, "hold x", most=1), "got"),
    ],
)
def test_option_values_that_are_not_allowed(check, message):
    with pytest.raises(UnsupportedOption, match=message):
        check()


def test_option_values_that_are_allowed():
    assert options.check_size(None, (2.0, 1.0)) == (2.0, 1.0)
    assert options.check_size([3, np.float64(4)], (2.0, 1.0)) == (3.0, 4.0)
    assert options.check_list(
        "axes", iter([2, 0]), lambda one: options.is_whole(one, 0, 2), ""
    ) == [2, 0]
    assert options.is_whole(np.int64(3), 0, 3)
    assert not options.is_whole(True, 0, 3)
    assert not options.is_whole(2.0, 0, 3)


# -- panels --------------------------------------------------------------------------------------

TIMES = np.linspace(0.0, 2.0, 201)


def sheet(*panels, wrong=True, spans=(("", 0.0, 2.0),), **more):
    own = [Span(*span, np.array([0.0, 1.0, 2.0])) for span in spans]
    return panel_sheet(panels, own, title="t", wrong=wrong, columns=1, label="time (s)", **more)


def rings(figure):
    return [one.get_data() for axes in figure.axes for one in artists(axes, "worst violation")]


def test_the_worst_violation_is_ringed():
    rise = Curve("x", 0, TIMES, TIMES)
    limit = Limit(np.array([0.0, 1.0, 1.0, 2.0]), -np.inf, np.array([0.2, 0.2, 1.9, 1.9]), (), 0.05)
    (ring,) = rings(sheet(Panel("x", "", [rise], [limit])))
    # By 0.8 shortly before the step at 1 s, and by 0.1 only at the end.
    assert [float(part[0]) for part in ring] == pytest.approx([0.99, 0.99])
    assert rings(sheet(Panel("x", "", [rise], [limit]), wrong=False)) == []
    assert rings(sheet(Panel("x", "", [rise], [limit._replace(tolerance=0.9)]))) == []
    assert rings(sheet(Panel("x", "", [rise], [limit._replace(colours=(1,))]))) == []


def test_a_limit_of_the_next_phase_does_not_bind_the_one_before():
    before = Curve("m", 0, TIMES[:101], 5.0 - TIMES[:101])
    after = Curve("m", 0, TIMES[100:], 2.0 - TIMES[100:])
    limit = Limit(np.array([1.0, 2.0]), 0.0, 1.5, (), 1e-6)
    assert rings(sheet(Panel("m", "t", [before, after], [limit]))) == []


def test_distant_limits_are_labelled():
    curve = Curve("x", 0, TIMES, np.sin(TIMES))
    far = Limit(TIMES[[0, -1]], -1e6, 1e6)
    (axes,) = sheet(Panel("x", "m/s^2", [curve], [far])).axes
    assert axes.get_title(loc="left") == "limit ±1×10⁶"
    assert axes.get_ylabel() == "x\n(m/s²)"
    assert heights(axes) == []
    (axes,) = sheet(Panel("x", "", [curve], [far], whole=True)).axes
    assert heights(axes) == [-1e6, 1e6]
    steps = Limit(np.array([0.0, 1.0, 1.0, 2.0]), -np.inf, np.array([50.0, 50, 70, 70]))
    (axes,) = sheet(Panel("x", "", [curve], [steps])).axes
    assert axes.get_title(loc="left") == "≤ 50 … 70"
    # If a limit applies to two of three curves, its label names them.
    three = [curve._replace(name=name, colour=k) for k, name in enumerate("abc")]
    (axes,) = sheet(Panel("x", "", three, [far._replace(colours=(0, 2), lower=-np.inf)])).axes
    assert axes.get_title(loc="left") == "a, c ≤ 1×10⁶"


def test_names_stand_once_where_all_panels_have_the_same():
    pair = [Curve(name, k, TIMES, TIMES + k) for k, name in enumerate("xy")]
    figure = sheet(Panel("position", "m", pair), Panel("velocity", "m/s", pair), mesh=False)
    assert legend(figure) == ["x", "y"]
    assert [axes.get_legend() for axes in figure.axes] == [None, None]
    figure = sheet(Panel("position", "m", pair), Panel("velocity", "m/s", pair[:1]), mesh=False)
    assert legend(figure) == []
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == ["x", "y"]
    many = [Curve(f"x{k}", k, TIMES, TIMES) for k in range(9)]
    figure = sheet(*[Panel(name, "", many) for name in "ab"], mesh=False)
    assert legend(figure) == [*(f"x{k}" for k in range(6)), "… 9 in all"]


def test_a_custom_mark_is_drawn_and_labelled():
    curve = Curve("x", 0, TIMES, TIMES)
    marks = [
        Mark("lamp", np.array([1.0]), np.array([4.0]), 2, {"marker": "^"}, note="too bright"),
        Mark("node", TIMES, TIMES),
    ]
    figure = sheet(Panel("x", "", [curve], marks=marks))
    (axes,) = figure.axes
    (lamp,) = artists(axes, "lamp")
    assert lamp.get_marker() == "^"
    assert axes.get_ylim()[1] > 4
    assert axes.get_title(loc="right") == "too bright"
    assert legend(figure) == ["lamp", "node", "knot of the mesh"]
    # Too many nodes in a panel are not told apart.
    crowd = sheet(Panel("x", "", [curve], marks=[marks[1], marks[1]]))
    assert legend(crowd) == ["knot of the mesh"]


def test_ticks_tell_neighbours_apart():
    for low, high in ((0.0, 1400.0), (1e7, 1e7 + 1e-3), (-1e-9, 1e-9)):
        curve = Curve("x", 0, TIMES, np.linspace(low, high, TIMES.size))
        (axes,) = sheet(Panel("x", "", [curve])).axes
        axes.figure.draw_without_rendering()
        told = [tick.get_text() for tick in axes.get_yticklabels()]
        assert len(set(told)) == len(told) > 2
        assert not (high == 1400.0 and any("×" in one for one in told))


def outside(figure, artist):
    """Return how far an artist extends beyond a picture to its left and right, in pixels."""
    box = artist.get_window_extent()
    return max(figure.bbox.x0 - box.x0, box.x1 - figure.bbox.x1)


@pytest.mark.parametrize("size", [(11.5, 5.4), (7.0, 5.0), (5.0, 4.0)])
@pytest.mark.parametrize("dpi", [55, 150])
def test_a_small_picture_cuts_off_no_legend_and_no_point(model, size, dpi):
    figure = plot(model, BEST, size=size)
    figure.set_dpi(dpi)
    figure.draw_without_rendering()
    left, right = figure.subfigs
    for part in (left, right):
        assert all(outside(part, entry) <= 0 for entry in part.legends)
    (space,) = left.axes
    names = [text for text in space.texts if text.get_text()]
    assert {text.get_text() for text in names} >= {"A (1)", "B (5)"}
    assert all(outside(left, text) <= 0 for text in names)


def test_a_legend_that_fits_keeps_its_size(model):
    sizes = [
        {entry.get_texts()[0].get_fontsize() for part in plot(model, BEST, size=size).subfigs for entry in part.legends}
        for size in ((11.5, 5.4), (5.0, 4.0))
    ]  # fmt: skip
    assert sizes[0] == {7.5}
    assert min(sizes[1]) < 7.5


def test_labels_beside_panels_do_not_overlap():
    rise = Curve("x", 0, TIMES, TIMES)
    figure = sheet(*[Panel("acceleration of the robot", "m/s²", [rise])] * 5, size=(5.0, 4.0))
    figure.draw_without_rendering()
    boxes = [axes.yaxis.label.get_window_extent() for axes in figure.axes]
    assert all(lower.y1 <= upper.y0 for upper, lower in itertools.pairwise(boxes))


def test_the_docstring_of_a_picture_describes_every_parameter():
    def draw(model, plan=None, *, width=1, title=None):
        """Draw it.

        Parameters
        ----------
        width : int
            Points.
        """

    def animate(model, plan, *, frames=2, title=None):
        """Animate it."""

    def unclear(model, *, width=1):
        """Draw it."""

    draw.__annotations__ = {"model": "GridPath", "plan": "Route | None"}
    text = options.documented(draw).__doc__
    assert text.startswith("Draw it.\n\nParameters\n----------\nmodel : GridPath\n")
    assert "\nplan : Route, optional\n" in text
    assert "\nwidth : int\n    Points.\ntitle : str, optional\n" in text
    assert "\nReturns\n-------\nmatplotlib.figure.Figure\n" in text
    animate.__annotations__ = {"model": "GridPath", "plan": "Route | Any"}
    text = options.documented(animate).__doc__
    assert "\nplan : Route or Solution\n" in text and '.save("animate.gif"' in text
    with pytest.raises(KeyError, match="width"):
        options.documented(unclear)
    unclear.__doc__ = None  # as of ``python -OO``
    assert options.documented(unclear) is unclear and unclear.__doc__ is None
