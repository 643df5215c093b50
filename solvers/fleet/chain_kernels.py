"""Loops of chained Lin-Kernighan search for a closed tour.

A step of Lin and Kernighan exchanges edges of a tour as long as the sum of gains is positive, and keeps the
best tour on the way; or-opt moves short segments. Between two local optima, a double bridge exchanges two
neighbouring short segments, and a worse result is undone unless annealing accepts it. Tours are arrays; all
moves are reversals of paths.

Sources: S. Lin and B. W. Kernighan, "An effective heuristic algorithm for the traveling-salesman problem",
Operations Research 21, 1973; O. Martin, S. W. Otto and E. W. Felten, "Large-step Markov chains for the
traveling salesman problem", Complex Systems 5, 1991; D. Applegate, W. Cook and A. Rohe, "Chained
Lin-Kernighan for large traveling salesman problems", INFORMS Journal on Computing 15, 2003, for local kicks.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["Tour", "chain"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]

#: Largest number of exchanges in a step, and of alternatives for the first one.
DEPTH, BREADTH = 25, 5
#: Longest segment that or-opt moves, and longest segment of a double bridge.
SEGMENT, KICK = 3, 50
#: Least gain, relative to the longest distance.
GAIN = 1e-12


class Tour(NamedTuple):
    """Closed tour of n nodes with scratch arrays.

    `distances`, shape (n, n), are symmetric, `near`, shape (n, k), the nearest nodes of each node. `lists`,
    shape (5, n), holds the tour, the position of each node, a stack of nodes whose edges changed, a 1 for them,
    and the best tour. `flips`, shape (4, f), are the reversed paths since the last decision, each with its
    positions and the nodes of its exchange. `counts`, shape (2,), are the numbers of nodes in the stack and
    of flips.
    """

    distances: Floats
    near: Whole
    lists: Whole
    flips: Whole
    counts: Whole


@kernel(allocates=False)
def _flip(tour: Tour, i: int, j: int) -> None:
    """Reverse the path from position `i` to `j`, or the rest of the tour if that is shorter."""
    lists = tour.lists
    n = lists.shape[1]
    size = j - i + 1
    if size <= 0:
        size += n
    if 2 * size > n:
        i, j, size = j + 1, i - 1, n - size
        i = 0 if i == n else i
        j = n - 1 if j < 0 else j
    for _ in range(size // 2):
        a, b = lists[0, i], lists[0, j]
        lists[0, i], lists[0, j] = b, a
        lists[1, b], lists[1, a] = i, j
        i = 0 if i == n - 1 else i + 1
        j = n - 1 if j == 0 else j - 1


@kernel(allocates=False)
def _reverse(tour: Tour, first: int, last: int) -> None:
    """Reverse the path from node `first` to node `last` and record it."""
    i, j = tour.lists[1, first], tour.lists[1, last]
    k = tour.counts[1]
    tour.flips[0, k], tour.flips[1, k] = i, j
    tour.counts[1] = k + 1
    _flip(tour, i, j)


@kernel(allocates=False)
def _undo(tour: Tour, count: int) -> None:
    """Undo all reversals except the first `count`."""
    while tour.counts[1] > count:
        tour.counts[1] -= 1
        k = tour.counts[1]
        _flip(tour, tour.flips[0, k], tour.flips[1, k])


@kernel(allocates=False)
def _push(tour: Tour, node: int) -> None:
    """Add `node` to the stack."""
    if not tour.lists[3, node]:
        tour.lists[3, node] = 1
        tour.lists[2, tour.counts[0]] = node
        tour.counts[0] += 1


@kernel(allocates=False)
def _beside(tour: Tour, node: int, step: int) -> int:
    """Return the next (`step` 1) or previous (-1) node of the tour."""
    n = tour.lists.shape[1]
    i = tour.lists[1, node] + step
    if i == n:
        i = 0
    elif i < 0:
        i = n - 1
    return int(tour.lists[0, i])


@kernel(allocates=False)
def _exchange(tour: Tour, base: int, ahead: int, which: int) -> float:
    """Exchange edges, beginning with that from `base` to its neighbour `ahead`; return the gain.

    `which` selects the alternative of the first exchange. Without a gain, the tour stays as it is.
    """
    d, near, counts = tour.distances, tour.near, tour.counts
    begin, last = counts[1], ahead
    gain, best, kept = d[base, ahead], GAIN, begin
    for depth in range(DEPTH):
        step = 1 if _beside(tour, base, 1) == last else -1
        value, third, fourth = -math.inf, -1, -1
        for j in range(near.shape[1]):
            if depth == 0 and j != which:
                continue
            node = near[last, j]
            if node < 0 or gain - d[last, node] <= GAIN:
                break
            if node == base:
                continue
            before = _beside(tour, node, -step)
            if before == last:
                continue
            if d[before, node] - d[last, node] > value:
                value, third, fourth = d[before, node] - d[last, node], node, before
        if third < 0:
            break
        if step == 1:
            _reverse(tour, last, fourth)
        else:
            _reverse(tour, fourth, last)
        gain += value
        last = fourth
        tour.flips[2, counts[1] - 1], tour.flips[3, counts[1] - 1] = third, fourth
        if gain - d[base, last] > best:
            best, kept = gain - d[base, last], counts[1]
    _undo(tour, kept)
    if kept == begin:
        return 0.0
    _push(tour, ahead)
    for i in range(begin, kept):
        _push(tour, tour.flips[2, i])
        _push(tour, tour.flips[3, i])
    _push(tour, base)
    return best


@kernel(allocates=False)
def _shift(tour: Tour, base: int, step: int) -> float:
    """Move a short segment that begins at `base` and continues in direction `step`; return the gain."""
    d, near, lists = tour.distances, tour.near, tour.lists
    n = lists.shape[1]
    before, end = _beside(tour, base, -step), base
    for size in range(1, SEGMENT + 1):
        behind = _beside(tour, end, step)
        saved = d[before, base] + d[end, behind] - d[before, behind]
        for j in range(near.shape[1]):
            node = near[base, j]
            if node < 0 or saved - d[base, node] <= GAIN:
                break
            if step * (lists[1, node] - lists[1, base]) % n < size:
                continue
            for side in (-1, 1):
                other = _beside(tour, node, side)
                # The edge before or behind the segment is not available.
                if step * (lists[1, other] - lists[1, base]) % n < size:
                    continue
                gain = saved - d[base, node] - d[end, other] + d[node, other]
                if gain <= GAIN:
                    continue
                first, last, p, q = base, end, before, behind
                if step < 0:
                    first, last, p, q = end, base, behind, before
                u = node if side > 0 else other
                # Forwards p first … last q … u v; then p q … u last … first v.
                if u != p:
                    _reverse(tour, first, u)
                    if _beside(tour, p, 1) == u:
                        _reverse(tour, u, q)
                    else:
                        _reverse(tour, q, u)
                if (u == node) != (last == base):
                    if (lists[1, first] - lists[1, last]) % n == size - 1:
                        _reverse(tour, last, first)
                    else:
                        _reverse(tour, first, last)
                for entry in (before, behind, base, end, node, other):
                    _push(tour, entry)
                return float(gain)
        end = behind
        if end == before:
            break
    return 0.0


@kernel(allocates=False)
def _descend(tour: Tour, flag: NDArray[np.int8], forget: bool) -> float:
    """Improve the tour until no node of the stack has an improving move; return the gain."""
    counts, total = tour.counts, 0.0
    limit = tour.flips.shape[1] - 2 * DEPTH
    while counts[0] and not flag[0] and counts[1] < limit:
        base = tour.lists[2, counts[0] - 1]
        gain = 0.0
        for side in range(2):
            step = 1 - 2 * side
            which = 0
            while gain <= 0.0 and which < BREADTH:
                gain = _exchange(tour, base, _beside(tour, base, step), which)
                which += 1
            if gain <= 0.0:
                gain = _shift(tour, base, step)
        if gain > 0.0:
            total += gain
            if forget:
                counts[1] = 0
            continue
        # No move begins at the node; moves of others put it on the stack again.
        counts[0] -= 1
        tour.lists[3, base] = 0
    return total


@kernel(interpretable=True, in_place=True, allocates=False)
def chain(
    tour: Tour, kicks: int, hot: float, cold: float, flag: NDArray[np.int8], draw: Any
) -> tuple[int, float]:
    """Improve `tour` by local search and `kicks` double bridges, and set it to the best tour.

    `hot` and `cold` are the first and the last temperature, relative to the mean edge; with `hot` = 0 only
    improvements are accepted. Returns the number of kicks and the length.
    """
    d, lists, counts = tour.distances, tour.lists, tour.counts
    n, length = lists.shape[1], 0.0
    for i in range(n):
        lists[1, lists[0, i]] = i
        lists[2, n - 1 - i] = lists[0, i]
        lists[3, i] = 1
    counts[0], counts[1] = n, 0
    _descend(tour, flag, True)
    for i in range(n):
        length += d[lists[0, i - 1], lists[0, i]]
        lists[4, i] = lists[0, i]
    best, done, longest = length, 0, min(KICK, n // 8)
    cooling = (cold / hot) ** (1.0 / max(kicks, 1)) if hot > 0.0 else 0.0
    heat = hot * length / n
    while done < kicks and not flag[0] and longest >= 1:
        done += 1
        heat *= cooling
        while counts[0]:
            counts[0] -= 1
            lists[3, lists[2, counts[0]]] = 0
        counts[1] = 0
        i = int(draw.random() * n)
        first = 1 + int(draw.random() * longest)
        second = 1 + int(draw.random() * longest)
        a, b, c = lists[0, i], lists[0, (i + 1) % n], lists[0, (i + first) % n]
        e, f, g = (
            lists[0, (i + first + 1) % n], lists[0, (i + first + second) % n],
            lists[0, (i + first + second + 1) % n],
        )  # fmt: skip
        loss = d[a, e] + d[f, b] + d[c, g] - d[a, b] - d[c, e] - d[f, g]
        _reverse(tour, b, c)
        _reverse(tour, e, f)
        _reverse(tour, c, e)
        for entry in (a, b, c, e, f, g):
            _push(tour, entry)
        loss -= _descend(tour, flag, False)
        if loss > 0.0 and not loss < -heat * math.log(1.0 - draw.random()):
            _undo(tour, 0)
            continue
        length += loss
        if length < best * (1.0 - GAIN):
            best = length
            for k in range(n):
                lists[4, k] = lists[0, k]
    for i in range(n):
        lists[0, i] = lists[4, i]
    return done, best
