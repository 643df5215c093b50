"""Pictures of attractors: the series, its states, and the curves of the slopes.

The panels are those by which Rosenstein et al. (1993) and Grassberger and Procaccia (1983) judge a scaling
region.
"""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..plots import kit
from ..verification import Verification
from .checks import SOME, Sample
from .model import AttractorAnalysis
from .plan import AttractorEstimate, Judgement, Slope

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["animate_states", "draw"]

#: Mean crossings shown of a series, and smallest and largest number of its samples.
_CROSSINGS, _LEAST, _MOST = 60, 300, 8000
#: Largest number of states drawn as a line or as dots.
_JOINED, _DOTS = 12_000, 6000
#: Number of states up to which dots are larger.
_FEW = 300
#: Mean step between samples, in deviations, below which states are drawn as a line.
_SMOOTH = 0.5
_WORDS = {
    Judgement.CHAOTIC: "linear noise is rejected, and nearby states part exponentially: chaotic",
    Judgement.REGULAR: "nearby states stay together: periodic or quasi-periodic",
    Judgement.NONLINEAR: "linear noise is rejected, but neither regular nor chaotic motion is shown",
    Judgement.NOISE: "linear noise is not rejected: it may explain the series as well",
}
#: Margins above, below and left of all panels, and gaps between them (inch).
_HEAD, _FOOT, _LEFT, _GAP, _ROW_GAP, _RIGHT = 0.55, 0.55, 0.75, 0.8, 0.72, 0.15
#: Width below which the series is drawn beside the attractor instead of above all; width of a letter (inch).
_NARROW, _LETTER = 7.0, 0.062
#: Number of steps ahead, and of radii, of the curves.
_STEPS, _RADII = 60, 48
#: Length of a divergence curve beyond its region, in widths of the region.
_BEYOND = 1.5
#: Colour of the scaling region, and line of the claimed slope.
_SHADE = "#E69F00"
_CLAIM: dict[str, Any] = {"color": kit.RED, "lw": 1.4, "ls": "--"}


@kit.documented
@np.errstate(all="ignore")  # overflows become NaN, which is drawn as a gap
def draw(
    model: AttractorAnalysis,
    plan: AttractorEstimate | None = None,
    *,
    view: str = "curves",
    tolerance: float = kit.TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.Figure:
    """Draw the series of `model`, and the claims of `plan`.

    The series is drawn from its beginning, over the duration that is legible. The attractor has the first
    two or three coordinates of the embedding as its axes; without a plan the delay is one sample. Curves
    are recomputed on up to 500 states. The result of the surrogate test is written below the panels.

    Parameters
    ----------
    view : {"curves", "slopes", "attractor"}
        The curves with their fitted lines; the local slopes of these curves, which are level in a scaling
        region; or the attractor only.
    """
    from matplotlib.patches import Patch

    kit.check_choice("view", view, "curves", "slopes", "attractor")
    result = kit.verified_plan(model, plan, AttractorEstimate, tolerance)
    curves: list[_Curve] = []
    delay, dimension = 1, 2
    if plan is not None:
        delay, dimension = plan.delay, plan.dimension
        if view != "attractor":
            curves = curves_of(model, plan)
    checks = () if result is None else result.checks
    text = kit.title_of(model, _parts(model, plan, result), result, title)
    default = (5.2, 5.2) if view == "attractor" else (9.6, 5.4 if curves else 3.9)
    scene = kit.Scene(text, result, size, default)
    lines = textwrap.wrap(_verdict(plan), max(int((scene.broad - 0.2) / _LETTER), 20))
    foot = 0.25 * bool(curves)
    places = _places(scene, view, len(curves), dimension, below=foot + 0.15 * len(lines))
    _draw_states(model, places[0], delay)
    if view != "attractor":
        _draw_series(model, places[1])
    for curve, axes in zip(curves, places[2:], strict=True):
        (_draw_slopes if view == "slopes" else _draw_curve)(curve, axes)
        middle = sum(curve.region) / 2
        line: Any = axes.lines[0]
        height = np.interp(middle, *line.get_data())
        name = "correlation" if curve.log else "exponent"
        places_of = {c.where: (middle, height) for c in checks if c.name.startswith(name)}
        kit.pin_places(axes, result, places_of)
    if lines:
        place = (0.5, (0.08 + foot) / scene.tall)
        scene.figure.text(*place, "\n".join(lines), ha="center", va="bottom", fontsize=8)
    keys = [
        kit.key("computed again", lw=1.4, **kit.axis_style(0)),
        Patch(facecolor=_SHADE, alpha=0.25, label="scaling region"),
        kit.key("claimed" if view == "slopes" else "slope as claimed", **_CLAIM),
    ]
    scene.legend(keys if curves else [], 1)
    return scene.figure


def _parts(
    model: AttractorAnalysis, plan: AttractorEstimate | None, result: Verification | None
) -> list[str]:
    """Return the parts of the title."""
    if plan is None or result is None:
        return [model.describe()]
    parts = [f"delay {plan.delay}, dimension {plan.dimension}"]
    if plan.exponent is not None:
        parts.append(f"λ = {_slope_text(plan.exponent)} nats/s")
    if plan.correlation is not None:
        parts.append(f"D = {_slope_text(plan.correlation)}")
    if (spectrum := plan.spectrum) is not None:
        values = ", ".join(kit.number(value, 3) for value in spectrum.values)
        parts.append(f"λ = {values} nats/s ({spectrum.resolved} resolved)")
        if (dimension := spectrum.kaplan_yorke) is not None:
            parts.append(
                "Kaplan-Yorke dimension {} ± {}".format(
                    *(kit.number(x, 2 + (x == dimension[0])) for x in dimension)
                )
            )
    if result.objective is not None:
        truth = (model.true_exponent, model.true_dimension, model.chaotic)
        known = any(value is not None for value in truth)
        what = "relative error" if known else "error of prediction"
        parts.append(f"{what} {kit.number(result.objective, 3)}")
    return parts


def _verdict(plan: AttractorEstimate | None) -> str:
    if plan is None or plan.surrogates is None:
        return str((plan and plan.measures) or "")
    test = plan.surrogates
    few = "none" if not test.exceeded else str(test.exceeded)
    return (
        f"{_WORDS[test.judgement]} (p\u00a0=\u00a0{kit.number(test.p_value, 3)}: {few} of {test.count} surrogates "
        "at least as predictable)"
    )


def _places(
    scene: kit.Scene, view: str, curves: int, dimension: int, *, below: float
) -> list[Axes]:
    """Return the axes of the attractor, the series and the curves."""
    figure, broad, tall = scene.figure, scene.broad, scene.tall
    head = _HEAD + kit.LINE * scene.title.count("\n")
    left, right = min(_LEFT / broad, 0.2), max(1 - _RIGHT / broad, 0.85)
    bottom, top = min((_FOOT + below) / tall, 0.4), max(1 - head / tall, 0.6)
    edges: dict[str, Any] = {"left": left, "right": right, "bottom": bottom, "top": top}
    narrow = broad < _NARROW and curves > 0
    space: dict[str, Any] = {}
    if dimension > 2 and not narrow:
        space = {"projection": "3d", "computed_zorder": False}
    if view == "attractor":
        return [figure.add_subplot(figure.add_gridspec(1, 1, **edges)[0], **space)]
    columns = 2 if narrow or not curves else curves + 1
    rows = 2 if curves else 1
    # Gaps are given as shares of the mean width and height of the cells.
    wide = (right - left) * broad - _GAP * (columns - 1)
    high = (top - bottom) * tall - _ROW_GAP * (rows - 1)
    edges["wspace"] = _GAP * columns / max(wide, 0.5)
    edges["hspace"] = _ROW_GAP * rows / max(high, 0.5)
    if not curves:
        grid = figure.add_gridspec(1, 2, width_ratios=(1.8, 1.1), **edges)
        first, *others = grid[1], grid[0]
    elif narrow:
        grid = figure.add_gridspec(2, 2, **edges)
        lower = [grid[1, :]] if curves == 1 else [grid[1, 0], grid[1, 1]]
        first, *others = grid[0, 1], grid[0, 0], *lower
    else:
        grid = figure.add_gridspec(2, columns, height_ratios=(1, 1.8), **edges)
        first, *others = grid[1, 0], grid[0, :], *(grid[1, k + 1] for k in range(curves))
    states = figure.add_subplot(first, **space)
    if space:
        # The labels of 3D axes are inside of their area, so it can extend into the margins of others.
        box = states.get_position()
        x, y = (0.5 if first.colspan.start else 0.65) / broad, 0.3 / tall
        wide, high = box.width + x - 0.1 / broad, box.height + 1.6 * y
        states.set_position((box.x0 - x, box.y0 - y, wide, high))
    return [states, *(figure.add_subplot(place) for place in others)]


# -- series and states ---------------------------------------------------------------------------


def _draw_series(model: AttractorAnalysis, axes: Axes) -> None:
    """Draw the beginning of the series, or all of a short one."""
    count = len(model.series)
    above = model.series > np.median(model.series)
    crossings = max(int(np.count_nonzero(above[1:] != above[:-1])), 1)
    shown = min(int(np.clip(_CROSSINGS * count / crossings, _LEAST, _MOST)), count)
    times = np.arange(shown) * model.period
    look: dict[str, Any] = {"marker": "o", "ms": 2.0, "mew": 0} if shown <= _LEAST else {}
    axes.plot(times, model.series[:shown], lw=0.9, gid="series", **kit.axis_style(0), **look)
    edge = 0.01 * times[-1]
    axes.set_xlim(-edge, times[-1] + edge)
    _dress(axes, "time (s)", kit.with_unit("value", model.unit))
    if shown < count:
        words = f"the first {shown} of {count} samples"
        axes.set_title(words, fontsize=7.5, color="#505050", loc="left", pad=3)


def _draw_states(model: AttractorAnalysis, axes: Any, delay: int) -> None:
    """Draw the first two or three coordinates, depending on `axes`, as a line if the series is smooth."""
    shown = 3 if axes.name == "3d" else 2
    series = model.series
    if len(series) <= (shown - 1) * delay + 1:
        delay = 1
    states = model.states(delay, shown)[:, :shown]
    look: dict[str, Any] = {"color": kit.colour_of(0), "gid": "states"}
    if float(np.sqrt((np.diff(series / model.deviation) ** 2).mean())) < _SMOOTH:
        axes.plot(*states[:_JOINED].T, lw=0.5, alpha=0.8, **look)
    else:
        step = max(-(-len(states) // _DOTS), 1)
        large = 2.4 if len(states) > _FEW else 4.5
        axes.plot(*states[::step].T, ls="", marker=".", ms=large, mew=0, alpha=0.7, **look)
    names = [
        "x(t)",
        *(f"x(t + {kit.number(k * delay * model.period, 4)} s)" for k in range(1, shown)),
    ]
    names = [kit.with_unit(name, model.unit) for name in names]
    if shown == 2:
        _dress(axes, *names)
        return
    kit.dress_space(axes)
    for name, axis in zip(names, "xyz", strict=True):
        getattr(axes, f"set_{axis}label")(name, fontsize=7.5, labelpad=1)
    axes.tick_params(labelsize=6.5)


# -- the curves of the slopes --------------------------------------------------------------------


class _Curve(NamedTuple):
    """Curve with its claimed slope: name, symbol and unit of the slope, and the slope.

    `x` are seconds ahead or radii, `y` mean logarithms, both of shape (k,), and `region` is the scaling region in
    the unit of `x`. The slope is relative to the logarithm of `x` if `log`.
    """

    name: str
    symbol: str
    unit: str
    slope: Slope
    x: kit.Floats
    y: kit.Floats
    region: tuple[float, float]
    labels: tuple[str, str]
    log: bool

    def read(self, x: kit.Floats) -> kit.Floats:
        """Return the variable of the slope's derivative: `x` or its logarithm."""
        return np.log(x) if self.log else x


def _slope_text(slope: Slope) -> str:
    """Return a slope with its deviation as text."""
    return f"{kit.number(slope.value, 4)} ± {kit.number(slope.deviation, 2)}"


def _dress(axes: Axes, x: str, y: str) -> None:
    """Write the labels of a panel, and remove superfluous frames."""
    from matplotlib.ticker import MaxNLocator

    kit.label_axes(axes, x, y)
    kit.bare(axes)
    broad = float(axes.get_position().width) * kit.inches(axes.figure)[0]
    axes.xaxis.set_major_locator(MaxNLocator(nbins=int(np.clip(2 * broad, 3, 9))))


def curves_of(model: AttractorAnalysis, plan: AttractorEstimate) -> list[_Curve]:
    """Return the curves of the claimed slopes, recomputed on up to 500 states."""
    states = model.states(plan.delay, plan.dimension)
    sample = Sample(states, plan.theiler, model.scene_seeds(1)[0], SOME)
    unit = kit.pretty_unit(model.unit)
    curves = []
    slope = plan.exponent
    if slope is not None:
        low, high = int(slope.low), int(slope.high)
        last = min(high + int(_BEYOND * (high - low)) + 2, max(high, len(states) // 2))
        steps = np.linspace(0, last, _STEPS).round().astype(np.int64)
        ahead = np.unique(np.concatenate([steps, [low, high]]))
        curves.append(
            _Curve(
                "divergence", "λ", "nats/s", slope, ahead * model.period, sample.divergence(slope, ahead),
                (low * model.period, high * model.period),
                ("time ahead (s)", f"mean ln(distance{f' / {unit}' if unit else ''}) (–)"), False,
            )
        )  # fmt: skip
    slope = plan.correlation
    if slope is not None:
        least, most = sample.reach()
        radii = np.geomspace(min(least, slope.low), max(most, slope.high), _RADII)
        sums = sample.sums(radii)
        curves.append(
            _Curve(
                "correlation", "D", "", slope, radii, np.where(sums > 0, np.log(sums), np.nan),
                (slope.low, slope.high), (kit.with_unit("radius r", model.unit), "ln C(r) (–)"), True,
            )
        )  # fmt: skip
    return curves


def _draw_curve(curve: _Curve, axes: Axes) -> None:
    """Draw the curve, and the line with the claimed slope through its mean in the region."""
    axes.plot(curve.x, curve.y, lw=1.4, zorder=3, gid=f"curve {curve.name}", **kit.axis_style(0))
    low, high = curve.region
    x = curve.read(curve.x)
    inside = (curve.x >= low) & (curve.x <= high) & np.isfinite(curve.y)
    if inside.any():
        ends = np.array([low, high])
        middle, height = x[inside].mean(), curve.y[inside].mean()
        line = height + curve.slope.value * (curve.read(ends) - middle)
        axes.plot(ends, line, gid=f"line {curve.name}", zorder=4, **_CLAIM)
    _finish(curve, axes, curve.labels[1])


def _draw_slopes(curve: _Curve, axes: Axes) -> None:
    """Draw the local slopes of the curve, and the claimed slope."""
    local = np.gradient(curve.y, curve.read(curve.x))
    axes.plot(curve.x, local, lw=1.4, zorder=3, gid=f"slopes {curve.name}", **kit.axis_style(0))
    value, spread = curve.slope.value, curve.slope.deviation
    axes.plot(curve.region, [value] * 2, gid=f"line {curve.name}", **_CLAIM)
    known = local[np.isfinite(local)]
    if known.size:
        # The slopes of the first steps and the smallest radii would flatten all others.
        ends = [*np.quantile(known, [0.1, 0.9]).tolist(), 0.0, value - spread, value + spread]
        margin = 0.15 * (max(ends) - min(ends)) or 1.0
        axes.set_ylim(min(ends) - margin, max(ends) + margin)
    label = "slope of ln distance" if curve.unit else "slope of ln C(r)"
    _finish(curve, axes, kit.with_unit(label, curve.unit))


def _finish(curve: _Curve, axes: Axes, label: str) -> None:
    """Shade the scaling region, and write the slope above the panel."""
    axes.axvspan(*curve.region, color=_SHADE, alpha=0.25, lw=0, zorder=0.7, gid="region")
    words = f"{curve.symbol} = {_slope_text(curve.slope)} {curve.unit}".rstrip()
    axes.set_title(words, fontsize=8.5, color=kit.BLACK, loc="left", pad=3)
    _dress(axes, curve.labels[0], label)
    if curve.log:
        axes.set_xscale("log")
        kit.log_ticks(axes.xaxis, curve.x[0], curve.x[-1])


@kit.animated(draw, AttractorEstimate)
def animate_states(model: AttractorAnalysis, plan: AttractorEstimate | Any, figure: Any) -> Any:
    """Animate the picture of an estimate: the state on the attractor, and its sample of the series."""
    lines: dict[Any, Any] = {line.get_gid(): line for axes in figure.axes for line in axes.lines}
    times, values = lines["series"].get_data()
    space, shown = lines["states"].axes, 3 if lines["states"].axes.name == "3d" else 2
    # As in the picture, the delay of a short series is 1.
    fits = len(model.series) > (shown - 1) * plan.delay + 1
    states = model.states(plan.delay if fits else 1, shown)[: len(times), :shown]
    samples = np.column_stack([times, values])
    places = ((space, states), (lines["series"].axes, samples))
    return [_stepwise(axes, times[: len(rows)], rows) for axes, rows in places], "t =", "s"


def _stepwise(axes: Any, times: kit.Floats, places: kit.Floats) -> kit.Mover:
    """Return a marker that stays at each place until the next: states of a map have no path between them."""
    rows = np.repeat(np.arange(len(times)), 2)
    return kit.Mover(axes, times[rows[1:]], places[rows[:-1]], kit.RED)
