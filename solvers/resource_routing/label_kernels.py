"""Labels with a vector of levels, and the best-first search that extends them.

A label is a partial route: its last point, length, levels of all resources on leaving, parent label,
and the visited *critical* points that it remembers. A label dominates another of the same point if it is no
longer, has no larger level (nor a smaller one that a lower limit may refuse), and remembers no critical point
that is open for the other. Every extension of the other label is then an extension of the dominating one. A
point is open if the label does not remember it and the bound on routes through it is below the ceiling.

Labels leave the heap in the order of a Lagrangean bound: the length, the weighted levels, and the least
weighted length from there to the end (:mod:`.multipliers`). The front of a point holds its extended labels by
length, with the least first level up to each entry. The test ends at the first entry whose least level is
larger, which makes it O(log n) for one resource: the front is then a staircase.

If several routes are wanted, a dominated label is parked: no route by way of it is shorter than the best one by
way of the label that dominates it. When that route leaves the heap, its labels are spent, and the labels parked
at them return to the heap.
"""

from __future__ import annotations

from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import MOST_LABELS, kernel
from .front_kernels import SPENT, Labels, dominated, fronts_of, grown, inserted, make, trace
from .network import Network
from .outcomes import FOUND, FULL, NOTHING, STOPPED

__all__ = ["best_first"]

#: Maximum number of array entries for the labels of a search.
_MOST_NUMBERS = 6 * MOST_LABELS
#: Relative rounding error of a sum of lengths.
_ROUNDING = 1e-12

Whole = NDArray[np.int64]


class Guide(NamedTuple):
    """Bounds and memory of a search.

    `weight`, shape (r,), are multipliers >= 0. `ahead`, shape (n,), is the least weighted length to the end less
    the weighted limits, inf if unreachable, and `via`, shape (n, critical), the same through each critical point,
    both with the error `rounding`. `bits`, shape (n,), is the index of a point among the critical ones, or -1,
    and `memory`, shape (n, words), holds the critical points that a label remembers on leaving each point
    (ng-routes). `shut`, shape (critical, r), are levels above which no route reaches a critical point.
    """

    weight: NDArray[np.float64]
    ahead: NDArray[np.float64]
    via: NDArray[np.float64]
    bits: NDArray[np.int64]
    memory: NDArray[np.uint64]
    shut: NDArray[np.float64]
    rounding: float


@kernel
def extend(
    net: Network,
    labels: Labels,
    at: int,
    label: int,
    arc: int,
    bits: NDArray[np.int64],
    memory: NDArray[np.uint64],
) -> bool:
    """Write label `at` as the extension of `label` by `arc`; return whether it is feasible."""
    there = net.head[arc]
    for k in range(labels.level.shape[1]):
        level = labels.level[label, k] + net.use[arc, k]
        if level > net.limit[there, k] or level < net.lower[there, k]:
            return False
        level = min(max(level, net.floor[there, k]), net.reset[there, k])
        if level > net.most[there, k]:
            return False
        labels.level[at, k] = level
    for word in range(labels.visited.shape[1]):
        labels.visited[at, word] = labels.visited[label, word] & memory[there, word]
    bit = bits[there]
    if bit >= 0:
        mask = np.uint64(1) << np.uint64(bit & 63)
        if labels.visited[label, bit >> 6] & mask != np.uint64(0):
            return False
        labels.visited[at, bit >> 6] |= mask
    labels.point[at] = there
    labels.parent[at], labels.parked[at] = label, -1
    labels.length[at] = labels.length[label] + net.length[arc]
    return True


@kernel
def weighted(labels: Labels, at: int, weight: NDArray[np.float64]) -> float:
    """Return the length of label `at` and its weighted levels."""
    total = float(labels.length[at])
    for k in range(len(weight)):
        if weight[k] > 0.0:
            total += weight[k] * labels.level[at, k]
    return total


@kernel
def park(labels: Labels, at: int, rival: int) -> None:
    """Let label `at` wait until `rival`, which dominates it, is spent."""
    labels.before[at], labels.parked[rival] = labels.parked[rival], at


@kernel(interpretable=True)
def best_first(
    net: Network,
    guide: Guide,
    ceiling: float,
    wanted: int,
    most: int,
    flag: NDArray[np.int8],
) -> tuple[int, Whole, Whole, NDArray[np.float64], float, int, int, int]:
    """Return the `wanted` shortest routes up to `ceiling` that repeat no remembered critical point.

    The search ends after `most` labels, if memory is short, or if the stop flag is set. The results are the
    status (``FOUND``, ``NOTHING``, ``STOPPED`` or ``FULL``), the points of all routes, the number of points and
    the length of each, ascending, a lower bound on all routes, and the numbers of labels made, extended, and
    pruned by the ceiling alone.
    """
    count, resources, words = len(guide.ahead), len(net.initial), guide.memory.shape[1]
    capacity = _MOST_NUMBERS // (8 + resources + words)
    fronts = fronts_of(count, resources)
    room = 2 * count + 1024
    labels = make(room, resources, words)
    labels.point[0], labels.parent[0], labels.length[0] = net.start, -1, 0.0
    for k in range(resources):
        labels.level[0, k] = net.initial[k]
    # Lengths and bounds are summed in different orders, so a margin is needed.
    high = ceiling + guide.rounding + _ROUNDING * abs(ceiling) if ceiling < np.inf else ceiling
    used, waiting, settled, pruned, ends = 1, 0, 0, 0, 0
    status, bound = NOTHING, ceiling
    end, lengths = np.zeros(wanted, np.int64), np.full(wanted, np.inf)
    heap = [(weighted(labels, 0, guide.weight) + guide.ahead[net.start], 0)]
    if heap[0][0] > high or heap[0][0] == np.inf:
        pruned = int(heap[0][0] < np.inf)
        heap.clear()
    while len(heap) > 0:
        key, label = heappop(heap)
        if key > high:
            break
        here = labels.point[label]
        if here == net.end:
            at = label
            while at >= 0:
                parked, labels.parked[at] = labels.parked[at], SPENT
                while parked >= 0:
                    key = weighted(labels, parked, guide.weight) + guide.ahead[labels.point[parked]]
                    heappush(heap, (key, parked))
                    parked, waiting = labels.before[parked], waiting - 1
                at = labels.parent[at]
            continue
        rival = dominated(
            fronts, labels, label, guide.via, guide.shut, high, key - guide.ahead[here], net.full
        )
        if rival >= 0:
            if wanted > 1:
                park(labels, label, rival)
                waiting += 1
            continue
        if flag[0] != 0 or used - waiting > most or used > capacity:
            status, bound = STOPPED if flag[0] != 0 else FULL, key
            break
        fronts = inserted(fronts, labels, label)
        settled += 1
        begin, stop = net.first[here], net.first[here + 1]
        if used + stop - begin >= room:
            room = 2 * (used + stop - begin)
            labels = grown(labels, room)
        for arc in range(begin, stop):
            there = net.head[arc]
            if guide.ahead[there] == np.inf or not extend(
                net, labels, used, label, arc, guide.bits, guide.memory
            ):
                continue
            length = weighted(labels, used, guide.weight)
            key = length + guide.ahead[there]
            if key > high:
                pruned += 1
            elif there == net.end:
                if (
                    labels.length[used] < lengths[wanted - 1]
                    and labels.length[used] <= ceiling + abs(ceiling) * _ROUNDING
                ):
                    k = wanted - 1
                    while k > 0 and lengths[k - 1] > labels.length[used]:
                        lengths[k], end[k] = lengths[k - 1], end[k - 1]
                        k -= 1
                    lengths[k], end[k] = labels.length[used], used
                    ends += ends < wanted
                    if wanted > 1:
                        heappush(heap, (labels.length[used], used))
                    used += 1
                    if ends == wanted:
                        worst = lengths[wanted - 1]
                        high = min(high, worst - guide.rounding - _ROUNDING * abs(worst))
            else:
                rival = dominated(
                    fronts, labels, used, guide.via, guide.shut, high, length, net.full
                )
                if rival < 0:
                    heappush(heap, (key, used))
                    used += 1
                elif wanted > 1:
                    park(labels, used, rival)
                    used, waiting = used + 1, waiting + 1
    sizes, points = np.zeros(ends, np.int64), np.empty(0, np.int64)
    for k in range(ends):
        route = trace(labels.point, labels.parent, end[k])
        sizes[k], points = len(route), np.concatenate((points, route))
    if status == NOTHING and ends > 0:
        status, bound = FOUND, lengths[0]
    bound = min(bound, lengths[0])
    return status, points, sizes, lengths[:ends], bound, used, settled, pruned
