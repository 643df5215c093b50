"""The plain data of a picture over time: panels of curves, their limits, marks and phases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Curve", "Limit", "Mark", "Panel", "Span"]

Floats = NDArray[np.float64]


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
