"""Markers in a plane and in space, and axes in space with a common point of view."""

from __future__ import annotations

from typing import Any

from numpy import float64
from numpy.typing import NDArray

__all__ = ["dots", "dress_space", "space_axes"]


def space_axes(figure: Any, place: tuple[float, float, float, float]) -> Any:
    """Return axes in space that draw by ``zorder``; otherwise lines could hide nearer markers."""
    return figure.add_axes(place, projection="3d", computed_zorder=False)


def dress_space(axes: Any, *, above: float = 28) -> None:
    """Set the point of view, `above` the floor (degrees), and draw a faint box.

    Call it after everything else is drawn: it disables clipping at the square around the box.
    """
    from matplotlib.ticker import MaxNLocator

    axes.tick_params(labelsize=7.5, pad=0)
    axes.view_init(elev=above, azim=-62)
    for pane in (axes.xaxis, axes.yaxis, axes.zaxis):
        pane.pane.set_facecolor("white")
        pane.pane.set_edgecolor("#d0d0d0")
        pane._axinfo["grid"].update(color="#e6e6e6", linewidth=0.6)
        pane.set_major_locator(MaxNLocator(nbins=5))
    for artist in (*axes.collections, *axes.lines):
        artist.set_clip_on(False)


def dots(
    axes: Any, places: NDArray[float64], marker: str, face: str, *, size: float, zorder: float,
    edge: str = "none", width: float = 1.0, **more: Any,
) -> Any:  # fmt: skip
    """Draw markers at `places` of a plane or of space, (k, 2) or (k, 3), and return them.

    `size` is the area of a marker (square points), and `width` that of its edge (points).
    """
    depth = {"depthshade": False} if places.shape[1] == 3 else {}
    return axes.scatter(
        *places.T, marker=marker, s=size, facecolors=face, edgecolors=edge, zorder=zorder,
        linewidths=0 if edge == "none" else width, **depth, **more,
    )  # fmt: skip
