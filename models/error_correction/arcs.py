"""Arcs of an error-correction instance that its thresholds allow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.distance import cdist

from ...errors import UnsupportedFormulation
from .model import END, HORIZONTAL, START, ErrorCorrectionRouting

__all__ = ["Arcs", "all_arcs", "least_errors", "possible_arcs", "shortest_length"]

_CHUNK = 512
#: Maximum number of arcs of a program that fits into the memory of a common machine.
MOST_ARCS = 30_000_000


@dataclass(frozen=True)
class Arcs:
    """Arcs with their lengths, sorted by tail and head.

    Parameters
    ----------
    tail, head : ndarray of int, shape (k,)
        Point indices.
    length : ndarray, shape (k,)
        Lengths (m).
    """

    tail: NDArray[np.int64]
    head: NDArray[np.int64]
    length: NDArray[np.float64]

    def __len__(self) -> int:
        return int(self.tail.size)

    def where(self, keep: NDArray[np.bool_]) -> Arcs:
        """Return the arcs selected by the mask `keep`."""
        return Arcs(self.tail[keep], self.head[keep], self.length[keep])


def all_arcs(model: ErrorCorrectionRouting) -> Arcs:
    """Return all arcs except those into A, out of B, and from a point to itself."""
    return _collect(model, by_threshold=False)


def _collect(
    model: ErrorCorrectionRouting, *, by_threshold: bool, length_bound: float = np.inf
) -> Arcs:
    """Return the arcs not excluded by thresholds or by the straight line to B."""
    from_start = np.linalg.norm(model.points - model.points[model.start], axis=1)
    to_end = np.linalg.norm(model.points - model.points[model.end], axis=1)
    most = length_bound * (1 + 1e-9)
    near = from_start + to_end <= most
    near[[model.start, model.end]] = True
    chosen = np.flatnonzero(near)
    points, codes = model.points[chosen], model.codes[chosen]
    limit = model.rounded_limits[codes]
    parts = []
    total = 0
    for first in range(0, len(chosen), _CHUNK):
        rows = np.arange(first, min(first + _CHUNK, len(chosen)))
        distance = cdist(points[rows], points)
        keep = from_start[chosen[rows], None] + distance + to_end[None, chosen] <= most
        if by_threshold:
            keep &= model.horizontal_rate * distance <= limit[None, :, 0]
            keep &= model.vertical_rate * distance <= limit[None, :, 1]
        keep[rows - first, rows] = False
        keep[codes[rows] == END] = False
        keep[:, codes == START] = False
        tail, head = np.nonzero(keep)
        total += tail.size
        if total > MOST_ARCS:
            raise UnsupportedFormulation(
                f"a program with one column per arc would have more than {MOST_ARCS} of them for "
                f"{len(model.points)} points: use a native backend, such as 'label-setting', or "
                "give the plan of one as a warm start"
            )
        parts.append((chosen[tail + first], chosen[head], distance[tail, head]))
    tail, head, length = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Arcs(tail, head, length)


def possible_arcs(model: ErrorCorrectionRouting, length_bound: float = np.inf) -> Arcs:
    """Return the arcs that a feasible route of at most `length_bound` (m) may use.

    An arc is removed if it violates the head's thresholds even with the least error on leaving the
    tail, if A or B is not connected to it, or if the shortest path through it is longer than
    `length_bound`. The tests are repeated until no arc is removed.
    """
    arcs = _collect(model, by_threshold=True, length_bound=length_bound)
    limit = model.rounded_limits[model.codes]
    while True:
        least = least_errors(model, arcs)
        axis = np.where(model.codes[arcs.tail] == HORIZONTAL, 1, 0)
        rate = np.where(axis == 1, model.vertical_rate, model.horizontal_rate)
        keep = least[arcs.tail] + rate * arcs.length <= limit[arcs.head, axis]
        remaining = arcs.where(keep)
        ahead, behind = shortest_ways(model, remaining)
        through = ahead[remaining.tail] + remaining.length + behind[remaining.head]
        remaining = remaining.where((through <= length_bound * (1 + 1e-9)) & np.isfinite(through))
        if len(remaining) == len(arcs):
            return remaining
        arcs = remaining


def shortest_ways(
    model: ErrorCorrectionRouting, arcs: Arcs
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the shortest-path lengths over `arcs` from A to each point and from each point to B.

    Both have shape (n,) and are in m; entries without a path are infinite.
    """
    n = len(model.points)
    # Zero-length arcs would vanish from a sparse graph.
    weight = np.maximum(arcs.length, np.finfo(float).tiny)
    graph = sp.csr_array((weight, (arcs.tail, arcs.head)), shape=(n, n))
    return dijkstra(graph, indices=model.start), dijkstra(graph.T.tocsr(), indices=model.end)


def shortest_length(model: ErrorCorrectionRouting, arcs: Arcs) -> float:
    """Return the shortest-path length from A to B over `arcs`, m, a lower bound; -inf without a path."""
    length = float(shortest_ways(model, arcs)[1][model.start])
    return length if np.isfinite(length) else -np.inf


def least_errors(model: ErrorCorrectionRouting, arcs: Arcs) -> NDArray[np.float64]:
    """Return a lower bound on the error on leaving each point, shape (n,); inf for unreachable points.

    The surviving error is at least the gain on the last arc: the vertical error at a horizontal point,
    the horizontal one at a vertical point. It is 0 at A.
    """
    least = np.full(len(model.points), np.inf)
    rate = np.where(
        model.codes[arcs.head] == HORIZONTAL, model.vertical_rate, model.horizontal_rate
    )
    np.minimum.at(least, arcs.head, rate * arcs.length)
    least[model.codes == START] = 0.0
    return least
