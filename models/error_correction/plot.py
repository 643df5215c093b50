"""The picture of an error-correction route: where it flies, and its errors on the way.

On the left the points by kind with the route through them; on the right both errors against the
distance flown. An error grows with every metre and falls to 0 where it is corrected; a bar at each
stop shows the largest error allowed on arrival there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, UnsupportedOption
from ..fields import show
from ..plots.labels import place_labels
from ..verification import TOLERANCE
from .model import ErrorCorrectionRouting, Route, Stop
from .points import KIND_WORDS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw", "violated_stops"]

# Okabe and Ito's colours, which all eyes tell apart; the markers differ as well.
_BLUE, _ORANGE, _BLACK, _RED, _GREY = "#0072B2", "#E69F00", "#1a1a1a", "#C8102E", "#8c8c8c"
_COLOURS = {"A": _BLACK, "horizontal": _BLUE, "vertical": _ORANGE, "B": _BLACK}
_MARKERS = {"A": ">", "horizontal": "o", "vertical": "^", "B": "s"}
_LEGEND = {
    "A": "start A",
    "horizontal": "horizontal correction",
    "vertical": "vertical correction",
    "B": "end B",
}

#: More labels than this are not readable.
_MOST_LABELS = 45
#: Size of the names, and how wide a character and how high a line of it are (point).
_FONT, _CHARACTER, _LINE = 7.5, 4.6, 8.0
#: A side of the box shorter than this part of the longest is stretched.
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
        Whether to write the points' names: of the visited ones, or of all where there is no
        plan. By default only where they are few enough to be read.
    title : str, optional
        Instead of the instance's name, the length and the number of corrections.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.figure.Figure
        With three axes, or one where there is no plan.

    Raises
    ------
    InvalidData
        The plan is no route, or names a point that does not exist.
    UnsupportedOption
        An option has a value that is not allowed.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if plan is not None and not isinstance(plan, Route):
        raise InvalidData(f"plan must be a Route, got {show(plan)}", field="plan")
    stops = [] if plan is None else model.walk(plan)
    if size is None:
        size = (11.5, 5.4) if stops else (6.4, 5.4)
    figure = Figure(figsize=_checked_size(size), dpi=150)
    FigureCanvasAgg(figure)
    scale, unit = _scale(model, stops)
    bad = violated_stops(model, stops)
    if labels is None:
        labels = (len(stops) or len(model.points)) <= _MOST_LABELS
    if stops:
        halves: Any = figure.subfigures(1, 2, width_ratios=[1.15, 1.0], wspace=0.0)
        left, right = halves
        upper, lower = right.subplots(2, 1, sharex=True)
        right.subplots_adjust(left=0.11, right=0.97, bottom=0.11, top=0.86, hspace=0.12)
        _errors(model, stops, bad, upper, "horizontal", scale)
        _errors(model, stops, bad, lower, "vertical", scale)
        lower.set_xlabel(f"distance flown ({unit})")
        _errors_legend(upper)
    else:
        left = figure
    # The order of drawing is ours: matplotlib would put far markers behind the route's line.
    space = left.add_axes((0.0, 0.1, 0.96, 0.83), projection="3d", computed_zorder=False)
    _space(model, stops, bad, space, scale, unit)
    _kinds_legend(model, left, bool(bad))
    if labels:
        _names(model, stops, space, scale)
    text = _title(model, stops, bad, scale, unit) if title is None else title
    figure.suptitle(text, fontsize=11.5, y=0.975, color=_RED if bad else _BLACK)
    return figure


def violated_stops(model: ErrorCorrectionRouting, stops: list[Stop]) -> list[int]:
    """Return the places in the route where a rule is broken, in order.

    These are thresholds (beyond the tolerance of a verification), a route that does not begin at
    A or end at B or passes through either, and a point visited again where that is forbidden.
    """
    last = len(stops) - 1
    allowed = model.limits + TOLERANCE * np.maximum(1.0, model.limits)
    bad = []
    seen: set[int] = set()
    for place, stop in enumerate(stops):
        horizontal, vertical = allowed[KIND_WORDS.index(stop.kind)]
        wrong = (
            (stop.kind == "A") != (place == 0)
            or (stop.kind == "B") != (place == last)
            or (not model.revisits and stop.point in seen)
            or (place > 0 and (stop.horizontal > horizontal or stop.vertical > vertical))
        )
        seen.add(stop.point)
        if wrong:
            bad.append(place)
    return bad


def _checked_size(size: Any) -> tuple[float, float]:
    try:
        width, height = (float(edge) for edge in size)
    except (TypeError, ValueError):
        width = height = 0.0
    if not (0 < width <= 100 and 0 < height <= 100):
        raise UnsupportedOption(f"size must be width and height in inches, got {show(size)}")
    return width, height


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
    model: ErrorCorrectionRouting,
    stops: list[Stop],
    bad: list[int],
    axes: Any,
    scale: float,
    unit: str,
) -> None:
    points = model.points * scale
    visited = [stop.point for stop in stops]
    floor = float(points[:, 2].min())
    others = np.ones(len(points), bool)
    others[visited] = False
    crowded = len(points) > 60
    for word in KIND_WORDS:
        faint = points[(model.kinds == word) & others]
        ends = word in ("A", "B")
        if len(faint):
            axes.scatter(
                *faint.T, marker=_MARKERS[word], color=_COLOURS[word], depthshade=False,
                s=36 if ends else 9 if stops and crowded else 18, linewidths=0,
                alpha=1.0 if ends else 0.75 if not stops else 0.22 if crowded else 0.4, zorder=2,
            )  # fmt: skip
    if stops:
        way = points[visited]
        # The shadow on the floor and the stems tell how high a point is.
        axes.plot(way[:, 0], way[:, 1], floor, color=_GREY, lw=0.9, alpha=0.6, zorder=1)
        for x, y, z in way:
            axes.plot([x, x], [y, y], [floor, z], color=_GREY, lw=0.5, alpha=0.6, zorder=1)
        axes.plot(*way.T, color=_BLACK, lw=1.5, zorder=3)
        for word in KIND_WORDS:
            at = way[[stop.kind == word for stop in stops]]
            if len(at):
                axes.scatter(
                    *at.T, marker=_MARKERS[word], color=_COLOURS[word], depthshade=False,
                    s=46, edgecolors="white", linewidths=0.6, zorder=4,
                )  # fmt: skip
        if bad:
            axes.scatter(
                *way[bad].T, marker="o", facecolors="none", edgecolors=_RED, s=110,
                linewidths=1.6, depthshade=False, zorder=21,
            )  # fmt: skip
    _box(points, axes, unit)
    # The box is wider than the square that matplotlib clips to.
    for artist in (*axes.collections, *axes.lines):
        artist.set_clip_on(False)


def _box(points: NDArray[np.float64], axes: Any, unit: str) -> None:
    """Set limits and aspect: equal scales, but for a side too flat to be read."""
    from matplotlib.ticker import MaxNLocator

    low, high = points.min(axis=0), points.max(axis=0)
    span = high - low
    longest = float(span.max()) or 1.0
    shown = np.maximum(span, _FLATTEST * longest)
    planar = bool(span[2] <= 1e-9 * longest)
    if planar:
        shown[2] = 0.02 * longest
    stretched = []
    for axis, name in enumerate("xyz"):
        # A side without any extent has no scale of its own: show it at that of the others.
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
    axes.tick_params(labelsize=7.5, pad=0)
    axes.view_init(elev=60 if planar else 28, azim=-62)
    for pane in (axes.xaxis, axes.yaxis, axes.zaxis):
        pane.pane.set_facecolor("white")
        pane.pane.set_edgecolor("#d0d0d0")
        pane._axinfo["grid"].update(color="#e6e6e6", linewidth=0.6)
        pane.set_major_locator(MaxNLocator(nbins=5))
    if planar:
        axes.set_zticks([])


def _kinds_legend(model: ErrorCorrectionRouting, figure: Any, bad: bool) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D(
            [], [], ls="", marker=_MARKERS[word], color=_COLOURS[word], label=_LEGEND[word], ms=6
        )
        for word in KIND_WORDS
        if (model.kinds == word).any()
    ]
    if bad:
        handles.append(
            Line2D([], [], ls="", marker="o", mfc="none", mec=_RED, ms=9, label="rule broken")
        )
    figure.legend(
        handles=handles, loc="lower center", bbox_to_anchor=(0.5, 0.015), ncols=len(handles),
        fontsize=7.5, frameon=False, handletextpad=0.2, columnspacing=1.2,
    )  # fmt: skip


def _names(model: ErrorCorrectionRouting, stops: list[Stop], axes: Any, scale: float) -> None:
    """Write the names of the visited points, or of all, each where it hides least."""
    from matplotlib.patheffects import withStroke

    named = list(dict.fromkeys(stop.point for stop in stops)) or list(range(len(model.points)))
    texts = [_name(model, point) for point in named]
    axes.apply_aspect()
    homogeneous = np.column_stack([model.points[named] * scale, np.ones(len(named))])
    seen = homogeneous @ axes.get_proj().T
    flat = seen[:, :2] / seen[:, 3:]
    # In points of print, the unit of font sizes.
    paper = axes.transData.transform(flat) * 72 / axes.figure.dpi
    widths = [_CHARACTER * len(text) for text in texts]
    offsets = place_labels(paper, widths, height=_LINE, route=bool(stops))
    halo = [withStroke(linewidth=2.0, foreground="white")]
    for text, at, offset in zip(texts, flat, offsets, strict=True):
        axes.annotate(
            text, at, offset, textcoords="offset points", fontsize=_FONT, color=_BLACK,
            ha="center", va="center_baseline", path_effects=halo, zorder=20, annotation_clip=False,
        )  # fmt: skip


def _name(model: ErrorCorrectionRouting, point: int) -> str:
    kind, name = str(model.kinds[point]), model.label(point)
    return f"{kind} ({name})" if kind in ("A", "B") and kind != name else name


# -- the errors on the way -----------------------------------------------------------------------


def _errors(
    model: ErrorCorrectionRouting,
    stops: list[Stop],
    bad: list[int],
    axes: Axes,
    axis: str,
    scale: float,
) -> None:
    """Draw one error against the distance flown: it rises to each stop and may fall there."""
    column = ("horizontal", "vertical").index(axis)
    distance = [stop.distance * scale for stop in stops]
    arrive = [float(getattr(stop, axis)) for stop in stops]
    leave = [float(getattr(stop, f"{axis}_after")) for stop in stops]
    limit = [float(model.limits[KIND_WORDS.index(stop.kind), column]) for stop in stops]
    colour = _COLOURS[axis]
    flown, error = np.repeat(distance, 2), np.column_stack([arrive, leave]).ravel()
    axes.plot(flown, error, color=colour, lw=1.6)
    axes.fill_between(flown, error, color=colour, alpha=0.12, lw=0)
    half = 0.011 * (distance[-1] or 1.0)
    for place, stop in enumerate(stops[1:], start=1):
        over = place in bad and arrive[place] > limit[place]
        axes.plot(
            [distance[place] - half, distance[place] + half], [limit[place]] * 2,
            color=_RED if over else "#404040", lw=1.6, solid_capstyle="butt",
        )  # fmt: skip
        axes.plot(
            [distance[place]] * 2, [arrive[place], limit[place]],
            color=_RED if over else _GREY, lw=1.4 if over else 0.6, ls="-" if over else ":",
        )  # fmt: skip
        axes.plot(
            distance[place], arrive[place], ls="", marker=_MARKERS[stop.kind],
            color=_RED if over else _COLOURS[stop.kind], ms=5, mec="white", mew=0.5, zorder=5,
        )  # fmt: skip
    top = max([*arrive, *limit[1:]], default=1.0) or 1.0
    axes.set_ylim(0, 1.12 * top)
    axes.set_xlim(0, 1.03 * (distance[-1] or 1.0))
    axes.set_ylabel(f"{axis} error", color=_BLACK, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(axis="y", color="#ececec", lw=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _errors_legend(axes: Axes) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D(
            [], [], ls="", marker=_MARKERS[word], color=_COLOURS[word], mec="white", ms=6,
            label=f"on arrival at a {word} point",
        )
        for word in ("horizontal", "vertical")
    ]  # fmt: skip
    handles.append(
        Line2D([], [], ls="", marker="_", mew=1.6, ms=9, color="#404040", label="allowed there")
    )
    axes.legend(
        handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, fontsize=7.5,
        frameon=False, handletextpad=0.2, columnspacing=1.0,
    )  # fmt: skip
