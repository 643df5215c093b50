"""The right half of a trajectory's picture: its derivatives over time against their bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...plots.style import BLACK, MOST_KNOTS, RED, axis_style, bare, number, speed_map
from ..bounds import Bound, derivative_name, derivative_unit
from .data import Mark, Scene, pretty_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import Collection

__all__ = ["draw_panel", "panel_handles", "title_of", "told"]

Floats = NDArray[np.float64]

#: A bound farther away than this many times the height of the curves is told in words.
_FAR = 1.5
#: Colour of a limit that several axes have.
_LIMIT = "#404040"
#: Axes beyond this have no entry in the legend.
_MOST_AXES = 10


def title_of(order: int) -> str:
    """Return the label of a panel: the derivative, and its unit below."""
    return f"{derivative_name(order)}\n({pretty_unit(derivative_unit(order))})"


def draw_panel(
    scene: Scene, order: int, axes: Axes, *, only: tuple[int, ...] = (), coloured: bool = False
) -> Collection | None:
    """Draw one derivative over time.

    Parameters
    ----------
    scene : Scene
        Model and plan.
    order : int
        Which derivative.
    axes : Axes
        Where.
    only : tuple of int
        The axes of the path to draw, all by default.
    coloured : bool
        Colour the (one) line by speed, as the path is.

    Returns
    -------
    Collection or None
        What is coloured by speed.
    """
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    own = list(only) or list(range(scene.dimensions))
    known = scene.conditions[:, order][:, own] if order < scene.conditions.shape[1] else None
    low, high = _range(scene, order, own, known)
    notes = _bounds(scene, order, own, axes, low, high)
    if len(scene.times) <= MOST_KNOTS:
        axes.vlines(
            scene.times, 0, 1, transform=axes.get_xaxis_transform(), color="#dcdcdc", lw=0.6,
            zorder=0.8,
        )  # fmt: skip
    found = None
    if scene.plan is not None:
        t, values = scene.sample_times, scene.samples(order)
        if coloured:
            found = _line_by_speed(t, values[:, own[0]], scene.samples(1)[:, own[0]], axes)
        else:
            # Noise would be a solid bar.
            width = 0.6 if order and scene.segments > 2 * MOST_KNOTS else 1.4
            for axis in own:
                axes.plot(
                    t, values[:, axis], lw=width, zorder=3, gid=f"axis {axis}", **axis_style(axis)
                )
    if known is not None:
        _fixed(scene, own, known, axes, coloured)
    _marks(scene, order, own, axes)
    axes.set_ylim(low, high)
    first, last = float(scene.times[0]), float(scene.times[-1])
    if scene.plan is not None:
        first, last = min(first, scene.plan.times[0]), max(last, scene.plan.times[-1])
    axes.set_xlim(first - 0.015 * (last - first), last + 0.015 * (last - first))
    axes.yaxis.set_major_locator(MaxNLocator(nbins=6 if coloured else 4, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: number(value, 6)))
    bare(axes)
    # The knots' lines are enough.
    axes.grid(visible=False, axis="x")
    if notes:
        axes.text(
            0.01, 0.97, "; ".join(notes), transform=axes.transAxes, ha="left", va="top",
            fontsize=7, color="#505050", zorder=6,
            bbox={"facecolor": "white", "alpha": 0.75, "pad": 1.0, "lw": 0},
        )  # fmt: skip
    return found


def panel_handles(scene: Scene, panels: list[Axes]) -> list[Any]:
    """Return what a legend above the panels tells of what they show."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = []
    drawn = {artist.get_gid() for axes in panels for artist in (*axes.lines, *axes.collections)}
    for axis in range(min(scene.dimensions, _MOST_AXES)):
        if f"axis {axis}" in drawn:
            handles.append(Line2D([], [], lw=1.6, label=scene.names[axis], **axis_style(axis)))
    if scene.dimensions > _MOST_AXES:
        handles.append(Line2D([], [], ls="", label=f"… {scene.dimensions} axes"))
    if "limit" in drawn:
        handles.append(Line2D([], [], color=_LIMIT, ls="--", lw=1.0, label="limit"))
    if "forbidden" in drawn:
        handles.append(Patch(facecolor=RED, alpha=0.10, label="forbidden"))
    if "band" in drawn:
        handles.append(Patch(facecolor=_LIMIT, alpha=0.13, label="corridor of an axis"))
    if "point" in drawn:
        handles.append(
            Line2D([], [], ls="", marker="o", ms=5, mfc="white", mec=BLACK, label="waypoint")
        )
    if "violation" in drawn:
        handles.append(
            Line2D([], [], ls="", marker="o", ms=9, mfc="none", mec=RED, label="worst violation")
        )
    return handles


def _range(scene: Scene, order: int, own: list[int], known: Floats | None) -> tuple[float, float]:
    """Return the limits of the panel: of the curves, and of the bounds that are near them."""
    parts = [np.zeros(0)]
    if scene.plan is not None:
        parts.append(scene.samples(order)[:, own].ravel())
    if known is not None:
        parts.append(known[np.isfinite(known)])
    values = np.concatenate(parts)
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    # Derivatives that are zero but for rounding are not blown up.
    span = high - low
    if span <= 1e-9 * max(1.0, abs(low), abs(high)):
        span = 0.0
    edges = []
    for bound in scene.bounds_of(order):
        for side in (bound.lower[:, own], bound.upper[:, own]):
            edges += side[np.isfinite(side)].tolist()
    reach = _FAR * (span or max([abs(edge) for edge in edges], default=1.0) or 1.0)
    near = [edge for edge in edges if low - reach <= edge <= high + reach]
    low, high = min([low, *near]), max([high, *near])
    margin = 0.08 * (high - low) if high > low else 0.5 * (abs(high) or 1.0)
    return low - margin, high + margin


# -- bounds --------------------------------------------------------------------------------------


def _groups(bound: Bound, own: list[int]) -> list[list[int]]:
    """Return the axes that have the same bound, together."""
    found: dict[bytes, list[int]] = {}
    for axis in own:
        key = bound.lower[:, axis].tobytes() + bound.upper[:, axis].tobytes()
        found.setdefault(key, []).append(axis)
    return list(found.values())


def _bounds(
    scene: Scene, order: int, own: list[int], axes: Axes, low: float, high: float
) -> list[str]:
    """Draw the bounds on a derivative segment by segment, and return those out of sight."""
    t = np.repeat(scene.flown, 2)[1:-1]
    crowd = scene.segments > MOST_KNOTS
    notes = []
    for bound in scene.bounds_of(order):
        groups = _groups(bound, own)
        for group in groups:
            lower = np.repeat(bound.lower[:, group[0]], 2)
            upper = np.repeat(bound.upper[:, group[0]], 2)
            finite = np.concatenate([lower, upper])
            finite = finite[np.isfinite(finite)]
            if not finite.size:
                continue
            whose = "" if len(groups) == 1 else ", ".join(scene.names[axis] for axis in group)
            colour = _LIMIT if len(group) > 1 or not whose else axis_style(group[0])["color"]
            if not ((finite >= low) & (finite <= high)).any():
                notes.append(_told(bound, finite, whose))
                continue
            inner = np.clip(lower, low, high), np.clip(upper, low, high)
            if not whose:
                for near, edge in zip(inner, (low, high), strict=True):
                    axes.fill_between(
                        t, near, edge, color=RED, alpha=0.10, lw=0, zorder=0.6, gid="forbidden"
                    )
            elif order == 0:
                axes.fill_between(t, *inner, color=colour, alpha=0.13, lw=0, zorder=0.6, gid="band")
            for side in (lower, upper):
                if np.isfinite(side).any():
                    axes.plot(
                        t, np.where(np.isfinite(side), side, np.nan), color=colour, zorder=2,
                        ls="-" if crowd and whose else "--", lw=0.5 if crowd and whose else 1.0,
                        gid="limit",
                    )  # fmt: skip
            if whose and order and np.isfinite(upper[-1]) and low <= upper[-1] <= high:
                axes.text(
                    1.0, upper[-1], whose, transform=axes.get_yaxis_transform(), fontsize=6.5,
                    color=colour, ha="right", va="bottom", zorder=6,
                )  # fmt: skip
    return notes


def _told(bound: Bound, finite: Floats, whose: str) -> str:
    """Return ``"velocity limit ±50"`` for what lies beyond the panel."""
    sizes = np.unique(np.abs(finite) if bound.derivative else finite)
    sign = "±" if bound.derivative else ""
    values = number(float(sizes[0]), 4)
    if sizes.size > 1:
        values += f" … {sign}{number(float(sizes[-1]), 4)}"
    return f"{bound.name}{' of ' if whose else ''}{whose} {sign}{values}"


# -- lines and points ----------------------------------------------------------------------------


def _line_by_speed(t: Floats, values: Floats, velocity: Floats, axes: Axes) -> Collection:
    from matplotlib.collections import LineCollection
    from matplotlib.colors import Normalize

    points = np.column_stack([t, values])
    speed = np.abs(velocity)
    found = LineCollection(
        list(np.stack([points[:-1], points[1:]], axis=1)),
        array=(speed[:-1] + speed[1:]) / 2,
        cmap=speed_map(),
        norm=Normalize(0.0, float(speed.max()) or 1.0),
        linewidths=2.2,
        capstyle="round",
        zorder=3,
    )
    axes.add_collection(found, autolim=False)
    return found


def _fixed(scene: Scene, own: list[int], known: Floats, axes: Axes, large: bool) -> None:
    """Mark what is fixed at the knots."""
    if len(scene.times) > MOST_KNOTS:
        return
    for column, axis in enumerate(own):
        at = np.isfinite(known[:, column])
        if at.any():
            axes.plot(
                scene.times[at], known[at, column], ls="", marker="o", ms=4.5 if large else 3.2,
                mfc="white", mec=BLACK if large else axis_style(axis)["color"], mew=0.9, zorder=4,
                gid="point" if large else "fixed",
            )  # fmt: skip


def _marks(scene: Scene, order: int, own: list[int], axes: Axes) -> None:
    marks = [mark for mark in scene.marks if mark.order == order and mark.axis in own]
    for mark in marks:
        axes.plot(
            mark.time, mark.value, ls="", marker="o", ms=9, mfc="none", mec=RED, mew=1.5,
            zorder=7, clip_on=False, gid="violation",
        )  # fmt: skip
    if marks:
        more = f" (and {len(marks) - 1} more)" if len(marks) > 1 else ""
        axes.set_title(told(marks[0]) + more, fontsize=7.5, color=RED, loc="right", pad=2.5)


def told(mark: Mark) -> str:
    """Return ``"velocity limit violated by 0.462 m/s at 1.026 s"``."""
    by = f"{number(mark.check.worst, 3)} {pretty_unit(mark.check.unit)}"
    return f"{mark.check.name} violated by {by} at {number(mark.time, 4)} s"
