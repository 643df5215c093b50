"""Plot of an estimate: the angle and its error over time, above the measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from ..plots import kit
from .data import LOW_SPEED, Recording
from .model import SideslipEstimation
from .plan import SideslipEstimate

__all__ = ["animate_estimate", "draw"]

#: Number of parts of a long recording, each drawn by its minimum and maximum.
_PARTS = 1500
#: Largest number of further estimates, and the colour index of the truth, which follows theirs.
_MOST_OTHERS, _TRUTH = 5, 6
#: Limit (degrees) to which angles are clipped: an invalid plan may contain any value.
_BEYOND = 1e9
#: Largest visible height of the band beyond the curves, in heights of the curves: angle, error.
_REACH = (1.0, 5.0)
_BAND = "± 2 deviations"
_LOST = "grip lost"
_STILL = f"below {LOW_SPEED:g} m/s, no meaning"
#: Height of a tall and of a low panel with the gap below, and gap at the left (inch).
_TALL, _LOW, _GAP = 1.7, 1.0, 0.85
#: Estimates with their legend labels and colour indices.
_Estimates = Sequence[tuple[str, int, SideslipEstimate]]


class _Samples:
    """Samples to draw: all of a short recording, or the extremes of equal parts of a long one."""

    def __init__(self, recording: Recording) -> None:
        self.size = len(recording)
        parts = self.size if self.size <= 2 * _PARTS else _PARTS
        self.first = np.linspace(0, self.size, parts, endpoint=False).astype(np.int64)
        self.times = recording.times[self.first]
        self.end = float(recording.times[-1])
        self.moving = recording.moving

    def extremes(self, low: kit.Floats, high: kit.Floats) -> tuple[kit.Floats, kit.Floats]:
        """Return the minimum of `low` and the maximum of `high` in each part."""
        return np.fmin.reduceat(low, self.first), np.fmax.reduceat(high, self.first)

    def curve(self, name: str, colour: int, values: kit.Floats, width: float = 1.2) -> kit.Curve:
        """Return a curve through the extremes of each part."""
        if self.first.size == self.size:
            return kit.Curve(name, colour, self.times, values, width)
        both = np.column_stack(self.extremes(values, values)).ravel()
        return kit.Curve(name, colour, np.repeat(self.times, 2), both, width)

    def degrees(self, values: kit.Floats) -> kit.Floats:
        """Return angles (rad) in degrees, NaN for samples below 1 m/s."""
        bounded = np.clip(values, -_BEYOND, _BEYOND)
        return np.clip(np.where(self.moving, np.degrees(bounded), np.nan), -_BEYOND, _BEYOND)

    def rests(self) -> list[tuple[float, float]]:
        """Return the intervals (s) at rest. A part is at rest if more than half of its samples are."""
        count = np.diff(self.first, append=self.size)
        still = 2 * np.add.reduceat((~self.moving).astype(np.int64), self.first) > count
        return kit.true_intervals(still, np.append(self.times, self.end))


@kit.documented
def draw(
    model: SideslipEstimation, plan: SideslipEstimate | None = None, *,
    others: Mapping[str, Any] | None = None, tolerance: float = kit.TOLERANCE,
    title: str | None = None, size: tuple[float, float] | None = None,
) -> kit.Figure:  # fmt: skip
    """Draw the estimate `plan` over time, with the truth, if it is known, and the measurements.

    The angle is undefined below 1 m/s: its curves have gaps there, and the time is
    shaded. The error has a panel if the truth is known, and each of the four measurements has one.
    Recordings of more than 3000 samples are drawn by the extremes of 1500 parts.

    Parameters
    ----------
    model : SideslipEstimation
        The model. If its truth is hidden, as for backends, it is drawn as a model without truth.
    plan : SideslipEstimate, optional
        The estimate, drawn with a band of twice its claimed deviation. The times of `grip_lost` are
        shaded in red. If None, only the data is drawn.
    others : dict of str to plan, optional
        Up to 5 further estimates by legend label: plans, their JSON data or solutions.
    """
    if model.is_blinded:
        # Replace the hidden truth by None.
        hidden = model.hidden_fields()
        names = [field.name for field in fields(model) if field.name not in hidden]
        model = SideslipEstimation(**{name: getattr(model, name) for name in names})
    plans = kit.name_plans(
        model, plan, others, SideslipEstimate, name="estimate", most=_MOST_OTHERS,
        tolerance=tolerance,
    )  # fmt: skip
    labels = kit.label_plans(plans, plan if not others else None, unit="°", digits=3)
    # The first colour is reserved for `plan`, even if it is None.
    estimates = [
        (label, k + (plan is None), entry.plan)
        for k, (label, entry) in enumerate(zip(labels, plans, strict=True))
    ]
    result = None if plan is None else plans[0].result
    parts = [model.describe()]
    if plan is not None and result is not None:
        times = model.recording.times
        parts = [f"{kit.number(float(times[-1] - times[0]), 4)} s"]
        if result.objective is not None:
            error = f"{kit.number(result.objective, 3)}°"
            known = model.truth is not None
            parts.append(f"mean error {error}" if known else f"changes in a second off by {error}")
        if model.truth is not None:
            parts.append(f"{kit.number(100 * model.coverage(plan), 3)} % within 2 deviations")
    text = kit.title_of(model, parts, result, title)
    samples = _Samples(model.recording)
    rests = samples.rests()
    upper = _upper(model, samples, estimates, rests)
    tall = 0.73 + kit.LINE * (2 + text.count("\n")) + len(upper) * _TALL + 2 * _LOW
    scene = kit.Scene(text, result, size, (7.2, tall))
    angle = _draw_panels(scene, model, samples, plan, estimates, upper, rests)
    if plan is not None:
        rows = zip(model.recording.times, np.degrees(plan.sideslip), strict=True)
        kit.pin_places(angle, result, {f"sample {k}": row for k, row in enumerate(rows)})
    return scene.figure


def _draw_panels(
    scene: kit.Scene, model: SideslipEstimation, samples: _Samples, plan: SideslipEstimate | None,
    estimates: _Estimates, upper: Sequence[kit.Panel], rests: Any,
) -> Any:  # fmt: skip
    """Draw the panels below one legend, angle and error in full width, measurements in pairs; return the first."""
    from matplotlib.patches import Patch

    lower = _lower(model.recording, samples, rests)
    count, figure = len(upper), scene.figure
    gap = _GAP / max(0.5 * (scene.broad - 2 * _GAP), 0.1)
    heights = [_TALL] * count + [_LOW] * 2
    grid = figure.add_gridspec(count + 2, 2, height_ratios=heights, hspace=0.2, wspace=gap)
    places = [figure.add_subplot(grid[row, :]) for row in range(count)]
    places += [figure.add_subplot(grid[count + k // 2, k % 2]) for k in range(4)]
    span = [kit.Span("", float(samples.times[0]), samples.end)]
    for panel, axes in zip([*upper, *lower], places, strict=True):
        kit.draw_panel(panel, axes, span, wrong=False, mesh=False)
        axes.tick_params(labelbottom=axes in places[-2:])
    for axes in places[-2:]:
        kit.label_axes(axes, "time (s)")
    keys = [kit.key(label, lw=1.6, **kit.axis_style(colour)) for label, colour, _ in estimates]
    if model.truth is not None:
        keys.append(kit.key("truth", lw=2.2, **kit.axis_style(_TRUTH)))
    if plan is not None:
        for k, panel in enumerate(upper):
            _draw_band(places[k], panel, samples, plan, k)
        keys.append(Patch(facecolor=kit.colour_of(0), alpha=0.2, label=_BAND))
        for begin, end in plan.grip_lost:
            for axes in places[:count]:
                axes.axvspan(begin, end, color=kit.RED, alpha=0.12, lw=0, zorder=0.6, gid=_LOST)
        if plan.grip_lost:
            keys.append(Patch(facecolor=kit.RED, alpha=0.12, label=_LOST))
    keys += kit.keys_of(lower[:1], places) if rests else []
    broad, tall, top = scene.broad, scene.tall, scene.head - 0.12
    rows = kit.legend_rows(keys, broad)
    kit.legend_row(figure, keys, "upper center", (0.5, 1 - top / tall), rows=rows)
    figure.subplots_adjust(
        left=min(_GAP / broad, 0.25), right=max(1 - 0.15 / broad, 0.8), bottom=min(0.5 / tall, 0.25),
        top=max(1 - (top + 0.16 + kit.LINE * rows) / tall, 0.6),
    )  # fmt: skip
    figure.align_ylabels([*places[:count], *places[-4::2]])
    figure.align_ylabels(places[-3::2])
    return places[0]


def _upper(
    model: SideslipEstimation, samples: _Samples, estimates: _Estimates, rests: Any
) -> list[kit.Panel]:
    """Return the panels of the angle and, if the truth is known, of its error."""

    def panel(name: str, zero: Any, *first: kit.Curve) -> kit.Panel:
        # Draw the first estimate last, on top of all other curves.
        curves = [
            samples.curve(label, colour, samples.degrees(plan.sideslip - zero))
            for label, colour, plan in reversed(estimates)
        ]
        return kit.Panel(name, "°", [*first, *curves], shades={_STILL: rests})

    if model.truth is None:
        return [panel("sideslip angle", 0.0)] if estimates else []
    truth = samples.curve("truth", _TRUTH, samples.degrees(model.truth), 2.4)
    panels = [panel("sideslip angle", 0.0, truth), panel("error", model.truth)]
    return panels if estimates else panels[:1]


def _lower(recording: Recording, samples: _Samples, rests: Any) -> list[kit.Panel]:
    """Return the panels of the measurements."""
    measured = (
        ("yaw rate", "°/s", np.degrees(recording.yaw_rate)),
        ("lateral acceleration", "m/s^2", recording.lateral_acceleration),
        ("steering", "°", np.degrees(recording.steering)),
        ("speed", "m/s", recording.speed),
    )
    return [
        kit.Panel(name, unit, [samples.curve(name, _TRUTH, values, 0.8)], shades={_STILL: rests})
        for name, unit, values in measured
    ]


def _draw_band(
    axes: Any, panel: kit.Panel, samples: _Samples, plan: SideslipEstimate, row: int
) -> None:
    """Fill the band of the first estimate: about the angle in row 0, about zero error in row 1."""
    wide = 2 * samples.degrees(plan.deviation)
    middle = samples.degrees(plan.sideslip) if row == 0 else np.zeros(samples.size)
    lower, upper = samples.extremes(middle - wide, middle + wide)
    values = np.concatenate([curve.values for curve in panel.curves])
    least, most = float(np.nanmin(values)), float(np.nanmax(values))
    height = most - least
    reach = _REACH[row] * height if height > 0 else np.inf
    # Use quantiles of the band: a few samples with an unknown angle would stretch the axis.
    low = max(min(least, float(np.nanquantile(lower, 0.02))), least - reach)
    high = min(max(most, float(np.nanquantile(upper, 0.98))), most + reach)
    if high > low:
        axes.set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
    look: dict[str, Any] = {"color": kit.colour_of(0), "alpha": 0.2, "lw": 0, "zorder": 1.5}
    axes.fill_between(samples.times, lower, upper, gid="band", **look)
    for edge in (lower, upper) if row else ():  # visible if curves fill the panel
        axes.plot(samples.times, edge, color=kit.DARK, lw=0.5, zorder=3.5, gid="edge of the band")


@kit.animated(draw, SideslipEstimate)
def animate_estimate(model: SideslipEstimation, plan: SideslipEstimate | Any, figure: Any) -> Any:
    """Animate the picture of an estimate: a marker on every curve, over time."""
    return kit.curve_movers(figure), "t =", "s"
