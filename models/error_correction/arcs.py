"""The arcs of an error-correction instance that its thresholds leave possible."""

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
#: Arcs above which a program would not fit into the memory of a common machine.
MOST_ARCS = 30_000_000


@dataclass(frozen=True)
class Arcs:
    """Arcs with their lengths, in order of tail and then head.

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
        """Return the arcs that `keep` marks."""
        return Arcs(self.tail[keep], self.head[keep], self.length[keep])


def all_arcs(model: ErrorCorrectionRouting) -> Arcs:
    """Return every arc that neither enters A, leaves B, nor joins a point to itself."""
    return _collect(model, by_threshold=False)


def _collect(
    model: ErrorCorrectionRouting, *, by_threshold: bool, length_bound: float = np.inf
) -> Arcs:
    """Return the arcs, without those that the thresholds or the straight way to B exclude."""
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
                f"a program with one column an arc would have more than {MOST_ARCS} of them for "
                f"{len(model.points)} points: use a native backend, such as 'label-setting', or "
                "give the plan of one as a warm start"
            )
        parts.append((chosen[tail + first], chosen[head], distance[tail, head]))
    tail, head, length = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Arcs(tail, head, length)


def possible_arcs(model: ErrorCorrectionRouting, length_bound: float = np.inf) -> Arcs:
    """Return the arcs that a route within the thresholds, and within `length_bound`, may use.

    An arc goes when its head's thresholds refuse it even with the least error with which its tail
    can be left, when its ends are not joined to A and B, or when the shortest way through it is
    longer than `length_bound` (m). All three only remove arcs that no such route uses, and are
    repeated until nothing more goes.
    """
    arcs = _collect(model, by_threshold=True, length_bound=length_bound)
    limit = model.rounded_limits[model.codes]
    while True:
        least = least_errors(model, arcs)
        own = np.where(model.codes[arcs.tail] == HORIZONTAL, 1, 0)
        rate = np.where(own == 1, model.vertical_rate, model.horizontal_rate)
        keep = least[arcs.tail] + rate * arcs.length <= limit[arcs.head, own]
        arcs_kept = arcs.where(keep)
        ahead, behind = shortest_ways(model, arcs_kept)
        through = ahead[arcs_kept.tail] + arcs_kept.length + behind[arcs_kept.head]
        arcs_kept = arcs_kept.where((through <= length_bound * (1 + 1e-9)) & np.isfinite(through))
        if len(arcs_kept) == len(arcs):
            return arcs_kept
        arcs = arcs_kept


def shortest_ways(
    model: ErrorCorrectionRouting, arcs: Arcs
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least lengths (m) over `arcs` from A to each point and from each point to B, shape (n,).

    They are infinite where there is no way.
    """
    n = len(model.points)
    # Zero-length arcs would vanish from a sparse graph.
    weight = np.maximum(arcs.length, np.finfo(float).tiny)
    graph = sp.csr_array((weight, (arcs.tail, arcs.head)), shape=(n, n))
    return dijkstra(graph, indices=model.start), dijkstra(graph.T.tocsr(), indices=model.end)


def shortest_length(model: ErrorCorrectionRouting, arcs: Arcs) -> float:
    """Return the least length (m) of a way from A to B over `arcs`, below which no route is; -inf without one."""
    found = float(shortest_ways(model, arcs)[1][model.start])
    return found if np.isfinite(found) else -np.inf


def least_errors(model: ErrorCorrectionRouting, arcs: Arcs) -> NDArray[np.float64]:
    """Return the least error with which each point can be left, shape (n,); inf where it cannot.

    What survives a correction grew over the last arc at least: the vertical error at a horizontal
    point, the horizontal one at a vertical point. It is 0 at A.
    """
    least = np.full(len(model.points), np.inf)
    rate = np.where(
        model.codes[arcs.head] == HORIZONTAL, model.vertical_rate, model.horizontal_rate
    )
    np.minimum.at(least, arcs.head, rate * arcs.length)
    least[model.codes == START] = 0.0
    return least
