"""The plain data of a picture over time: panels of curves, their limits, marks and phases."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Curve", "Limit", "Mark", "Panel", "Span", "range_of", "worst_of"]

Floats = NDArray[np.float64]

#: A limit farther away than this many times the height of the curves is told in words.
_FAR = 1.2
#: Decades that a logarithmic panel shows at the most.
_DECADES = 12


class Curve(NamedTuple):
    """One function of time.

    Parameters
    ----------
    name : str
        What it is called in the legend.
    colour : int
        The number of its colour, see :func:`.style.axis_style`.
    times, values : ndarray, shape (points,)
        The curve.
    width : float
        Width of the line (point).
    """

    name: str
    colour: int
    times: Floats
    values: Floats
    width: float = 1.4


class Limit(NamedTuple):
    """A bound that curves have for some time; it may change in steps.

    Parameters
    ----------
    times : ndarray, shape (points,)
        When it holds, ascending; where it changes, a time comes twice.
    lower, upper : float or ndarray, shape (points,)
        The bound; infinite where there is none.
    colours : tuple of int
        The colours of the curves that it bounds; empty for all of the panel.
    tolerance : float
        By how much it may be exceeded before the worst place is ringed.
    label : str
        What the legend calls its line.
    dashes : str
        Dashes of its line.
    shaded : bool
        Whether what lies beyond it is shaded, where it bounds all curves of the panel.
    band : str
        What the legend calls the region inside it, which is filled; empty where it is not.
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
        """Both bounds at :attr:`times`."""
        lower, upper = (np.full(len(self.times), side) for side in (self.lower, self.upper))
        return lower, upper


class Mark(NamedTuple):
    """Places on or beside a curve.

    Parameters
    ----------
    label : str
        What the legend calls them; ``"node"``, ``"fixed value"``, ``"waypoint"`` and ``"worst
        violation"`` have a look of their own.
    times, values : ndarray, shape (points,)
        The places.
    colour : int
        The number of their colour, that of the curve they belong to.
    look : mapping
        Options of a matplotlib line that change their look, such as ``{"marker": "^"}``.
    note : str
        Written above the panel, in red.
    """

    label: str
    times: Floats
    values: Floats
    colour: int = 0
    look: Mapping[str, Any] = MappingProxyType({})
    note: str = ""


@dataclass(frozen=True, eq=False)
class Panel:
    """What one panel shows.

    Parameters
    ----------
    title, unit : str
        Label of the axis.
    curves : sequence of Curve
        What is drawn.
    limits : sequence of Limit
        What bounds it.
    marks : sequence of Mark
        Places that are marked.
    log : bool
        Whether the values are drawn by their logarithm.
    whole : bool
        Whether every limit is in sight, however far away.
    shades : mapping of str to a sequence of (float, float)
        Stretches of time that are shaded, by what the legend calls them.
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
    """A phase: its name, when it begins and ends, and the knots of its mesh."""

    name: str
    start: float
    end: float
    knots: Floats


def range_of(panel: Panel) -> tuple[float, float]:
    """Return the limits of the panel: of what is drawn, and of the bounds that are near it."""
    drawn = [curve.values for curve in panel.curves] + [mark.values for mark in panel.marks]
    values = np.concatenate([np.empty(0), *drawn])
    values = values[np.isfinite(values)]
    edges = np.concatenate(
        [np.empty(0), *(np.ravel(side) for one in panel.limits for side in (one.lower, one.upper))]
    )
    edges = edges[np.isfinite(edges)]
    if panel.log:
        sizes = np.abs(np.append(values, edges))
        sizes = sizes[sizes > 0.0]
        top = float(sizes.max(initial=0.0)) or 1.0
        return max(float(sizes.min(initial=top)), top * 10.0**-_DECADES) / 3, 3 * top
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    # What is constant but for rounding is not blown up.
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
    """Return where a limit is exceeded most, by more than its tolerance; None where none is."""
    best, place = 1.0, None
    for limit, curve in itertools.product(panel.limits, panel.curves):
        apart = curve.times[0] >= limit.times[-1] or curve.times[-1] <= limit.times[0]
        # A phase that ends where the limit of the next begins is not bound by it.
        if apart or (limit.colours and curve.colour not in limit.colours):
            continue
        at = np.searchsorted(limit.times, curve.times, side="right") - 1
        inside = (at >= 0) & (curve.times <= limit.times[-1])
        lower, upper = (side[np.clip(at, 0, None)] for side in limit.sides)
        over = np.maximum(curve.values - upper, lower - curve.values)
        over = np.where(inside & np.isfinite(over), over, -np.inf)
        row = int(over.argmax())
        share = float(over[row]) / max(limit.tolerance, np.finfo(float).tiny)
        if share > best:
            best, place = share, (curve.times[[row]], curve.values[[row]])
    return place
