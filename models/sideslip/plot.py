"""Plot of an estimate: the angle and its error over time, above the measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fields import required
from ..plots.curves import Curve, Panel, Span
from ..plots.options import check_option
from ..plots.panels import draw_panel, keys_of
from ..plots.style import (
    DARK,
    axis_style,
    headline,
    inches,
    key,
    legend_row,
    number,
    sheet,
    title_of,
)
from ..verification import TOLERANCE, Verification, check_tolerance
from .data import LOW_SPEED, Recording
from .model import SideslipEstimation
from .plan import SideslipEstimate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw"]

Floats = NDArray[np.float64]

#: Number of parts of a long recording, each drawn by its minimum and maximum.
_PARTS = 1500
#: Largest number of further estimates, and the colour index of the truth, which follows theirs.
_MOST_OTHERS, _TRUTH = 5, 6
#: Limit (degrees) to which angles are clipped: an invalid plan may contain any value.
_BEYOND = 1e9
#: Largest visible height of the band beyond the curves, in heights of the curves: angle, error.
_REACH = (1.0, 5.0)
_BAND = "± 2 deviations"
_STILL = f"below {LOW_SPEED:g} m/s, no meaning"
#: Inches: height of a tall and of a low panel with the gap below, gap at the left, line of text.
#: The last entry is the number of letters per inch.
_TALL, _LOW, _GAP, _LINE, _LETTERS = 1.7, 1.0, 0.85, 0.17, 13.0


class _Named(NamedTuple):
    """Estimate with its legend label and colour index."""

    label: str
    colour: int
    plan: SideslipEstimate


class _Drawn:
    """Samples to draw: all of a short recording, or the extremes of equal parts of a long one."""

    def __init__(self, recording: Recording) -> None:
        self.size = len(recording)
        parts = self.size if self.size <= 2 * _PARTS else _PARTS
        self.first = np.linspace(0, self.size, parts, endpoint=False).astype(np.int64)
        self.times = recording.times[self.first]
        self.end = float(recording.times[-1])
        self.moving = recording.moving

    def extremes(self, low: Floats, high: Floats) -> tuple[Floats, Floats]:
        """Return the minimum of `low` and the maximum of `high` in each part."""
        return np.fmin.reduceat(low, self.first), np.fmax.reduceat(high, self.first)

    def curve(self, name: str, colour: int, values: Floats, width: float = 1.2) -> Curve:
        """Return a curve through the extremes of each part."""
        if self.first.size == self.size:
            return Curve(name, colour, self.times, values, width)
        both = np.column_stack(self.extremes(values, values)).ravel()
        return Curve(name, colour, np.repeat(self.times, 2), both, width)

    def degrees(self, values: Floats) -> Floats:
        """Return angles (rad) in degrees, NaN for samples below 1 m/s."""
        held = np.clip(values, -_BEYOND, _BEYOND)
        return np.clip(np.where(self.moving, np.degrees(held), np.nan), -_BEYOND, _BEYOND)

    def rests(self) -> list[tuple[float, float]]:
        """Return the intervals (s) at rest. A part is at rest if more than half of its samples are."""
        count = np.diff(self.first, append=self.size)
        still = 2 * np.add.reduceat((~self.moving).astype(np.int64), self.first) > count
        edges = np.diff(np.concatenate([[False], still, [False]]).astype(np.int8))
        times = np.append(self.times, self.end)
        begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        return [(float(times[a]), float(times[b])) for a, b in zip(begins, ends, strict=True)]


def draw(
    model: SideslipEstimation,
    plan: SideslipEstimate | None = None,
    *,
    others: Mapping[str, Any] | None = None,
    tolerance: float = TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> Figure:
    """Draw the estimate `plan` over time, with the truth, if it is known, and the measurements.

    The angle is undefined below 1 m/s: its curves have gaps there, and the time is
    shaded. Recordings of more than 3000 samples are drawn by the extremes of 1500 parts.

    Parameters
    ----------
    model : SideslipEstimation
        The model. If its truth is hidden, as for backends, it is drawn as a model without truth.
    plan : SideslipEstimate, optional
        The estimate, drawn with a band of twice its claimed deviation. If None, only the data is drawn.
    others : dict of str to plan, optional
        Up to 5 further estimates by legend label: plans, their JSON data or solutions.
    tolerance : float
        Largest relative violation at which the title reports a plan as valid.
    title : str, optional
        Title. The default is the name, the mean error and the share of errors within two deviations.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.figure.Figure
        One panel of the angle, one of its error if the truth is known, and four of the measurements.

    Raises
    ------
    InvalidData
        A plan does not fit this model.
    UnsupportedOption
        An option has a value that is not allowed.
    """
    check_tolerance(tolerance)
    named = {} if others is None else others
    good = isinstance(named, Mapping) and all(isinstance(name, str) for name in named)
    few = good and len(named) <= _MOST_OTHERS
    check_option("others", others, few, f"be at most {_MOST_OTHERS} plans by their names")
    model = _visible(model)
    given = {} if plan is None else {"estimate": plan}
    estimates: list[_Named] = []
    found = None
    for name, value in [*given.items(), *named.items()]:
        one = required("plan", model.as_plan(value), SideslipEstimate)
        checked = model.verify(one, tolerance=tolerance)
        label = _label(name, checked) if named else name
        # The first colour is reserved for `plan`, even if it is None.
        estimates.append(_Named(label, len(estimates) + (plan is None), one))
        found = checked if estimates[-1].colour == 0 else found
    text = _title(model, plan, found) if title is None else title
    figure = _figure(model, estimates, text, size)
    headline(figure, text, wrong=found is not None and not found.ok)
    return figure


def _visible(model: SideslipEstimation) -> SideslipEstimation:
    """Return the model, with a hidden truth replaced by None."""
    if not model.is_blinded:
        return model
    hidden = model.hidden_fields()
    names = [field.name for field in fields(model) if field.name not in hidden]
    return SideslipEstimation(**{name: getattr(model, name) for name in names})


def _label(name: str, checked: Verification) -> str:
    value = "" if checked.objective is None else f", {number(checked.objective, 3)}°"
    return name + value + ("" if checked.ok else ", NOT VALID")


def _title(
    model: SideslipEstimation, plan: SideslipEstimate | None, found: Verification | None
) -> str:
    if plan is None or found is None:
        return title_of(model.name, [model.describe()], None)
    times = model.recording.times
    parts = [f"{number(float(times[-1] - times[0]), 4)} s"]
    if found.objective is not None:
        error = f"{number(found.objective, 3)}°"
        known = model.truth is not None
        parts.append(f"mean error {error}" if known else f"changes in a second off by {error}")
    if model.truth is not None:
        parts.append(f"{number(100 * model.coverage(plan), 3)} % within 2 deviations")
    return title_of(model.name, parts, found)


def _figure(model: SideslipEstimation, estimates: Sequence[_Named], text: str, size: Any) -> Figure:
    """Draw the panels below one legend: angle and error in full width, measurements in pairs."""
    from matplotlib.patches import Patch

    drawn = _Drawn(model.recording)
    rests = drawn.rests()
    upper = _upper(model, drawn, estimates, rests)
    lower = _lower(model.recording, drawn, rests)
    count, lines = len(upper), text.count("\n")
    figure = sheet(size, (7.2, 0.9 + _LINE * (lines + 1) + count * _TALL + 2 * _LOW))
    broad, tall = inches(figure)
    gap = _GAP / max(0.5 * (broad - 2 * _GAP), 0.1)
    heights = [_TALL] * count + [_LOW] * 2
    grid = figure.add_gridspec(count + 2, 2, height_ratios=heights, hspace=0.2, wspace=gap)
    places = [figure.add_subplot(grid[row, :]) for row in range(count)]
    places += [figure.add_subplot(grid[count + k // 2, k % 2]) for k in range(4)]
    span = [Span("", float(drawn.times[0]), drawn.end, np.empty(0))]
    for panel, axes in zip([*upper, *lower], places, strict=True):
        draw_panel(panel, axes, span, wrong=False, mesh=False)
        axes.tick_params(labelbottom=axes in places[-2:])
    for axes in places[-2:]:
        axes.set_xlabel("time (s)", fontsize=8.5)
    main = next((one for one in estimates if one.colour == 0), None)
    keys = [key(one.label, lw=1.6, **axis_style(one.colour)) for one in estimates]
    if model.truth is not None:
        keys.append(key("truth", lw=2.2, **axis_style(_TRUTH)))
    if main is not None:
        for k, panel in enumerate(upper):
            _draw_band(places[k], panel, drawn, main, k)
        keys.append(Patch(facecolor=axis_style(0)["color"], alpha=0.2, label=_BAND))
    keys += keys_of(lower[:1], places) if rests else []
    letters = sum(8 + len(one.get_label()) for one in keys)
    rows = min(len(keys), 1 + int(letters / (_LETTERS * broad)))
    top = 0.34 + _LINE * lines
    legend_row(figure, keys, "upper center", (0.5, 1 - top / tall), rows=rows)
    figure.subplots_adjust(
        left=min(_GAP / broad, 0.25), right=max(1 - 0.15 / broad, 0.8), bottom=min(0.5 / tall, 0.25),
        top=max(1 - (top + 0.16 + _LINE * rows) / tall, 0.6),
    )  # fmt: skip
    figure.align_ylabels([*places[:count], *places[-4::2]])
    figure.align_ylabels(places[-3::2])
    return figure


# -- panels --------------------------------------------------------------------------------------


def _upper(
    model: SideslipEstimation, drawn: _Drawn, estimates: Sequence[_Named], rests: Any
) -> list[Panel]:
    """Return the panels of the angle and, if the truth is known, of its error."""
    truth, shades = model.truth, {_STILL: rests}
    # Draw the first estimate last, on top of all other curves.
    angles = [
        drawn.curve(label, colour, drawn.degrees(plan.sideslip))
        for label, colour, plan in reversed(estimates)
    ]
    if truth is None:
        return [Panel("sideslip angle", "°", angles, shades=shades)] if angles else []
    angles.insert(0, drawn.curve("truth", _TRUTH, drawn.degrees(truth), 2.4))
    errors = [
        drawn.curve(label, colour, drawn.degrees(plan.sideslip - truth))
        for label, colour, plan in reversed(estimates)
    ]
    panels = [
        Panel("sideslip angle", "°", angles, shades=shades),
        Panel("error", "°", errors, shades=shades),
    ]
    return panels if errors else panels[:1]


def _lower(recording: Recording, drawn: _Drawn, rests: Any) -> list[Panel]:
    """Return the panels of the measurements."""
    measured = (
        ("yaw rate", "°/s", np.degrees(recording.yaw_rate)),
        ("lateral acceleration", "m/s^2", recording.lateral_acceleration),
        ("steering", "°", np.degrees(recording.steering)),
        ("speed", "m/s", recording.speed),
    )
    return [
        Panel(name, unit, [drawn.curve(name, _TRUTH, values, 0.8)], shades={_STILL: rests})
        for name, unit, values in measured
    ]


def _draw_band(axes: Axes, panel: Panel, drawn: _Drawn, main: _Named, row: int) -> None:
    """Fill the band of the first estimate: about the angle in row 0, about zero error in row 1."""
    wide = 2 * drawn.degrees(main.plan.deviation)
    middle = drawn.degrees(main.plan.sideslip) if row == 0 else np.zeros(drawn.size)
    lower, upper = drawn.extremes(middle - wide, middle + wide)
    held = np.concatenate([curve.values for curve in panel.curves])
    held = held[np.isfinite(held)]
    least, most = float(held.min()), float(held.max())
    height = most - least
    reach = _REACH[row] * height if height > 0 else np.inf
    # Use quantiles of the band: a few samples with an unknown angle would stretch the axis.
    low = max(min(least, float(np.nanquantile(lower, 0.02))), least - reach)
    high = min(max(most, float(np.nanquantile(upper, 0.98))), most + reach)
    if high > low:
        axes.set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
    look: dict[str, Any] = {"color": axis_style(0)["color"], "alpha": 0.2, "lw": 0, "zorder": 1.5}
    axes.fill_between(drawn.times, lower, upper, gid="band", **look)
    for edge in (lower, upper) if row else ():  # visible if curves fill the panel
        axes.plot(drawn.times, edge, color=DARK, lw=0.5, zorder=3.5, gid="edge of the band")
