"""Figure of an error-correction route: the path in space, and its errors.

The left panel shows the points by kind and the route through them, the right panels both errors
against the distance flown. An error increases with the distance and is reset by a correction; a bar at
each stop marks the largest error allowed on arrival. The errors are worst-case errors.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import show
from ..plots.curves import Curve, Mark, Panel, Span
from ..plots.labels import write_names
from ..plots.options import check_flags
from ..plots.panels import draw_panels
from ..plots.space import dots, dress_space, space_axes
from ..plots.style import (
    BLACK,
    DARK,
    GREY,
    RED,
    RING,
    axis_style,
    headline,
    key,
    legend_below,
    sheet,
)
from ..verification import TOLERANCE
from .model import ErrorCorrectionRouting, Route, Stop
from .points import KIND_WORDS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw", "violated_stops"]

#: Colour numbers of the kinds; the markers differ as well.
_NUMBERS = {"A": 6, "horizontal": 0, "vertical": 1, "B": 6}
_COLOURS = {word: axis_style(number)["color"] for word, number in _NUMBERS.items()}
_MARKERS = {"A": ">", "horizontal": "o", "vertical": "^", "B": "s"}
_LEGEND = dict(
    zip(_MARKERS, ("start A", "horizontal correction", "vertical correction", "end B"), strict=True)
)

#: Largest number of labels drawn by default.
_MOST_LABELS = 45
#: Smallest side of the box relative to the longest; shorter sides are stretched.
_FLATTEST = 0.3


def draw(
    model: ErrorCorrectionRouting,
    plan: Route | None = None,
    *,
    labels: bool | None = None,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> Figure:
    """Draw the points of `model`, and `plan` with its errors.

    Parameters
    ----------
    model : ErrorCorrectionRouting
        The model.
    plan : Route, optional
        A route; stops that break a rule are drawn in red. None draws the points only.
    labels : bool, optional
        Whether to write the names of the visited points, or of all points without a plan. By
        default, up to 45 names are written.
    title : str, optional
        Title; by default the name, the length and the number of corrections.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.figure.Figure
        The figure, with three axes, or one without a plan.

    Raises
    ------
    InvalidData
        The plan is not a route, or names a point that does not exist.
    UnsupportedOption
        An option has an invalid value.
    """
    if plan is not None and not isinstance(plan, Route):
        raise InvalidData(f"plan must be a Route, got {show(plan)}", field="plan")
    stops = [] if plan is None else model.walk(plan)
    if labels is None:
        labels = (len(stops) or len(model.points)) <= _MOST_LABELS
    check_flags(labels=labels)
    figure = sheet(size, (11.5, 5.4) if stops else (6.4, 5.4))
    scale, unit = _scale(model, stops)
    bad = violated_stops(model, stops)
    text = _title(model, stops, bad, scale, unit) if title is None else title
    left: Any = figure
    if stops:
        halves: Any = figure.subfigures(1, 2, width_ratios=[1.15, 1.0], wspace=0.0)
        left, right = halves
        _errors(model, stops, bad, right, text, scale, unit)
    space = space_axes(left, (0.0, 0.1, 0.96, 0.83))
    _space(model, stops, bad, space, scale, unit)
    legend_below(left, _kind_keys(model, any(stop.suspect for stop in stops), bool(bad)))
    if labels:
        named = list(dict.fromkeys(stop.point for stop in stops)) or list(range(len(model.points)))
        texts = [_name(model, point) for point in named]
        places = model.points[named] * scale
        write_names(space, places, texts, size=7.5, colour=BLACK, route=bool(stops))
    headline(figure, text, wrong=bool(bad))
    return figure


def violated_stops(model: ErrorCorrectionRouting, stops: list[Stop]) -> list[int]:
    """Return the indices of the stops that violate a constraint, ascending.

    Violations are thresholds exceeded by more than the tolerance of a verification, a route that does
    not begin at A, does not end at B or passes through either, and a forbidden revisit.
    """
    last = len(stops) - 1
    allowed = model.limits * (1.0 + TOLERANCE)
    bad = []
    visited: set[int] = set()
    for place, stop in enumerate(stops):
        horizontal, vertical = allowed[KIND_WORDS.index(stop.kind)]
        is_violated = (
            (stop.kind == "A") != (place == 0)
            or (stop.kind == "B") != (place == last)
            or (not model.revisits and stop.point in visited)
            or (place > 0 and (stop.horizontal > horizontal or stop.vertical > vertical))
        )
        visited.add(stop.point)
        if is_violated:
            bad.append(place)
    return bad


def _scale(model: ErrorCorrectionRouting, stops: list[Stop]) -> tuple[float, str]:
    """Return the factor from metres to the unit of the axes, and the unit."""
    extent = float(np.ptp(model.points, axis=0).max(initial=0.0))
    longest = max(extent, stops[-1].distance if stops else 0.0)
    return (1e-3, "km") if longest >= 2000 else (1.0, "m")


def _title(
    model: ErrorCorrectionRouting, stops: list[Stop], bad: list[int], scale: float, unit: str
) -> str:
    name = model.name or f"{len(model.points)} points"
    if not stops:
        return f"{name}  ·  {model.describe()}" if model.name else model.describe()
    corrections = sum(stop.kind in ("horizontal", "vertical") for stop in stops)
    parts = [
        name,
        f"{stops[-1].distance * scale:.3f} {unit}",
        f"{corrections} correction{'' if corrections == 1 else 's'}",
    ]
    if bad:
        parts.append(f"NOT VALID at {len(bad)} stop{'' if len(bad) == 1 else 's'}")
    return "  ·  ".join(parts)


# -- the route in space --------------------------------------------------------------------------


def _space(
    model: ErrorCorrectionRouting, stops: list[Stop], bad: list[int], axes: Any, scale: float,
    unit: str,
) -> None:  # fmt: skip
    points = model.points * scale
    visited = [stop.point for stop in stops]
    floor = float(points[:, 2].min())
    others = np.ones(len(points), bool)
    others[visited] = False
    crowded = len(points) > 60
    size, alpha = (9 if stops and crowded else 18), (0.22 if crowded else 0.4) if stops else 0.75
    for word in KIND_WORDS:
        area, clear = (36, 1.0) if word in ("A", "B") else (size, alpha)
        faint = points[(model.kinds == word) & others]
        if len(faint):
            dots(axes, faint, _MARKERS[word], _COLOURS[word], size=area, alpha=clear, zorder=2)
    if stops:
        way = points[visited]
        # The projection on the floor and the stems show the height of a point.
        axes.plot(way[:, 0], way[:, 1], floor, color=GREY, lw=0.9, alpha=0.6, zorder=1)
        for x, y, z in way:
            axes.plot([x, x], [y, y], [floor, z], color=GREY, lw=0.5, alpha=0.6, zorder=1)
        axes.plot(*way.T, color=BLACK, lw=1.5, zorder=3)
        white: dict[str, Any] = {"size": 46, "edge": "white", "width": 0.6, "zorder": 4}
        for word in KIND_WORDS:
            at = way[[stop.kind == word for stop in stops]]
            if len(at):
                dots(axes, at, _MARKERS[word], _COLOURS[word], **white)
        unsure = [stop.suspect for stop in stops]
        if any(unsure):
            dots(axes, way[unsure], "o", "white", size=9, zorder=5)
        if bad:
            dots(axes, way[bad], "o", "none", size=110, edge=RED, width=1.6, zorder=21)
    _box(points, axes, unit)


def _box(points: NDArray[np.float64], axes: Any, unit: str) -> None:
    """Set limits and aspect: equal scales, except for stretched flat sides."""
    low, high = points.min(axis=0), points.max(axis=0)
    span = high - low
    longest = float(span.max()) or 1.0
    shown = np.maximum(span, _FLATTEST * longest)
    planar = bool(span[2] <= 1e-9 * longest)
    if planar:
        shown[2] = 0.02 * longest
    stretched = []
    for axis, name in enumerate("xyz"):
        # A side without extent is drawn with the scale of the others.
        flat = span[axis] <= 1e-9 * longest
        middle = (low[axis] + high[axis]) / 2
        half = shown[axis] / 2 if flat else span[axis] / 2
        getattr(axes, f"set_{name}lim")(middle - 1.02 * half, middle + 1.02 * half)
        factor = 1.0 if flat else shown[axis] / span[axis]
        stretched.append("" if factor < 1.05 else f", stretched ×{factor:.1f}")
    axes.set_box_aspect(shown, zoom=1.0 if shown[2] > 0.7 * longest else 1.12)
    axes.set_xlabel(f"x ({unit}{stretched[0]})", fontsize=8.5, labelpad=2)
    axes.set_ylabel(f"y ({unit}{stretched[1]})", fontsize=8.5, labelpad=2)
    axes.set_zlabel("" if planar else f"z ({unit}{stretched[2]})", fontsize=8.5, labelpad=2)
    dress_space(axes, above=60 if planar else 28)
    if planar:
        axes.set_zticks([])


def _kind_keys(model: ErrorCorrectionRouting, suspect: bool, bad: bool) -> list[Any]:
    keys = [
        key(_LEGEND[word], marker=_MARKERS[word], color=_COLOURS[word], ms=6)
        for word in KIND_WORDS
        if (model.kinds == word).any()
    ]
    if suspect:
        keys.append(key("may fail", marker="o", color=DARK, mfc="white", ms=4))
    return [*keys, key("rule broken", **RING)] if bad else keys


def _name(model: ErrorCorrectionRouting, point: int) -> str:
    kind, name = str(model.kinds[point]), model.label(point)
    return f"{kind} ({name})" if kind in ("A", "B") and kind != name else name


# -- the errors on the way -----------------------------------------------------------------------


def _errors(
    model: ErrorCorrectionRouting, stops: list[Stop], bad: list[int], figure: Any, title: str,
    scale: float, unit: str,
) -> None:  # fmt: skip
    """Draw both errors against the distance flown, with the thresholds at each stop."""
    distance = np.array([stop.distance for stop in stops]) * scale
    flown, kinds = np.repeat(distance, 2), np.array([stop.kind for stop in stops])
    allowed = model.limits[[KIND_WORDS.index(word) for word in kinds]].T
    arrive = np.array([[stop.horizontal, stop.vertical] for stop in stops]).T
    leave = np.array([[stop.horizontal_after, stop.vertical_after] for stop in stops]).T
    error = np.stack([arrive, leave], axis=2).reshape(2, -1)
    violated = arrive > allowed
    violated[:, [place for place in range(len(stops)) if place == 0 or place not in bad]] = False
    panels = []
    for row, name in enumerate(("horizontal", "vertical")):
        label = f"{name} error"
        marks = []
        for word in KIND_WORDS:
            at = (kinds == word) & (np.arange(len(stops)) > 0)
            if at.any():
                text = f"at {word}" if word in "AB" else f"at a {word} point"
                look = {"marker": _MARKERS[word], "ms": 5, "mec": "white", "mew": 0.5, "zorder": 5}
                marks.append(Mark(text, distance[at], arrive[row, at], _NUMBERS[word], look))
        if violated[row].any():
            marks.append(
                Mark("rule broken", distance[violated[row]], arrive[row, violated[row]], 0, RING)
            )
        panels.append(
            Panel(label, "", [Curve(label, _NUMBERS[name], flown, error[row], 1.6)], marks=marks)
        )
    total = float(distance[-1]) or 1.0
    places = draw_panels(
        figure, panels, [Span("", 0.0, total, np.empty(0))], title=title, wrong=bool(bad),
        label=f"distance flown ({unit})",
        keys=[key("allowed there", marker="_", mew=1.6, ms=9, color=DARK)],
    )  # fmt: skip
    half = 0.011 * total
    for axes, rise, most, wrong, panel in zip(
        places, arrive, allowed, violated, panels, strict=True
    ):
        colour = axis_style(panel.curves[0].colour)["color"]
        axes.fill_between(flown, panel.curves[0].values, color=colour, alpha=0.12, lw=0)
        at, most, red = distance[1:], most[1:], wrong[1:]
        bars, stems = ([RED if one else calm for one in red] for calm in (DARK, GREY))
        axes.hlines(most, at - half, at + half, colors=bars, lw=1.6, gid="allowed there")
        axes.vlines(at, rise[1:], most, colors=stems, lw=np.where(red, 1.4, 0.6).tolist(), ls=":")
        axes.set_ylim(0, 1.12 * float(np.append(rise, most).max()) or 1.0)
