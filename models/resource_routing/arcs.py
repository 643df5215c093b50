"""Arcs of a route with resources that its limits allow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.distance import cdist

from ...errors import UnsupportedFormulation
from .data import RoutingData

__all__ = ["UsedArcs", "least_levels", "possible_arcs", "require_few", "shortest_ways"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_CHUNK = 512
#: Maximum number of arcs of a program that fits into the memory of a common machine.
MOST_ARCS = 30_000_000
#: Maximum number of passes over the arcs for the least levels; every pass yields a valid bound.
_PASSES = 20


@dataclass(frozen=True)
class UsedArcs:
    """Arcs with lengths and uses, sorted by `tail` and `head`, point indices of shape (k,).

    `length`, shape (k,), is the length less the prize of the head and, for arcs out of the start, of the start.
    `use`, shape (k, r), includes the gain of the head.
    """

    tail: Ints
    head: Ints
    length: Floats
    use: Floats

    def __len__(self) -> int:
        return int(self.tail.size)

    def where(self, keep: Any) -> UsedArcs:
        """Return the arcs selected by the mask `keep`."""
        return UsedArcs(self.tail[keep], self.head[keep], self.length[keep], self.use[keep])


def _listed(model: RoutingData) -> UsedArcs:
    arcs = model.arcs
    assert arcs is not None
    order = np.lexsort((arcs[:, 1], arcs[:, 0]))
    tail, head = arcs[order].T
    if model.lengths is not None:
        length = model.lengths[order]
    else:
        assert model.points is not None
        length = np.linalg.norm(model.points[head] - model.points[tail], axis=1)
    use = length[:, None] * model.rates + model.gains[model.codes[head]]
    if model.uses is not None:
        use = use + model.uses[order]
    fits = (use <= model.rounded_limits[model.codes[head]]).all(axis=1)
    return UsedArcs(tail, head, length, use).where(
        fits & (head != model.start) & (tail != model.end)
    )


def _pairs(model: RoutingData, most: float) -> UsedArcs:
    """Return the arcs between points within the limits; `most` bounds the straight lines via an arc."""
    points = model.points
    assert points is not None
    gain, limit = model.gains[model.codes], model.rounded_limits[model.codes]
    behind, ahead = (
        np.linalg.norm(points - points[end], axis=1) for end in (model.start, model.end)
    )
    near = behind + ahead <= most
    near[[model.start, model.end]] = True
    chosen = np.flatnonzero(near)
    parts, total = [], 0
    for first in range(0, len(chosen), _CHUNK):
        rows = chosen[first : first + _CHUNK]
        length = cdist(points[rows], points[chosen])
        keep = behind[rows, None] + length + ahead[chosen] <= most
        keep &= rows[:, None] != chosen
        for k, rate in enumerate(model.rates):
            keep &= rate * length + gain[chosen, k] <= limit[chosen, k]
        keep[:, chosen == model.start] = False
        keep[rows == model.end] = False
        tail, head = np.nonzero(keep)
        total += tail.size
        require_few(total, len(points))
        parts.append((rows[tail], chosen[head], length[tail, head]))
    tail, head, lengths = (np.concatenate(part) for part in zip(*parts, strict=True))
    return UsedArcs(tail, head, lengths, lengths[:, None] * model.rates + gain[head])


def require_few(arcs: int, points: int) -> None:
    """Raise :class:`UnsupportedFormulation` for more than :data:`MOST_ARCS` arcs."""
    if arcs > MOST_ARCS:
        raise UnsupportedFormulation(
            f"a program with one column per arc would have more than {MOST_ARCS} of them for {points} "
            "points: use a native backend, or give the plan of one as a warm start"
        )


def least_levels(model: RoutingData, arcs: UsedArcs) -> Floats:
    """Return a lower bound on each level on leaving each point, shape (n, r); inf if unreachable.

    The bound is the minimum over incoming arcs of the tail's bound plus the use of the arc.
    """
    resets, floors = model.resets[model.codes], model.floors[model.codes]
    least = np.zeros((len(model.kinds), len(model.resources)))
    for _ in range(_PASSES):
        arrival = np.full(least.shape, np.inf)
        np.minimum.at(arrival, arcs.head, least[arcs.tail] + arcs.use)
        after = np.minimum(np.maximum(arrival, floors), resets)
        after = np.where(np.isfinite(arrival), after, np.inf)
        after[model.start] = model.initial
        if np.array_equal(after, least):
            break
        least = after
    return least


def shortest_ways(
    count: int, start: int, end: int, tail: Ints, head: Ints, length: Floats
) -> tuple[Floats, Floats]:
    """Return the shortest-path lengths from `start` to each point, and from each point to `end`."""
    # Zero-length arcs would vanish from a sparse graph.
    weight = np.maximum(length, np.finfo(float).tiny)
    graph = sp.csr_array((weight, (tail, head)), shape=(count, count))
    return dijkstra(graph, indices=start), dijkstra(graph.T.tocsr(), indices=end)


def possible_arcs(model: RoutingData, length_bound: float = np.inf) -> UsedArcs:
    """Return the arcs that a feasible route of at most `length_bound` may use.

    An arc is removed if it violates the head's limits even with the least levels on leaving the tail,
    if start or end is not connected to it, or if the shortest path through it is longer than
    `length_bound`, which does not apply to models with prizes. The tests are repeated until no arc is removed.
    """
    most = length_bound * (1 + 1e-9) if model.prizes is None and not model.has_prizes else np.inf
    arcs = _pairs(model, most) if model.arcs is None else _listed(model)
    if model.prizes is not None:
        prize = model.prizes[arcs.head] + np.where(
            arcs.tail == model.start, model.prizes[model.start], 0.0
        )
        arcs = replace(arcs, length=arcs.length - prize)
    limit = model.rounded_limits[model.codes]
    while True:
        least = least_levels(model, arcs)
        remaining = arcs.where((least[arcs.tail] + arcs.use <= limit[arcs.head]).all(axis=1))
        ahead, behind = shortest_ways(
            len(model.kinds),
            model.start,
            model.end,
            remaining.tail,
            remaining.head,
            np.maximum(remaining.length, 0.0),
        )
        through = ahead[remaining.tail] + np.maximum(remaining.length, 0.0) + behind[remaining.head]
        remaining = remaining.where((through <= most) & np.isfinite(through))
        if len(remaining) == len(arcs):
            return remaining
        arcs = remaining
