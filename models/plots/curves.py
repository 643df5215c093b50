"""Plain data of pictures over time: panels of curves, their limits, marks and phases."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Curve", "Floats", "Limit", "Mark", "Panel", "Span", "range_of", "true_intervals", "worst_of",
]  # fmt: skip

Floats = NDArray[np.float64]

#: Distance beyond which a limit is only mentioned in words, in heights of the curves.
_FAR = 1.2
#: Largest number of decades of a logarithmic panel.
_DECADES = 12


class Curve(NamedTuple):
    """Function of time: label, index of the colour (:func:`.style.axis_style`), points and width (point)."""

    name: str
    colour: int
    times: Floats
    values: Floats
    width: float = 1.4


class Limit(NamedTuple):
    """Bounds on curves at ascending `times`, constant or changing in steps; infinite for none.

    A time of a step appears twice. `colours` are those of the bounded curves, empty for all of the panel;
    `tolerance` is the excess above which the worst place is ringed. `label` and `dashes` describe the line.
    The region beyond a bound on all curves is `shaded`; that inside is filled if it has a label, `band`.
    """

    times: Floats
    lower: float | Floats
    upper: float | Floats
    colours: tuple[int, ...] = ()
    tolerance: float = np.inf
    label: str = "limit"
    dashes: str = "--"
    shaded: bool = True
    band: str = ""

    @property
    def sides(self) -> tuple[Floats, Floats]:
        """Lower and upper bound at :attr:`times`."""
        lower, upper = (np.full(len(self.times), side) for side in (self.lower, self.upper))
        return lower, upper


class Mark(NamedTuple):
    """Places marked in the colour of a curve, with a label in the legend.

    The labels ``"node"``, ``"fixed value"``, ``"waypoint"`` and ``"worst violation"`` have predefined markers;
    `look` are options of a matplotlib line, such as ``{"marker": "^"}``. A `note` is written above the panel.
    """

    label: str
    times: Floats
    values: Floats
    colour: int = 0
    look: Mapping[str, Any] = MappingProxyType({})
    note: str = ""


@dataclass(frozen=True, eq=False)
class Panel:
    """Content of one panel: label and unit of its axis, curves, bounds and marks.

    A `log` panel has a logarithmic axis and shows absolute values. In a `whole` panel, every limit is visible,
    however far from the curves. `shades` are shaded intervals of time by their label in the legend.
    """

    title: str
    unit: str
    curves: Sequence[Curve]
    limits: Sequence[Limit] = ()
    marks: Sequence[Mark] = ()
    log: bool = False
    whole: bool = False
    shades: Mapping[str, Sequence[tuple[float, float]]] = field(default_factory=dict)


class Span(NamedTuple):
    """Phase: name, start, end and knots of the mesh."""

    name: str
    start: float
    end: float
    knots: Floats = np.empty(0)


def true_intervals(mask: NDArray[np.bool_], times: Floats) -> list[tuple[float, float]]:
    """Return the intervals between `times`, one more than entries of `mask`, in which it is true."""
    edges = np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [(float(times[a]), float(times[b])) for a, b in zip(begins, ends, strict=True)]


def range_of(panel: Panel) -> tuple[float, float]:
    """Return the visible range: that of the curves and marks, and of the bounds near them."""
    drawn = [curve.values for curve in panel.curves] + [mark.values for mark in panel.marks]
    values = np.concatenate([np.empty(0), *drawn])
    values = values[np.isfinite(values)]
    edges = np.concatenate(
        [
            np.empty(0),
            *(np.ravel(side) for limit in panel.limits for side in (limit.lower, limit.upper)),
        ]
    )
    edges = edges[np.isfinite(edges)]
    if panel.log:
        sizes = np.abs(np.append(values, edges))
        sizes = sizes[sizes > 0.0]
        top = float(sizes.max(initial=0.0)) or 1.0
        return max(float(sizes.min(initial=top)), top * 10.0**-_DECADES) / 3, 3 * top
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    # Do not magnify curves that are constant up to rounding.
    span = high - low
    if span <= 1e-9 * max(1.0, abs(low), abs(high)):
        span = 0.0
    reach = _FAR * (span or float(np.abs(edges).max(initial=0.0)) or 1.0)
    near = edges[panel.whole | ((edges >= low - reach) & (edges <= high + reach))]
    low, high = float(near.min(initial=low)), float(near.max(initial=high))
    margin = 0.08 * (high - low)
    if not margin > 1e-9 * max(1.0, abs(low), abs(high)):
        margin = 0.5 * (abs(high) or 1.0)
    return low - margin, high + margin


def worst_of(panel: Panel) -> tuple[Floats, Floats] | None:
    """Return the place of the largest excess of a limit over its tolerance, or None."""
    largest, place = 1.0, None
    for limit, curve in itertools.product(panel.limits, panel.curves):
        disjoint = curve.times[0] >= limit.times[-1] or curve.times[-1] <= limit.times[0]
        # A phase that ends when the limit of the next one begins is not bounded by it.
        if disjoint or (limit.colours and curve.colour not in limit.colours):
            continue
        index = np.searchsorted(limit.times, curve.times, side="right") - 1
        inside = (index >= 0) & (curve.times <= limit.times[-1])
        lower, upper = (side[np.clip(index, 0, None)] for side in limit.sides)
        excess = np.maximum(curve.values - upper, lower - curve.values)
        excess = np.where(inside & np.isfinite(excess), excess, -np.inf)
        row = int(excess.argmax())
        share = float(excess[row]) / max(limit.tolerance, np.finfo(float).tiny)
        if share > largest:
            largest, place = share, (curve.times[[row]], curve.values[[row]])
    return place
