"""Curves of the slopes of a plan: recomputed, and drawn with the claimed slopes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..plots import kit
from .checks import SOME, Sample
from .model import AttractorAnalysis
from .plan import AttractorEstimate, Slope

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Curve", "curve_keys", "curves_of", "draw_curve", "draw_slopes", "dress", "slope_text"]

#: Number of steps ahead, and of radii, of the curves.
_STEPS, _RADII = 60, 48
#: Length of a divergence curve beyond its region, in widths of the region.
_BEYOND = 1.5
#: Colour of the scaling region, and line of the claimed slope.
_SHADE = "#E69F00"
_CLAIM: dict[str, Any] = {"color": kit.RED, "lw": 1.4, "ls": "--"}


class Curve(NamedTuple):
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


def slope_text(slope: Slope) -> str:
    """Return a slope with its deviation as text."""
    return f"{kit.number(slope.value, 4)} ± {kit.number(slope.deviation, 2)}"


def dress(axes: Axes, x: str, y: str) -> None:
    """Write the labels of a panel, and remove superfluous frames."""
    from matplotlib.ticker import MaxNLocator

    kit.label_axes(axes, x, y)
    kit.bare(axes)
    broad = float(axes.get_position().width) * kit.inches(axes.figure)[0]
    axes.xaxis.set_major_locator(MaxNLocator(nbins=int(np.clip(2 * broad, 3, 9))))


def curve_keys(view: str) -> list[Any]:
    """Return the entries of the legend of curves, or of their slopes."""
    from matplotlib.patches import Patch

    return [
        kit.key("computed again", lw=1.4, **kit.axis_style(0)),
        Patch(facecolor=_SHADE, alpha=0.25, label="scaling region"),
        kit.key("claimed" if view == "slopes" else "slope as claimed", **_CLAIM),
    ]


def curves_of(model: AttractorAnalysis, plan: AttractorEstimate) -> list[Curve]:
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
            Curve(
                "divergence", "λ", "nats/s", slope, ahead * model.period, sample.divergence(slope, ahead),
                (low * model.period, high * model.period),
                ("time ahead (s)", f"mean ln(distance{f' / {unit}' if unit else ''})"), False,
            )
        )  # fmt: skip
    slope = plan.correlation
    if slope is not None:
        least, most = sample.reach()
        radii = np.geomspace(min(least, slope.low), max(most, slope.high), _RADII)
        sums = sample.sums(radii)
        curves.append(
            Curve(
                "correlation", "D", "", slope, radii, np.where(sums > 0, np.log(sums), np.nan),
                (slope.low, slope.high), (kit.with_unit("radius r", model.unit), "ln C(r)"), True,
            )
        )  # fmt: skip
    return curves


def draw_curve(curve: Curve, axes: Axes) -> None:
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


def draw_slopes(curve: Curve, axes: Axes) -> None:
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


def _finish(curve: Curve, axes: Axes, label: str) -> None:
    """Shade the scaling region, and write the slope above the panel."""
    axes.axvspan(*curve.region, color=_SHADE, alpha=0.25, lw=0, zorder=0.7, gid="region")
    words = f"{curve.symbol} = {slope_text(curve.slope)} {curve.unit}".rstrip()
    axes.set_title(words, fontsize=8.5, color=kit.BLACK, loc="left", pad=3)
    dress(axes, curve.labels[0], label)
    if curve.log:
        axes.set_xscale("log")
        kit.log_ticks(axes.xaxis, curve.x[0], curve.x[-1])
