"""Kernels of the local search: exchanges of two adjacent segments of a path that satisfy the precedence pairs.

Segments [i + 1, j] and [j + 1, k] change places. This is the only exchange of three arcs that keeps the directions,
"path-preserving 3-exchange" in L. M. Gambardella, M. Dorigo, "An ant colony system hybridized with a new local
search for the sequential ordering problem", INFORMS Journal on Computing 12, 2000. There, the precedence test
labels the successors of the left segment. Here, it checks only direct pairs between the segments: they are
adjacent, so a chain of pairs from the left to the right one has a direct pair between them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["DRAWS", "Paths", "anneal"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Largest number of positions that a scan of the shorter segment covers, and of both segments of a backward arc.
_SCAN, _BACK = 50, 200
#: Random exchanges per iteration, their largest segment, and the distance of their positions.
_KICKS, _KICK, _NEAR = 3, 30, 30
#: Uniform numbers per iteration: position and both lengths of the exchanges, acceptance.
DRAWS = 3 * _KICKS + 1


class Paths(NamedTuple):
    """Data and state of the local search.

    Parameters
    ----------
    cost : ndarray, shape (n, n)
        Distances, with a large number for missing arcs.
    near : ndarray of int, shape (n, m)
        Nearest possible successors of each node, nearest first; -1 after the last one.
    before, after : ndarray of int, shape (pairs,)
        Direct predecessors and successors, node by node.
    first_before, first_after : ndarray of int, shape (n + 1,)
        First entry of each node in `before` and `after`.
    path, place : ndarray of int, shape (n,)
        Nodes in order, and position of each node.
    queue : ndarray of int, shape (n,)
        Circular queue of the nodes whose exchanges are not yet tested; the others have "don't look" bits.
    waits : ndarray of bool, shape (n,)
        Whether a node is in the queue.
    log : ndarray of int, shape (moves, 3)
        Exchanges since the last accepted path.
    spare : ndarray of int, shape (n,)
        Scratch space.
    """

    cost: Floats
    near: Ints
    before: Ints
    first_before: Ints
    after: Ints
    first_after: Ints
    path: Ints
    place: Ints
    queue: Ints
    waits: NDArray[np.bool_]
    log: Ints
    spare: Ints


@kernel
def _exchange(it: Paths, i: int, j: int, k: int) -> None:
    """Exchange segments [i + 1, j] and [j + 1, k]."""
    for p in range(i + 1, j + 1):
        it.spare[p] = it.path[p]
    for p in range(j + 1, k + 1):
        node = it.path[p]
        it.path[p - j + i] = node
        it.place[node] = p - j + i
    for p in range(i + 1, j + 1):
        node = it.spare[p]
        it.path[p + k - j] = node
        it.place[node] = p + k - j


@kernel
def _gain(it: Paths, i: int, j: int, k: int) -> float:
    """Return by how much the exchange shortens the path."""
    cost, path = it.cost, it.path
    a, b, c, d, e, f = path[i], path[i + 1], path[j], path[j + 1], path[k], path[k + 1]
    return float(cost[a, b] + cost[c, d] + cost[e, f] - cost[a, d] - cost[e, b] - cost[c, f])


@kernel
def _is_between(others: Ints, first: Ints, place: Ints, node: int, low: int, high: int) -> bool:
    """Return whether one of the `others` of `node` has a position from `low` to `high`."""
    for m in range(first[node], first[node + 1]):  # noqa: SIM110 - Numba has no generators
        if low <= place[others[m]] <= high:
            return True
    return False


@kernel
def _best_exchange(it: Paths, node: int, least: float) -> tuple[float, int, int, int]:
    """Return the best exchange with a shorter arc from `node`, and its gain, which exceeds `least`."""
    path, place, last = it.path, it.place, len(it.path) - 1
    at = place[node]
    best, bi, bj, bk = least, -1, -1, -1
    if at == last:
        return best, bi, bj, bk
    old = it.cost[node, path[at + 1]]
    for m in range(it.near.shape[1]):
        head = it.near[node, m]
        if head < 0 or it.cost[node, head] >= old:
            break
        to = place[head]
        if to > at + 1:
            # The arc enters the right segment: i = at, j = to - 1.
            for k in range(to, min(last, to + _SCAN)):
                if _is_between(it.before, it.first_before, place, path[k], at + 1, to - 1):
                    break
                gain = _gain(it, at, to - 1, k)
                if gain > best:
                    best, bi, bj, bk = gain, at, to - 1, k
            # The arc leaves the left segment: j = at, k = to - 1.
            for i in range(at - 1, max(-1, at - 1 - _SCAN), -1):
                if _is_between(it.after, it.first_after, place, path[i + 1], at + 1, to - 1):
                    break
                gain = _gain(it, i, at, to - 1)
                if gain > best:
                    best, bi, bj, bk = gain, i, at, to - 1
        elif 0 < to < at < last and at - to < _BACK:
            # The arc leads from the right segment to the left one: i = to - 1, k = at.
            reach = to
            for j in range(to, at):
                for p in range(it.first_after[path[j]], it.first_after[path[j] + 1]):
                    follower = place[it.after[p]]
                    if reach < follower <= at:
                        reach = follower
                if reach <= j:
                    gain = _gain(it, to - 1, j, at)
                    if gain > best:
                        best, bi, bj, bk = gain, to - 1, j, at
    return best, bi, bj, bk


@kernel
def _push(it: Paths, node: int, ends: Ints) -> None:
    if not it.waits[node]:
        it.waits[node] = True
        it.queue[ends[1] % len(it.queue)] = node
        ends[1] += 1


@kernel
def _apply(it: Paths, i: int, j: int, k: int, ends: Ints) -> None:
    """Exchange the segments, and put the ends of the changed arcs into the queue."""
    _exchange(it, i, j, k)
    middle = i + k - j
    for p in (i, i + 1, middle, middle + 1, k, k + 1):
        _push(it, it.path[p], ends)


@kernel
def anneal(
    it: Paths, shortest: Ints, lengths: Floats, hot: float, cold: float, draws: Floats, small: float,
    first: bool, flag: NDArray[np.int8],
) -> int:  # fmt: skip
    """Iterate random exchanges and local searches, with the acceptance of simulated annealing.

    `shortest`, shape (n,): updated with the shortest path. `lengths`, shape (2,): updated lengths of the
    current and of the shortest path. `hot`, `cold`: temperatures of the first and the last iteration, in units
    of the distances. `draws`, shape (iterations, DRAWS): uniform random numbers. `small`: gain above which an
    exchange counts, for rounding errors. `first`: whether to begin with a local search from all nodes. Result:
    number of iterations.
    """
    size, ends = len(it.path), np.zeros(2, np.int64)
    count = 0
    if first:
        for p in range(size):
            _push(it, it.path[p], ends)
    for step in range(-1 if first else 0, len(draws)):
        moves, change = 0, 0.0
        for kick in range(_KICKS if step >= 0 else 0):
            # The later exchanges are near the first one, so that no single exchange reverses all.
            draw = draws[step, 3 * kick : 3 * kick + 3]
            i = int(draw[0] * (size - 3))
            if kick > 0:
                i = int(draws[step, 0] * (size - 3) + (2.0 * draw[0] - 1.0) * _NEAR)
                i = min(max(i, 0), size - 4)
            j = min(i + 1 + int(_KICK * draw[1] * draw[1]), size - 3)
            most = min(j + 1 + int(_KICK * draw[2] * draw[2]), size - 2)
            k = j
            while k < most and not _is_between(
                it.before, it.first_before, it.place, it.path[k + 1], i + 1, j
            ):
                k += 1
            if k > j:
                change -= _gain(it, i, j, k)
                _apply(it, i, j, k, ends)
                it.log[moves, 0], it.log[moves, 1], it.log[moves, 2] = i, j, k
                moves += 1
        if step >= 0 and moves == 0:
            continue
        while ends[0] < ends[1] and flag[0] == 0:
            node = it.queue[ends[0] % size]
            ends[0] += 1
            it.waits[node] = False
            if step >= 0 and moves == len(it.log):
                continue
            gain, i, j, k = _best_exchange(it, node, small)
            if i < 0:
                continue
            change -= gain
            _push(it, node, ends)
            _apply(it, i, j, k, ends)
            if step >= 0:
                it.log[moves, 0], it.log[moves, 1], it.log[moves, 2] = i, j, k
                moves += 1
        heat = hot + (cold - hot) * max(step, 0) / max(len(draws), 1)
        if step >= 0 and change > -heat * math.log(max(draws[step, 3 * _KICKS], 1e-300)):
            for m in range(moves - 1, -1, -1):
                i, j, k = it.log[m, 0], it.log[m, 1], it.log[m, 2]
                _exchange(it, i, i + k - j, k)
        else:
            lengths[0] += change
            if lengths[0] < lengths[1] - small:
                lengths[1] = lengths[0]
                for k in range(len(shortest)):
                    shortest[k] = it.path[k]
        count += 1
        if flag[0]:
            # The queue must be empty at the next call.
            while ends[0] < ends[1]:
                it.waits[it.queue[ends[0] % size]] = False
                ends[0] += 1
            break
    return count
