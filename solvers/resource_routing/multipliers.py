r"""Lagrangean bounds on routes: multipliers of the resources that nothing resets.

With multipliers :math:`\lambda \ge 0`, every route within the limits :math:`L` at the end has at least the
length :math:`\min_P (c(P) + \lambda u(P)) - \lambda L`, and the same holds for the rest of a route. The best
multipliers are those of the linear relaxation. Cutting planes find them (J. E. Kelley, 1960), as G. Y. Handler
and I. Zang do for one resource ("A dual algorithm for the constrained shortest path problem", Networks 10,
1980). If lengths are negative, the multipliers must leave no cycle of negative weight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from .network import Network, arcs_into
from .way_kernels import least_ways

__all__ = ["Bounds", "best_bounds", "plain_bounds"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]

#: Most cutting planes, and the relative gap of the dual at which they end.
ROUNDS, CLOSE = 60, 1e-4


@dataclass(frozen=True)
class Bounds:
    """Lagrangean bounds of a network.

    `weight`, shape (r,), are the multipliers, `ahead`, shape (n,), the bound on the rest of a route plus the
    weighted levels, `reduced`, shape (m,), the excess >= 0 of each arc, and `rounding` the error of the bounds.
    """

    weight: Floats
    ahead: Floats
    reduced: Floats
    rounding: float

    def via(self, net: Network, points: Whole) -> Floats:
        """Return the bounds on routes through each of `points`, shape (n, points)."""
        count = len(self.ahead)
        if points.size == 0:
            return np.empty((count, 0))
        graph = csr_array((self.reduced, net.head, net.first), shape=(count, count))
        between = dijkstra(graph.T, indices=points).T
        return np.ascontiguousarray(
            np.where(np.isinf(between), np.inf, between + self.ahead[:, None])
        )


def plain_bounds(net: Network) -> Bounds:
    """Return the bounds of the least lengths to the end.

    With negative lengths, the last resource must be the number of arcs (:func:`.network.counted`). Its
    multiplier is the least that leaves no arc of negative weight.
    """
    count, weight = len(net.first) - 1, np.zeros(len(net.initial))
    shift = max(-float(net.length.min(initial=0.0)), 0.0)
    if shift > 0.0:
        weight[-1] = shift
    length = net.length + shift
    graph = csr_array((length, net.head, net.first), shape=(count, count))
    ahead = np.ascontiguousarray(dijkstra(graph.T, indices=net.end))
    return _bounds(net, weight, length, ahead, shift * (count - 1))


def _bounds(net: Network, weight: Floats, length: Floats, ahead: Floats, shift: float) -> Bounds:
    tail = np.repeat(np.arange(len(ahead)), np.diff(net.first))
    with np.errstate(invalid="ignore"):
        reduced = length + ahead[net.head] - ahead[tail]
    reduced = np.where(np.isfinite(reduced), reduced, np.inf)
    # A bound exceeds the least weight of a rest by no more than its excesses below 0, one per arc.
    most, over = (-float(values.min(initial=0.0)) for values in (length, reduced))
    rounding = 2e-12 * shift + len(ahead) * (1e-12 * most + over)
    return Bounds(weight, ahead - shift, np.maximum(reduced, 0.0), rounding)


def cumulative(net: Network) -> Whole:
    """Return the resources with a limit at the end that no point resets."""
    return np.flatnonzero(np.isfinite(net.limit[net.end]) & np.isinf(net.reset).all(axis=0))


def best_bounds(net: Network) -> Bounds | None:
    """Return the bounds of the best multipliers; None if they are no better than none, or not found."""
    from scipy.optimize import linprog

    some, into = cumulative(net), arcs_into(net.first, net.head)
    room = net.limit[net.end, some]
    use, size = net.use[:, some], float(np.abs(net.length).max(initial=0.0))
    heads = np.r_[net.head, net.end]
    # No longer part of the program than the rows: z - lambda (u - L) <= c for paths, -lambda u <= c for cycles.
    rows: list[Floats] = []
    sides: list[float] = []
    scale = np.maximum(room, use.max(axis=0, initial=0.0))
    if not some.size or not size > 0 or not np.isfinite(scale / size).all():
        return None
    scale[scale == 0.0] = 1.0
    start, best, result = net.initial[some] / scale, -np.inf, None
    weight, upper, limit = np.zeros(some.size), 4.0 * len(into[0]), room / scale
    for _ in range(ROUNDS):
        weights = net.length / size + (use / scale) @ weight
        rounding = 1e-13 * float(np.abs(weights).max(initial=0.0))
        ahead, following, cycle = least_ways(*into, weights, net.end, rounding)
        used, at = [], cycle if cycle >= 0 else net.start
        while at != net.end and following[at] >= 0:
            used.append(int(following[at]))
            at = int(heads[used[-1]])
            if at == cycle:
                break
        total, cost = (use[used] / scale).sum(axis=0), float(net.length[used].sum()) / size
        if cycle >= 0:
            rows.append(np.r_[0.0, -total])
            sides.append(cost)
        elif not np.isfinite(ahead[net.start]):
            return None
        else:
            value = float(ahead[net.start] + weight @ (start - limit))
            if value > best:
                best, result = value, (weight, weights, ahead)
            rows.append(np.r_[1.0, limit - start - total])
            sides.append(cost)
        program = linprog(
            np.r_[-1.0, np.full(some.size, 1e-6)], np.array(rows), np.array(sides),
            bounds=[(None, upper), *[(0.0, upper)] * some.size],
        )  # fmt: skip
        if program.x is None:
            break
        if result is not None and -program.fun - best <= CLOSE * max(abs(best), 1e-9):
            break
        weight = program.x[1:]
        if result is not None and some.size > 1:
            weight = 0.5 * (weight + result[0])
    if result is None:
        return None
    weight, weights, ahead = result
    whole = np.zeros(len(net.initial))
    whole[some] = weight * size / scale
    return _bounds(net, whole, weights * size, ahead * size, float(weight @ limit) * size)
