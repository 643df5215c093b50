"""Beam search for a first route with resources, with few labels per point."""

from __future__ import annotations

from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .front_kernels import Labels, dominated, fronts_of, grown, inserted, make, trace
from .label_kernels import extend
from .network import Network

__all__ = ["narrow"]


@kernel
def use_of(net: Network, labels: Labels, label: int) -> float:
    """Return the largest ratio of a level of `label` to the largest useful level at its point."""
    share, point = 0.0, labels.point[label]
    for k in range(labels.level.shape[1]):
        most = net.most[point, k]
        if 0.0 < most < np.inf:
            share = max(share, labels.level[label, k] / most)
    return share


@kernel
def passes(labels: Labels, label: int, point: int) -> bool:
    """Return whether the route of `label` visits `point`."""
    while label >= 0:
        if labels.point[label] == point:
            return True
        label = labels.parent[label]
    return False


@kernel(interpretable=True)
def narrow(
    net: Network,
    ahead: NDArray[np.float64],
    width: int,
    weight: float,
    revisits: bool,
    ceiling: float,
    flag: NDArray[np.int8],
) -> tuple[NDArray[np.int64], float]:
    """Return route and length of the first best-first search result with at most `width` labels per point.

    The route is empty, and its length inf, if none below `ceiling` was found or the stop flag was set. `ahead`,
    shape (n,), is the shortest-path length to the end. `weight` is that of the largest relative level in the
    search key, in units of the shortest-path length from start to end.
    """
    count, resources = len(ahead), len(net.initial)
    fronts, extended = fronts_of(count, resources), np.zeros(count, np.int64)
    bits, via, memory = np.full(count, -1), np.zeros((count, 0)), np.zeros((count, 0), np.uint64)
    room = 2 * count + 1024
    labels = make(room, resources, 0)
    labels.point[0], labels.parent[0], labels.length[0] = net.start, -1, 0.0
    for k in range(resources):
        labels.level[0, k] = net.initial[k]
    scale = weight * ahead[net.start]
    used = 1
    heap = [(0.0, 0)]
    if ahead[net.start] == np.inf:
        heap.clear()
    while len(heap) > 0 and flag[0] == 0:
        _, label = heappop(heap)
        here = labels.point[label]
        if here == net.end:
            return trace(labels.point, labels.parent, label), labels.length[label]
        if (
            extended[here] >= width
            or dominated(fronts, labels, label, via, via, np.inf, 0.0, net.full) >= 0
        ):
            continue
        extended[here] += 1
        fronts = inserted(fronts, labels, label)
        begin, stop = net.first[here], net.first[here + 1]
        if used + stop - begin >= room:
            room = 2 * (used + stop - begin)
            labels = grown(labels, room)
        for arc in range(begin, stop):
            there = net.head[arc]
            if ahead[there] == np.inf or extended[there] >= width:
                continue
            if not extend(net, labels, used, label, arc, bits, memory):
                continue
            key = labels.length[used] + ahead[there]
            if key >= ceiling or (not revisits and passes(labels, label, there)):
                continue
            heappush(heap, (key + scale * use_of(net, labels, used), used))
            used += 1
    return np.empty(0, np.int64), np.inf
