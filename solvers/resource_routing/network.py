"""A route with resources as plain arrays: the arcs that may be of use, by their tails."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from ...errors import UnsupportedFormulation
from ...models.resource_routing.model import ResourceRouting
from .arc_kernels import all_pairs, count_pairs, remaining
from .level_kernels import least_levels, most_levels

__all__ = ["MOST_NUMBERS", "Network", "distances", "lengths_to", "network"]

#: Numbers that the arcs of a network may hold: about 1 GB.
MOST_NUMBERS = 120_000_000
#: What rounding may add to a level, relative to the largest limit of its resource.
_SLACK = 1e-10

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]
Arcs = tuple[Whole, Whole, Floats, Floats]


class Network(NamedTuple):
    """Arcs by tail, and what the points do to the resources.

    Attributes
    ----------
    first : ndarray of int64, shape (n + 1,)
        Where the arcs of each tail begin.
    head : ndarray of int64, shape (m,)
        Where an arc leads.
    length : ndarray, shape (m,)
        Its length.
    use : ndarray, shape (m, r)
        What it adds to each resource, the gain of its head included.
    limit, reset, most : ndarray, shape (n, r)
        Largest level on arrival, slack included; level that is left at the most; level on leaving
        above which the end cannot be reached.
    initial : ndarray, shape (r,)
        Levels at the start.
    start, end : int
        Where routes begin and end.
    """

    first: Whole
    head: Whole
    length: Floats
    use: Floats
    limit: Floats
    reset: Floats
    most: Floats
    initial: Floats
    start: int
    end: int


def network(model: ResourceRouting, rows: Whole, flag: NDArray[np.int8]) -> Network:
    """Return the arcs between the points `rows` on which every single resource allows a route.

    An arc is left out where the least level of a resource with which its tail can be left exceeds
    what the head and the way from there to the end allow, other resources aside. Nothing ends at
    the start or begins at the end. Points are numbered by their places in `rows`, which are
    ascending and all points where the model lists its arcs.

    Raises
    ------
    UnsupportedFormulation
        More arcs than memory should hold.
    """
    codes = model.codes[rows]
    limit, reset, gain = (
        table[codes] for table in (model.rounded_limits, model.resets, model.gains)
    )
    start, end = np.searchsorted(rows, [model.start, model.end]).tolist()
    initial = np.ascontiguousarray(model.initial)
    if model.arcs is None:
        first, head, length, use = _pairs(model, rows, gain, limit, start, end, flag)
    else:
        first, head, length, use = _listed(model, gain)
    count = len(rows)
    into = csr_array((np.arange(len(head)), head, first), shape=(count, count)).tocsc()
    slack = _SLACK * np.max(limit, axis=0, initial=0.0, where=np.isfinite(limit))
    most = most_levels(
        into.indptr.astype(np.int64), into.data, into.indices.astype(np.int64),
        use, limit, reset, slack, end, flag,
    )  # fmt: skip
    least = least_levels(first, head, use, limit, reset, initial, start, flag)
    # Where the flag stops these bounds, the search stops as well.
    kept = remaining(first, head, length, use, limit, reset, least, most)
    return Network(*kept, limit, reset, most, initial, start, end)


def lengths_to(net: Network, ends: Whole) -> Floats:
    """Return the least length from every point to each of `ends`; inf where there is no way.

    The shape is (n, ends). It ignores the resources.
    """
    count = len(net.first) - 1
    if ends.size == 0:
        return np.empty((count, 0))
    forward = csr_array((net.length, net.head, net.first), shape=(count, count))
    return np.ascontiguousarray(dijkstra(forward.T, indices=ends).T)


def distances(points: Floats, at: int) -> Floats:
    """Return the straight line from every point to that with index `at`; inf beyond all floats."""
    scaled, scale = _scaled(points)
    return _lines(scaled, scaled[at], scale)


def _lines(one: Floats, other: Floats, scale: float) -> Floats:
    with np.errstate(over="ignore"):
        found: Floats = scale * np.linalg.norm(one - other, axis=1)
    return found


def _listed(model: ResourceRouting, gain: Floats) -> Arcs:
    """Return the listed arcs: where those of each tail begin, heads, lengths and uses."""
    assert model.arcs is not None
    tail, head = model.arcs.T
    if model.lengths is None:
        assert model.points is not None
        points, scale = _scaled(model.points)
        length = _lines(points[tail], points[head], scale)
    else:
        length = model.lengths
    rows = np.flatnonzero((head != model.start) & (tail != model.end) & np.isfinite(length))
    rows = rows[np.lexsort((head[rows], tail[rows]))]
    tail, head, length = tail[rows], np.ascontiguousarray(head[rows]), length[rows]
    # Added in the order of the verification.
    with np.errstate(over="ignore"):
        use = length[:, None] * model.rates
        if model.uses is not None:
            use += model.uses[rows]
        use += gain[head]
    return np.searchsorted(tail, np.arange(len(gain) + 1)), head, length, use


def _pairs(
    model: ResourceRouting,
    rows: Whole,
    gain: Floats,
    limit: Floats,
    start: int,
    end: int,
    flag: NDArray[np.int8],
) -> Arcs:
    """Return the same of all pairs of points that the limits allow by themselves."""
    assert model.points is not None
    points, scale = _scaled(model.points[rows])
    rates = np.ascontiguousarray(model.rates)
    most = MOST_NUMBERS // (2 + len(rates))
    first = count_pairs(points, scale, rates, gain, limit, start, end, most, flag)
    if first[-1] > most:
        raise UnsupportedFormulation(
            f"the limits of {len(rows)} points leave more than {most:,} arcs, beyond which memory "
            "runs short: give a list of arcs, or tighter limits"
        )
    return first, *all_pairs(points, scale, rates, gain, limit, start, end, first)


def _scaled(points: Floats) -> tuple[Floats, float]:
    """Return the points divided by a power of two, so that no square overflows, and that power."""
    scale = math.ldexp(1.0, math.frexp(float(np.abs(points).max(initial=0.0)))[1] - 1)
    return points / scale, scale
