"""Figure of an error-correction route: the path in space, and its errors.

The left panel shows the points by kind and the route through them, the right panels both errors
against the distance flown. An error increases with the distance and is reset by a correction; a bar at
each stop marks the largest error allowed on arrival. The errors are worst-case errors.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..fields import required
from ..plots import kit
from .model import ErrorCorrectionRouting, Route, Stop
from .no_fly import crosses
from .points import KIND_WORDS

__all__ = ["animate_route", "draw", "violated_stops"]

#: Colour numbers of the kinds; the markers differ as well.
_NUMBERS = {"A": 6, "horizontal": 0, "vertical": 1, "B": 6}
_COLOURS = {word: kit.colour_of(number) for word, number in _NUMBERS.items()}
_MARKERS = {"A": ">", "horizontal": "o", "vertical": "^", "B": "s"}
#: Look of the border of a no-fly polygon.
_BORDER: dict[str, Any] = {"color": kit.RED, "lw": 1.2, "ls": "--"}

#: Largest number of labels drawn by default.
_MOST_LABELS = 45
#: Smallest side of the box relative to the longest; shorter sides are stretched.
_FLATTEST = 0.3


@kit.documented
def draw(
    model: ErrorCorrectionRouting,
    plan: Route | None = None,
    *,
    labels: bool | None = None,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.Figure:
    """Draw the points of `model`, and `plan` with its errors.

    Parameters
    ----------
    plan : Route, optional
        A route; stops that break a rule are drawn in red. None draws the points only.
    labels : bool, optional
        Whether to write the names of the visited points, or of all points without a plan. By
        default, up to 45 names are written.
    """
    stops = [] if plan is None else model.walk(required("plan", plan, Route))
    if labels is None:
        labels = (len(stops) or len(model.points)) <= _MOST_LABELS
    kit.check_flags(labels=labels)
    scale, unit = _unit(model, stops)
    bad = violated_stops(model, stops)
    result = kit.verified_plan(model, plan, Route, kit.TOLERANCE)
    names = [f"point {model.label(point)}" for point in range(len(model.points))]
    text = _title(model, stops, bad, scale, unit) if title is None else title
    scene = kit.Scene(text, None, size, (11.5, 5.4) if stops else (6.4, 5.4), wrong=bool(bad))
    left: kit.Frame = scene
    if stops:
        left, right = scene.halves(1.15, 1.0)
        kit.draw_levels(
            right.figure, np.array([stop.distance for stop in stops]) * scale,
            _levels(model, stops, bad, scale), label=f"distance flown ({unit})",
            limit="allowed there", broken="rule broken", title=text, wrong=bool(bad), result=result,
            stops=[names[stop.point] for stop in stops],
        )  # fmt: skip
    space = kit.space_axes(left.figure, (0.0, 0.1, 0.96, 0.83))
    _draw_space(model, stops, bad, space, scale, unit)
    kit.pin_places(space, result, dict(zip(names, model.points * scale, strict=True)))
    left.legend(_kind_keys(model, any(stop.suspect for stop in stops), bool(bad)), 1)
    if labels:
        named = list(dict.fromkeys(stop.point for stop in stops)) or list(range(len(model.points)))
        texts = [_name(model, point) for point in named]
        places = model.points[named] * scale
        kit.write_names(space, places, texts, size=7.5, colour=kit.BLACK, route=bool(stops))
    return scene.figure


def violated_stops(model: ErrorCorrectionRouting, stops: list[Stop]) -> list[int]:
    """Return the indices of the stops that violate a constraint, ascending.

    Violations are thresholds exceeded by more than the tolerance of a verification, a route that does
    not begin at A, does not end at B or passes through either, a forbidden revisit, and the end of a leg that
    crosses a no-fly polygon.
    """
    crossed = _crossed(model, stops)
    last = len(stops) - 1
    allowed = model.limits * (1.0 + kit.TOLERANCE)
    bad = []
    visited: set[int] = set()
    for place, stop in enumerate(stops):
        horizontal, vertical = allowed[KIND_WORDS.index(stop.kind)]
        is_violated = (
            (stop.kind == "A") != (place == 0)
            or (stop.kind == "B") != (place == last)
            or (not model.revisits and stop.point in visited)
            or place in crossed
            or (place > 0 and (stop.horizontal > horizontal or stop.vertical > vertical))
        )
        visited.add(stop.point)
        if is_violated:
            bad.append(place)
    return bad


def _crossed(model: ErrorCorrectionRouting, stops: list[Stop]) -> set[int]:
    """Return the indices of stops whose leg from the previous stop crosses a no-fly polygon."""
    ways = [model.points[stop.point] for stop in stops]
    return {
        place
        for place in range(1, len(ways))
        for polygon in model.no_fly or ()
        if crosses(ways[place - 1], ways[place], polygon)
    }


def _title(
    model: ErrorCorrectionRouting, stops: list[Stop], bad: list[int], scale: float, unit: str
) -> str:
    if not stops:
        return kit.title_of(model, [model.describe()], None)
    corrections = sum(stop.kind in ("horizontal", "vertical") for stop in stops)
    parts = [
        model.name or f"{len(model.points)} points",
        f"{stops[-1].distance * scale:.3f} {unit}",
    ]
    parts.append(kit.many(corrections, "correction"))
    parts += [f"NOT VALID at {kit.many(len(bad), 'stop')}"] * bool(bad)
    return "  ·  ".join(parts)


def _unit(model: ErrorCorrectionRouting, stops: list[Stop]) -> tuple[float, str]:
    """Return factor and name of the unit of all lengths."""
    extent = float(np.ptp(model.points, axis=0).max(initial=0.0))
    longest = max(extent, stops[-1].distance if stops else 0.0)
    return (1e-3, "km") if longest >= 2000 else (1.0, "m")


def _draw_space(
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
            kit.dots(axes, faint, _MARKERS[word], _COLOURS[word], size=area, alpha=clear, zorder=2)
    if stops:
        way = points[visited]
        # The projection on the floor and the stems show the height of a point.
        axes.plot(way[:, 0], way[:, 1], floor, color=kit.GREY, lw=0.9, alpha=0.6, zorder=1)
        for x, y, z in way:
            axes.plot([x, x], [y, y], [floor, z], color=kit.GREY, lw=0.5, alpha=0.6, zorder=1)
        axes.plot(*way.T, color=kit.BLACK, lw=1.5, zorder=3)
        white: dict[str, Any] = {"size": 46, "edge": "white", "width": 0.6, "zorder": 4}
        for word in KIND_WORDS:
            at = way[[stop.kind == word for stop in stops]]
            if len(at):
                kit.dots(axes, at, _MARKERS[word], _COLOURS[word], **white)
        unsure = [stop.suspect for stop in stops]
        if any(unsure):
            kit.dots(axes, way[unsure], "o", "white", size=9, zorder=5)
        kit.ring(axes, way[bad], "rule broken")
    shown = [points]
    for polygon in model.no_fly or ():
        for ring in (polygon.shell, *polygon.holes):
            closed = np.vstack([ring, ring[:1]]) * scale
            axes.plot(*closed.T, floor, **_BORDER, zorder=1)
            shown.append(np.column_stack([closed, np.full(len(closed), floor)]))
    _box(np.vstack(shown), axes, unit)


def _box(points: NDArray[np.float64], axes: Any, unit: str) -> None:
    """Set limits and aspect: equal scales, except for stretched flat sides."""
    low, high = points.min(axis=0), points.max(axis=0)
    span = high - low
    longest = float(span.max()) or 1.0
    # A side without extent is drawn with the scale of the others.
    flat = span <= 1e-9 * longest
    shown = np.maximum(span, _FLATTEST * longest)
    planar = bool(flat[2])
    if planar:
        shown[2] = 0.02 * longest
    half = 0.51 * np.where(flat, shown, span)
    middle = (low + high) / 2
    for axis, name in enumerate("xyz"):
        getattr(axes, f"set_{name}lim")(middle[axis] - half[axis], middle[axis] + half[axis])
        factor = 1.0 if flat[axis] else shown[axis] / span[axis]
        stretched = "" if factor < 1.05 else f", stretched ×{factor:.1f}"
        label = "" if planar and name == "z" else f"{name} ({unit}{stretched})"
        getattr(axes, f"set_{name}label")(label, fontsize=8.5, labelpad=2)
    zoom = 1.0 if shown[2] > 0.7 * longest else 1.12
    kit.dress_space(axes, shown, zoom=zoom, above=60 if planar else 28)
    if planar:
        axes.set_zticks([])


def _kind_keys(model: ErrorCorrectionRouting, suspect: bool, bad: bool) -> list[Any]:
    texts = {word: f"{word} correction" for word in KIND_WORDS} | {"A": "start A", "B": "end B"}
    keys = [
        kit.key(texts[word], marker=_MARKERS[word], color=_COLOURS[word], ms=6)
        for word in KIND_WORDS
        if (model.kinds == word).any()
    ]
    if suspect:
        keys.append(kit.key("may fail", marker="o", color=kit.DARK, mfc="white", ms=4))
    if model.no_fly:
        keys.append(kit.key("no-fly polygon", **_BORDER))
    return [*keys, kit.key("rule broken", **kit.RING)] if bad else keys


def _name(model: ErrorCorrectionRouting, point: int) -> str:
    kind, name = str(model.kinds[point]), model.label(point)
    return f"{kind} ({name})" if kind in ("A", "B") and kind != name else name


def _levels(
    model: ErrorCorrectionRouting, stops: list[Stop], bad: list[int], scale: float
) -> list[kit.Level]:
    """Return both errors at the stops, with their thresholds."""
    distance, kinds = np.array([stop.distance for stop in stops]) * scale, [s.kind for s in stops]
    allowed = model.limits[[KIND_WORDS.index(word) for word in kinds]].T
    arrive = np.array([[stop.horizontal, stop.vertical] for stop in stops]).T
    leave = np.array([[stop.horizontal_after, stop.vertical_after] for stop in stops]).T
    violated = arrive > allowed
    violated[:, [place for place in range(len(stops)) if place == 0 or place not in bad]] = False
    levels = []
    for row, name in enumerate(("horizontal", "vertical")):
        marks = []
        for word in KIND_WORDS:
            at = (np.array(kinds) == word) & (np.arange(len(stops)) > 0)
            if at.any():
                text = f"at {word}" if word in "AB" else f"at a {word} point"
                look = {"marker": _MARKERS[word], "ms": 5, "mec": "white", "mew": 0.5, "zorder": 5}
                marks.append(kit.Mark(text, distance[at], arrive[row, at], _NUMBERS[word], look))
        values = arrive[row], leave[row], allowed[row], violated[row]
        levels.append(kit.Level(f"{name} error", "", _NUMBERS[name], *values, marks))
    return levels


@kit.animated(draw, Route)
def animate_route(model: ErrorCorrectionRouting, plan: Route | Any, figure: Any) -> Any:
    """Animate the picture of a route: the UAV on its way, and its errors."""
    stops = model.walk(plan)
    kit.check_option("plan", plan, bool(stops), "have stops")
    movers = kit.curve_movers(figure)
    scale, unit = _unit(model, stops)
    flown = np.array([stop.distance for stop in stops]) * scale
    way = model.points[[stop.point for stop in stops]] * scale
    space = next(axes for axes in figure.axes if axes.name == "3d")
    return [*movers, kit.Mover(space, flown, way, kit.RED)], "flown", unit
