"""Routes of several vehicles on a map, one colour per vehicle, and the nodes that they visit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .space import dots
from .style import BLACK, DARK, RED, RING, axis_style, key

__all__ = ["draw_routes", "draw_stops", "name_vehicles", "ring"]

Floats = NDArray[np.float64]

#: Largest number of nodes with large dots, and of vehicles with names.
_MOST_LARGE, _MOST_NAMES = 150, 7


def draw_routes(axes: Any, lines: Sequence[Floats], *, gid: str, **look: Any) -> None:
    """Draw one polyline per vehicle without changing the limits of the axes.

    Parameters
    ----------
    axes : matplotlib axes
        Axes.
    lines : sequence of ndarray, each of shape (k, 2)
        Polylines, in the axes' unit.
    gid : str
        Identifier of the artist.
    **look
        Options of a matplotlib collection, except for colours and dashes.
    """
    from matplotlib.collections import LineCollection

    looks = [axis_style(k) for k in range(len(lines))]
    full: dict[str, Any] = {
        "colors": [style["color"] for style in looks], "linestyles": [style["ls"] for style in looks],
        "lw": 1.6, "zorder": 3, "capstyle": "round", "joinstyle": "round",
    }  # fmt: skip
    axes.add_collection(LineCollection(list(lines), gid=gid, **full | look), autolim=False)


def draw_stops(
    axes: Any, nodes: Floats, owners: NDArray[np.int64], depots: Floats, missed: Floats
) -> list[Any]:
    """Draw nodes in the colours of their vehicles, depots, and rings around missed nodes.

    Parameters
    ----------
    axes : matplotlib axes
        Axes.
    nodes : ndarray, shape (n, 2)
        Places to visit.
    owners : ndarray of int, shape (n,)
        Vehicle that visits each node; -1 for none.
    depots : ndarray, shape (d, 2)
        Starts and ends of routes.
    missed : ndarray, shape (k, 2)
        Places that are not visited exactly once.

    Returns
    -------
    list
        Entries of a legend.
    """
    faces: Any = [DARK if owner < 0 else axis_style(owner)["color"] for owner in owners.tolist()]
    dots(
        axes, nodes, "o", faces or DARK, size=26 if len(nodes) <= _MOST_LARGE else 8, edge="white",
        width=0.6, zorder=7, gid="node",
    )  # fmt: skip
    dots(axes, depots, "s", "white", size=52, edge=BLACK, width=1.5, zorder=8, gid="depot")
    keys = [key("depot", marker="s", mfc="white", mec=BLACK, mew=1.4, ms=6)]
    keys.append(key("node", marker="o", color=DARK, ms=5))
    return keys + ring(axes, missed, "not visited once")


def ring(axes: Any, places: Floats, label: str) -> list[Any]:
    """Draw a red ring around each of `places`, and return its legend entry; empty without places."""
    if not len(places):
        return []
    dots(axes, places, "o", "none", size=150, edge=RED, width=1.8, zorder=21, gid=label)
    return [key(label, **RING)]


def name_vehicles(count: int, word: str) -> list[Any]:
    """Return the legend entries for `count` vehicles, named by `word` and a number."""
    keys = [key(f"{word} {k}", lw=1.6, **axis_style(k)) for k in range(min(count, _MOST_NAMES))]
    return keys + [key(f"… {count} in all", ls="")] * (count > _MOST_NAMES)
