"""Array form of a route with resources: the useful arcs, sorted by tail."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ...errors import UnsupportedFormulation
from ...models.resource_routing.model import ResourceRouting
from ...models.verification import ROUNDING
from .arc_kernels import all_pairs, count_pairs, remaining
from .level_kernels import least_levels, most_levels

__all__ = ["MOST_NUMBERS", "Network", "distances", "network"]

#: Maximum number of array entries for the arcs of a network: about 1 GB.
MOST_NUMBERS = 120_000_000
#: Rounding error of a level, relative to the largest limit of its resource.
_SLACK = 1e-10

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]
Arcs = tuple[Whole, Whole, Floats, Floats]


class Network(NamedTuple):
    """Arcs by tail, with the limits and resets of the points.

    `first`, shape (n + 1,), is the first arc of each tail. The arcs have `head`, `length` (less the prize of the
    head and, out of the start, of the start) and `use`, shape (m, r), with the gain of the head. Per point and
    resource, shape (n, r): `limit` and `lower` on arrival, slack included; `floor`, to which waiting raises;
    `reset`; and `most`, the level on leaving above which the end is unreachable. Per resource, shape (r,): the
    `initial` level, and `full`, above which no lower limit refuses a label (-inf without lower limits).
    """

    first: Whole
    head: Whole
    length: Floats
    use: Floats
    limit: Floats
    reset: Floats
    most: Floats
    lower: Floats
    floor: Floats
    full: Floats
    initial: Floats
    start: int
    end: int


def network(model: ResourceRouting, rows: Whole, flag: NDArray[np.int8]) -> Network:
    """Return the network of the arcs between the points `rows` that each resource alone allows.

    An arc is omitted if the least level of a resource on leaving its tail exceeds the level allowed by the head
    and the rest of the route, considering one resource at a time. Arcs into the start or out of the end are
    omitted. Points are numbered by their positions in `rows`, which is ascending. For a model with listed arcs,
    `rows` must be all points. Raise ``UnsupportedFormulation`` for more than :data:`MOST_NUMBERS` entries.
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
    floor, lower = model.floors[codes], model.lower_limits[codes]
    # Of two levels above all lower limits, the same arcs make both equal at a reset or keep them above.
    top = lower.max(axis=0, initial=0.0)
    full = np.where(top == 0.0, -np.inf, top)
    lower = lower - ROUNDING * lower
    if model.prizes is not None:
        prizes = model.prizes[rows]
        length = length - prizes[head]
        length[first[start] : first[start + 1]] -= prizes[start]
    into = arcs_into(first, head)
    slack = _SLACK * np.max(limit, axis=0, initial=0.0, where=np.isfinite(limit))
    most = most_levels(
        *into, use, limit, reset, floor, slack, end, flag,
    )  # fmt: skip
    least = least_levels(first, head, use, limit, reset, floor, initial, start, flag)
    # After a stop these bounds are trivial, and the search stops, too.
    useful = remaining(first, head, length, use, limit, reset, floor, least, most)
    return Network(*useful, limit, reset, most, lower, floor, full, initial, start, end)


def counted(net: Network) -> Network:
    """Return `net` with the number of arcs as a further resource, which simple routes limit."""
    count, arcs = len(net.first) - 1, len(net.head)
    limit, most = np.full((count, 1), count - 1.0), np.full((count, 1), count - 1.0)
    none, endless = np.zeros((count, 1)), np.full((count, 1), np.inf)
    return net._replace(
        use=np.hstack([net.use, np.ones((arcs, 1))]), limit=np.hstack([net.limit, limit]),
        reset=np.hstack([net.reset, endless]), most=np.hstack([net.most, most]),
        lower=np.hstack([net.lower, none]), floor=np.hstack([net.floor, none]),
        full=np.append(net.full, -np.inf), initial=np.append(net.initial, 0.0),
    )  # fmt: skip


def shut_levels(net: Network) -> Floats:
    """Return the levels above which no arc leads to each point, shape (n, r); inf if resets may lower them."""
    least = np.full(net.limit.shape, np.inf)
    np.minimum.at(least, net.head, net.use)
    kept = np.isinf(net.reset).all(axis=0)
    return np.where(
        kept & np.isfinite(least), net.limit - np.where(np.isfinite(least), least, 0.0), np.inf
    )


def arcs_into(first: Whole, head: Whole) -> tuple[Whole, Whole, Whole]:
    """Return the first incoming arc of each point, and the indices and tails of the incoming arcs."""
    count = len(first) - 1
    into = csr_array((np.arange(len(head)), head, first), shape=(count, count)).tocsc()
    return into.indptr.astype(np.int64), into.data, into.indices.astype(np.int64)


def distances(points: Floats, at: int) -> Floats:
    """Return the straight-line distance from every point to point `at`, shape (n,); inf on overflow."""
    scaled, scale = _scaled(points)
    return _lines(scaled, scaled[at], scale)


def _lines(points: Floats, others: Floats, scale: float) -> Floats:
    with np.errstate(over="ignore"):
        lengths: Floats = scale * np.linalg.norm(points - others, axis=1)
    return lengths


def _listed(model: ResourceRouting, gain: Floats) -> Arcs:
    """Return the listed arcs: first arc of each tail, heads, lengths and uses."""
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
    # Same order of summation as in the verification, for equal rounding.
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
    """Return the arcs between all pairs of points within the limits, as :func:`_listed` does."""
    assert model.points is not None
    points, scale = _scaled(model.points[rows])
    rates = np.ascontiguousarray(model.rates)
    limit_of_arcs = MOST_NUMBERS // (2 + len(rates))
    first = count_pairs(points, scale, rates, gain, limit, start, end, limit_of_arcs, flag)
    if first[-1] > limit_of_arcs:
        raise UnsupportedFormulation(
            f"the limits of {len(rows)} points leave more than {limit_of_arcs:,} arcs, beyond which memory "
            "runs short: give a list of arcs, or tighter limits"
        )
    return first, *all_pairs(points, scale, rates, gain, limit, start, end, first)


def _scaled(points: Floats) -> tuple[Floats, float]:
    """Return the points divided by a power of two that prevents overflow of squares, and that power."""
    scale = math.ldexp(1.0, math.frexp(float(np.abs(points).max(initial=0.0)))[1] - 1)
    return points / scale, scale
