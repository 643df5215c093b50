"""Shared parts of all plots of a guided vehicle's tour: path, chains and axes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..plots import kit
from .data import GuidedPathData
from .plan import GuidedPathPlan

__all__ = ["Walk", "dress_line", "dress_walk", "groups_of", "look_of", "walk_of"]

Floats = NDArray[np.float64]

#: Markers of chains, one per cycle through the colours.
_MARKERS = ("o", "^", "D", "v", "P")


class Walk(NamedTuple):
    """Stops of a tour: customers in the order of service, with the start at both ends.

    Arrays have the shape (stops,): coordinates, and distances walked up to each stop, in m.
    """

    stops: list[int]
    places: Floats
    walked: Floats


def walk_of(model: GuidedPathData, plan: GuidedPathPlan) -> Walk:
    """Return the stops of a plan, which must contain only customers of the model."""
    stops = [0, *plan.order, 0]
    places = model.coordinates[stops]
    walked = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(places)))])
    return Walk(stops, places, walked)


def groups_of(model: GuidedPathData) -> tuple[tuple[int, ...], ...]:
    """Return the chains to draw: those of the model, or the minimum chain cover of its relation."""
    chains = [tuple(x for x in chain if x) for chain in model.chains] or model.cover
    return tuple(chain for chain in chains if len(chain) > 1)


def look_of(group: int) -> dict[str, Any]:
    """Return marker and colour of the customers of a chain; -1 selects those without a chain."""
    if group < 0:
        return {"marker": "o", "color": kit.DARK}
    return {"marker": _MARKERS[group // 7 % len(_MARKERS)], "color": kit.colour_of(group)}


def dress_line(axes: Any, model: GuidedPathData, *, labelled: bool) -> float:
    """Set the limits of the position axis, and return the factor from metres to its unit."""
    low, high = float(model.coordinates.min()), float(model.coordinates.max())
    scale, unit = kit.length_unit(high - low)
    # A line of length 0 determines no scale.
    around = 0.08 * (high - low) or max(1.0, 0.1 * abs(low))
    axes.set_xlim((low - around) * scale, (high + around) * scale)
    kit.bare(axes)
    _plain_ticks(axes.xaxis)
    kit.label_axes(axes, f"position ({unit})" if labelled else None)
    return scale


def _plain_ticks(axis: Any) -> None:
    """Format the ticks of an axis without a common factor."""
    from matplotlib.ticker import FuncFormatter

    axis.set_major_formatter(FuncFormatter(lambda value, _: kit.number(value, 7)))


def dress_walk(axes: Any, walk: Walk, scale: float, over: str = "walked") -> Floats:
    """Set the limits of the axis of the distance; return the stops' positions, shape (stops, 2)."""
    if over == "walked":
        size, unit = kit.length_unit(float(walk.walked[-1]))
        down, words = walk.walked * size, f"walked ({unit})"
    else:
        down, words = np.arange(len(walk.stops), dtype=float), "stops"
    around = 0.03 * float(down[-1]) or 0.5
    axes.set_ylim(float(down[-1]) + around, -around)
    kit.label_axes(axes, y=words)
    _plain_ticks(axes.yaxis)
    return np.column_stack([walk.places * scale, down])
