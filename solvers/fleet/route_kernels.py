"""Labels of partial routes, their dominance, and the join of forward and backward labels.

A label extends a route from its depot. It has a cost (reduced by dual prices), a level per resource, the
visited nodes that it remembers, and a parity bit per subset-row cut. A node remembers the nodes in its
ng-set, so a route may repeat a node only after it has left the ng-sets of that node (R. Baldacci,
A. Mingozzi, R. Roberti, "New route relaxation and pricing strategies for the vehicle routing problem",
Operations Research 59, 2011). A label dominates another of the same node if its cost, its levels and its
remembered nodes are not larger; cuts with an odd parity that the other label lacks are added to its
cost (M. Jepsen and others, "Subset-row inequalities applied to the vehicle-routing problem with time
windows", Operations Research 56, 2008). Parities are forgotten outside of the memory of a cut (D. Pecin
and others, "Improved branch-cut-and-price for capacitated vehicle routing", Mathematical Programming
Computation 9, 2017).

The first resource increases on every arc between nodes. Labels are extended up to half of its limit, and
each route is joined from a forward and a backward label along one arc (G. Righini, M. Salani, "Symmetry
helps: bounded bi-directional dynamic programming", Discrete Optimization 3, 2006).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["CUTS", "FULL", "STOPPED", "Graph", "Labels", "grow", "join", "make", "measure", "trace"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Words = NDArray[np.uint64]

#: Results of :func:`grow` without complete labels: no room, or a stop request.
FULL, STOPPED = -1, -2
#: Largest number of subset-row cuts: one bit each.
CUTS = 64


class Graph(NamedTuple):
    """Arcs between n nodes and the depot, which has index n.

    `cost`, shape (n + 1, n + 1), are reduced costs, infinite for arcs that do not exist, and `use`, shape (r, n
    + 1, n + 1), is the use of each resource. `low` and `high`, shape (r, n + 1), limit the level on arrival; a
    level below `low` is raised to it. `limit`, shape (r,), limits the forward level, the use of an arc and the
    backward level together. `own` and `near`, shape (n, words), are the bit of each node and its ng-set.
    `members` and `memory`, shape (n,), are the subset-row cuts that contain the node, and those whose memory
    contains it. `penalty`, shape (64,), is the cost of every second visit to the nodes of a cut. `compared`,
    shape (n, words), are the remembered nodes that dominance compares: those of `near`, or fewer for a heuristic.
    """

    cost: Floats
    use: Floats
    low: Floats
    high: Floats
    limit: Floats
    own: Words
    near: Words
    members: Words
    memory: Words
    penalty: Floats
    compared: Words


class Labels(NamedTuple):
    """Columns of labels, and lists of labels per node and bucket of the first resource.

    Each label has its last `node`, `parent` (-1 at the depot), next labels in the list of its bucket and in the
    queue (`following`, `waiting`), reduced `cost`, odd parities of the cuts, the label that dominates it in
    `better`, or -1, `level` of each resource, shape (room, r), and remembered nodes `seen`, shape (room, words).
    `heads`, shape (n, buckets), is the first label of each list, the one of least cost. `queue`, shape (2,
    buckets), is the first and the last label of each bucket that waits for its extension.
    """

    node: Ints
    parent: Ints
    following: Ints
    waiting: Ints
    cost: Floats
    odd: Words
    better: Ints
    level: Floats
    seen: Words
    heads: Ints
    queue: Ints


def make(room: int, buckets: int, graph: Graph) -> Labels:
    """Return columns for `room` labels."""
    nodes, words = graph.near.shape
    return Labels(
        np.empty(room, np.int64), np.empty(room, np.int64), np.empty(room, np.int64),
        np.empty(room, np.int64), np.empty(room), np.empty(room, np.uint64), np.empty(room, np.int64),
        np.empty((room, len(graph.limit))), np.empty((room, words), np.uint64),
        np.full((nodes, buckets), -1), np.full((2, buckets), -1),
    )  # fmt: skip


@kernel(allocates=False)
def _charge(cuts: np.uint64, penalty: Floats) -> float:
    """Return the total penalty of the cuts."""
    total, c = 0.0, 0
    while cuts:
        if cuts & np.uint64(1):
            total += penalty[c]
        cuts >>= np.uint64(1)
        c += 1
    return total


@kernel(allocates=False)
def _dominates(graph: Graph, labels: Labels, first: int, second: int, exact: bool) -> bool:
    """Return whether label `first` of the same node dominates `second`; parities count if `exact`."""
    cost, other = labels.cost[first], labels.cost[second]
    if cost > other:
        return False
    for k in range(labels.level.shape[1]):
        if labels.level[first, k] > labels.level[second, k]:
            return False
    node = labels.node[first]
    for word in range(labels.seen.shape[1]):
        lacks = labels.seen[first, word] & ~labels.seen[second, word]
        if lacks & graph.compared[node, word]:
            return False
    if not exact:
        return True
    more = labels.odd[first] & ~labels.odd[second]
    return bool(more == np.uint64(0) or cost + _charge(more, graph.penalty) <= other)


@kernel(allocates=False)
def _insert(graph: Graph, labels: Labels, new: int, bucket: int, exact: bool) -> bool:
    """Insert the label `new` into its list unless it is dominated, and remove those it dominates."""
    node, cost = labels.node[new], labels.cost[new]
    heads, following = labels.heads, labels.following
    for b in range(bucket + 1):
        label = heads[node, b]
        while label >= 0 and labels.cost[label] <= cost:
            if _dominates(graph, labels, label, new, exact):
                labels.better[new] = label
                return False
            label = following[label]
    place = -1
    for b in range(bucket, heads.shape[1]):
        former, label = -1, heads[node, b]
        while label >= 0:
            after = following[label]
            if _dominates(graph, labels, new, label, exact):
                labels.better[label] = new
                if former < 0:
                    heads[node, b] = after
                else:
                    following[former] = after
            else:
                if b == bucket and labels.cost[label] <= cost:
                    place = label
                former = label
            label = after
    if place < 0:
        following[new] = heads[node, bucket]
        heads[node, bucket] = new
    else:
        following[new] = following[place]
        following[place] = new
    labels.waiting[new] = -1
    if labels.queue[0, bucket] < 0:
        labels.queue[0, bucket] = new
    else:
        labels.waiting[labels.queue[1, bucket]] = new
    labels.queue[1, bucket] = new
    return True


@kernel(allocates=False)
def _extend(
    graph: Graph, labels: Labels, label: int, used: int, half: float, exact: bool, store: bool
) -> int:
    """Extend a label (-1: the depot) to all nodes; return the number of labels, or FULL."""
    nodes, words = graph.near.shape
    buckets = labels.heads.shape[1]
    here = nodes if label < 0 else labels.node[label]
    for node in range(nodes):
        cost = graph.cost[here, node]
        if cost == math.inf:
            continue
        if used == labels.cost.size:
            return FULL
        allowed = True
        for k in range(graph.limit.size):
            level = graph.low[k, nodes] if label < 0 else labels.level[label, k]
            level = max(level + graph.use[k, here, node], graph.low[k, node])
            if level > graph.high[k, node] or (k == 0 and level > half):
                allowed = False
                break
            labels.level[used, k] = level
        if not allowed:
            continue
        odd = np.uint64(0)
        for word in range(words):
            seen = np.uint64(0) if label < 0 else labels.seen[label, word]
            if seen & graph.own[node, word]:
                allowed = False
            labels.seen[used, word] = (seen & graph.near[node, word]) | graph.own[node, word]
        if not allowed:
            continue
        if label >= 0:
            cost += labels.cost[label]
            odd = labels.odd[label] & graph.memory[node]
            hit = odd & graph.members[node]
            if hit:
                cost += _charge(hit, graph.penalty)
        labels.node[used] = node
        labels.parent[used] = label
        labels.cost[used] = cost
        labels.odd[used] = odd ^ graph.members[node]
        labels.better[used] = -1
        bucket = min(int(labels.level[used, 0] / half * buckets), buckets - 1)
        if _insert(graph, labels, used, bucket, exact) or store:
            used += 1
    return used


@kernel(allocates=False)
def grow(
    graph: Graph, labels: Labels, half: float, exact: bool, store: bool, flag: NDArray[np.int8]
) -> int:
    """Compute the undominated labels up to the level `half` of the first resource.

    Without `exact`, parities are not compared, so labels may be missing. With `store`, dominated labels
    remain among the columns. Return the number of labels, dominated ones included, or FULL or STOPPED.
    """
    used = _extend(graph, labels, -1, 0, half, exact, store)
    steps = 0
    for b in range(labels.heads.shape[1]):
        while used >= 0 and labels.queue[0, b] >= 0:
            label = labels.queue[0, b]
            labels.queue[0, b] = labels.waiting[label]
            steps += 1
            if steps % 256 == 0 and flag[0] != 0:
                return STOPPED
            if labels.better[label] < 0:
                used = _extend(graph, labels, label, used, half, exact, store)
    return used


@kernel(allocates=False)
def _fits(graph: Graph, ahead: Labels, behind: Labels, f: int, b: int, i: int, j: int) -> bool:
    """Return whether a forward label of node i and a backward label of node j form a route."""
    for k in range(graph.limit.size):
        before = graph.low[k, len(graph.near)] if f < 0 else ahead.level[f, k]
        after = 0.0 if b < 0 else behind.level[b, k]
        if before + graph.use[k, i, j] + after > graph.limit[k]:
            return False
    if f >= 0 and b >= 0:
        for word in range(graph.near.shape[1]):
            if ahead.seen[f, word] & behind.seen[b, word]:
                return False
    return True


@kernel(allocates=False)
def join(
    graph: Graph, ahead: Labels, behind: Labels, first: Ints, second: Ints, starts: Ints,
    ends: Ints, value: Floats, pairs: Ints, flag: NDArray[np.int8],
) -> bool:  # fmt: skip
    """Join labels along each arc to the cheapest route below ``value``.

    `first` and `second` are the labels of each node by ascending cost, those of node i between
    ``starts[i]`` and ``starts[i + 1]`` (`ends` for backward labels); index n is the depot without a
    label. `value`, shape (n + 1, n + 1), contains the largest cost of interest and then the cost of the
    best route over the arc; `pairs`, shape (n + 1, n + 1, 2), its labels. Return False after a stop.
    """
    nodes = len(graph.near)
    for i in range(nodes + 1):
        for p in range(starts[i], starts[i + 1]):
            if flag[0] != 0:
                return False
            f = first[p]
            base = 0.0 if f < 0 else ahead.cost[f]
            for j in range(nodes + 1):
                arc = base + graph.cost[i, j]
                if i == nodes and j == nodes:
                    continue
                for q in range(ends[j], ends[j + 1]):
                    b = second[q]
                    total = arc if b < 0 else arc + behind.cost[b]
                    if total >= value[i, j]:
                        break
                    if not _fits(graph, ahead, behind, f, b, i, j):
                        continue
                    if f >= 0 and b >= 0:
                        total += _charge(ahead.odd[f] & behind.odd[b], graph.penalty)
                    if total < value[i, j]:
                        value[i, j] = total
                        pairs[i, j, 0] = f
                        pairs[i, j, 1] = b
    return True


@kernel(allocates=False)
def measure(
    graph: Graph, ahead: Labels, behind: Labels, first: Ints, second: Ints, starts: Ints,
    ends: Ints, before: Floats, after: Floats, value: Floats, flag: NDArray[np.int8],
) -> bool:  # fmt: skip
    """Compute the cost of the cheapest join of each label and over each arc, up to the cost of interest.

    `before`, `after` and `value`, shape (n + 1, n + 1), contain the largest cost of interest of each forward
    label, backward label and arc, and then the costs. The other arguments are those of :func:`join`. Return
    False after a stop.
    """
    nodes = len(graph.near)
    for i in range(nodes + 1):
        for p in range(starts[i], starts[i + 1]):
            if flag[0] != 0:
                return False
            f = first[p]
            base = 0.0 if f < 0 else ahead.cost[f]
            for j in range(nodes + 1):
                arc = base + graph.cost[i, j]
                if i == nodes and j == nodes:
                    continue
                for q in range(ends[j], ends[j + 1]):
                    b = second[q]
                    total = arc if b < 0 else arc + behind.cost[b]
                    if total >= after[-1]:
                        break
                    if total >= max(value[i, j], before[f], after[b]):
                        continue
                    if not _fits(graph, ahead, behind, f, b, i, j):
                        continue
                    if f >= 0 and b >= 0:
                        total += _charge(ahead.odd[f] & behind.odd[b], graph.penalty)
                    value[i, j] = min(value[i, j], total)
                    if f >= 0:
                        before[f] = min(before[f], total)
                    if b >= 0:
                        after[b] = min(after[b], total)
    return True


@kernel(allocates=False)
def trace(graph: Graph, labels: Labels, used: int, least: Floats, value: Floats) -> None:
    """Lower the costs of the cheapest routes over labels and arcs to those of the labels that result.

    `least`, shape (used + 1,), are the costs of joined labels, `value` those over arcs to the node of a label
    from the node of its parent. A dominated label leads to the same completions as the label that dominates
    it, at a higher cost.
    """
    changed = True
    while changed:
        changed = False
        for label in range(used - 1, -1, -1):
            better, parent = labels.better[label], labels.parent[label]
            if better >= 0:
                more = labels.odd[better] & ~labels.odd[label]
                cost = labels.cost[label] - labels.cost[better] - _charge(more, graph.penalty)
                if least[better] + max(cost, 0.0) < least[label]:
                    least[label] = least[better] + max(cost, 0.0)
                    changed = True
            if parent >= 0 and least[label] < least[parent]:
                least[parent] = least[label]
                changed = True
    for label in range(used):
        parent = labels.parent[label]
        tail = labels.node[parent] if parent >= 0 else len(value) - 1
        value[tail, labels.node[label]] = min(value[tail, labels.node[label]], least[label])
