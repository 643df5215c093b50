"""Routes of a fleet as linked lists, their energy, and totals that follow each change.

``after[i]`` follows node i and ``before[i]`` precedes it. The list of vehicle k starts and ends at the mark
``n + k``, which represents its depot. Sums over all routes and tournament trees of the longest and the
shortest one are updated with each change, so that an insertion takes the same time with few and with many
vehicles.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = [
    "Fleet",
    "Routes",
    "Work",
    "assign",
    "copy_entry",
    "excess",
    "join",
    "judge",
    "measure",
    "workspace",
]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]

#: Rows of :attr:`Routes.links`, of :attr:`Routes.values`, and of :attr:`Work.lists`.
AFTER, BEFORE, ROUTE = range(3)
LOAD, CARRIED, COUNT = range(3)
IDLE, SPOT, CHANGED, STAMP, STALE, MARK, TAKEN, BEHIND, TOKEN, TRIED = range(10)
#: Entries of :attr:`Work.sums`, and the offset of their copy.
TOTAL, SQUARES, REFERENCE, BROKEN, VIOLATED, RESTING, LISTED, SAVED = range(8)
#: Codes of the objectives.
SUM, MAX, DEVIATION, RANGE, VARIANCE = 0, 1, 2, 3, 5


class Fleet(NamedTuple):
    """Data of a fleet of m vehicles and n nodes, scaled so that the longest distance is 1.

    `near`, shape (n, k), holds the nearest other nodes of each node, -1 beyond the last, and `place`, shape
    (n + m,), the node of each node and mark. `limits`, shape (2, m), holds batteries and capacities.
    `rules`, shape (9,), holds the code of the objective, q, divisor in the deviation, weight of the mean
    load in the energy, limits on sum, deviation and range, penalty for a violation as large as its limit in
    units of mean plus longest load, and objective at which annealing ends.
    """

    nodes: Whole
    near: Whole
    distances: Floats
    place: Whole
    demands: Floats
    limits: Floats
    rules: Floats
    use_all: bool


class Routes(NamedTuple):
    """Routes as linked lists, modified in place.

    `links`, shape (3, n + m), are the next and previous entry of each node and mark, and the vehicle of
    each node, -1 without one. `values`, shape (3, m), are length, demand and number of nodes of each route.
    """

    links: Whole
    values: Floats


class Work(NamedTuple):
    """Values over all routes that follow each change, and scratch arrays.

    `sums`, shape (14,), holds the sum of loads, the sum of their squared differences to a reference, the
    reference, the violation of capacities and batteries, the numbers of violated vehicles, of idle vehicles
    and of changed entries; the second half is a copy. `trees`, shape (2, 2 h), are tournament trees of the
    longest and the shortest load, with the result at index 1 and vehicle k at h + k. `lists`, shape
    (10, n + m + 1), holds the idle vehicles and the index of each vehicle among them, the entries that
    differ from the last accepted routes and a 1 for them, the same for the best routes, the removed nodes,
    and the positions tried in an insertion: for each vehicle the entry before the best one and the number
    of the insertion, then the vehicles in the order of trials. `costs`, shape (2, n + m), holds the sort
    keys of removed nodes and the least detour of each vehicle.
    """

    sums: Floats
    trees: Floats
    lists: Whole
    costs: Floats


def workspace(routes: Routes) -> Work:
    """Return the scratch arrays for `routes`."""
    m, size = routes.values.shape[1], routes.links.shape[1]
    half = 1 << (m - 1).bit_length()
    lists, costs = np.zeros((10, size + 1), np.int64), np.zeros((2, size))
    return Work(np.zeros(2 * SAVED), np.zeros((2, 2 * half)), lists, costs)


@kernel(allocates=False)
def excess(limits: Floats, k: int, load: float, carried: float) -> float:
    """Return the relative violation of the battery and the capacity of vehicle `k`."""
    broken = 0.0
    if load > limits[0, k]:
        broken += (load - limits[0, k]) / limits[0, k] if limits[0, k] > 0.0 else load
    if carried > limits[1, k]:
        broken += (carried - limits[1, k]) / limits[1, k] if limits[1, k] > 0.0 else carried
    return broken


@kernel(allocates=False)
def judge(
    rules: Floats,
    m: int,
    total: float,
    squares: float,
    longest: float,
    shortest: float,
    broken: float,
) -> tuple[float, float, float]:
    """Return the energy, the objective and the relative violation of limits, from values of all routes.

    `squares` is the sum of squared differences to the mean, and `broken` the violation of each route.
    """
    mean = total / m
    deviation = math.sqrt(squares / rules[2]) if rules[2] > 0.0 and squares > 0.0 else 0.0
    extent = longest - shortest
    if total > rules[4]:
        broken += (total - rules[4]) / rules[4] if rules[4] > 0.0 else total
    if deviation > rules[5]:
        broken += (deviation - rules[5]) / rules[5] if rules[5] > 0.0 else deviation
    if extent > rules[6]:
        broken += (extent - rules[6]) / rules[6] if rules[6] > 0.0 else extent
    kind = int(rules[0])
    if kind == SUM:
        objective = total
    elif kind == MAX:
        objective = longest
    elif kind == DEVIATION:
        objective = total + rules[1] * deviation
    elif kind == VARIANCE:
        objective = total + rules[1] * squares / m
    elif kind == RANGE:
        objective = extent
    else:
        objective = longest + rules[1] * total
    energy = objective + rules[3] * mean
    return energy + rules[7] * broken * (mean + longest), objective, broken


@kernel(interpretable=True, in_place=True, allocates=False)
def measure(fleet: Fleet, routes: Routes, work: Work) -> tuple[float, float, float]:
    """Compute all loads and `work` afresh; return energy, objective and relative violation of limits."""
    distances, place, links, values = fleet.distances, fleet.place, routes.links, routes.values
    sums, trees, lists, half = work.sums, work.trees, work.lists, work.trees.shape[1] // 2
    m = values.shape[1]
    n = place.size - m
    for i in range(SAVED):
        sums[i] = 0.0
    for k in range(half):
        trees[0, half + k], trees[1, half + k] = -math.inf, math.inf
    for k in range(m):
        load, node = 0.0, n + k
        while values[COUNT, k] > 0.0:
            next_ = links[AFTER, node]
            load += distances[place[node], place[next_]]
            node = next_
            if node >= n:
                break
        values[LOAD, k] = trees[0, half + k] = trees[1, half + k] = load
        sums[TOTAL] += load
        broken = excess(fleet.limits, k, load, values[CARRIED, k])
        sums[BROKEN] += broken
        sums[VIOLATED] += 1.0 if broken > 0.0 else 0.0
        if values[COUNT, k] == 0.0:
            lists[IDLE, int(sums[RESTING])], lists[SPOT, k] = k, int(sums[RESTING])
            sums[RESTING] += 1.0
    sums[REFERENCE] = sums[TOTAL] / m
    for k in range(m):
        sums[SQUARES] += (values[LOAD, k] - sums[REFERENCE]) ** 2
    for i in range(half - 1, 0, -1):
        trees[0, i] = max(trees[0, 2 * i], trees[0, 2 * i + 1])
        trees[1, i] = min(trees[1, 2 * i], trees[1, 2 * i + 1])
    return judge(fleet.rules, m, sums[TOTAL], sums[SQUARES], trees[0, 1], trees[1, 1], sums[BROKEN])


@kernel(allocates=False)
def assign(
    limits: Floats, values: Floats, work: Work, k: int, load: float, carried: float, count: float
) -> None:
    """Set load, demand and number of nodes of vehicle `k`, and update `work`."""
    sums, trees, lists = work.sums, work.trees, work.lists
    old, reference = values[LOAD, k], sums[REFERENCE]
    was = excess(limits, k, old, values[CARRIED, k])
    now = excess(limits, k, load, carried)
    sums[TOTAL] += load - old
    sums[SQUARES] += (load - reference) ** 2 - (old - reference) ** 2
    sums[VIOLATED] += (1.0 if now > 0.0 else 0.0) - (1.0 if was > 0.0 else 0.0)
    sums[BROKEN] = sums[BROKEN] - was + now if sums[VIOLATED] else 0.0
    if count and not values[COUNT, k]:
        sums[RESTING] -= 1
        last, spot = lists[IDLE, int(sums[RESTING])], lists[SPOT, k]
        lists[IDLE, spot], lists[SPOT, last] = last, spot
    elif values[COUNT, k] and not count:
        lists[IDLE, int(sums[RESTING])], lists[SPOT, k] = k, int(sums[RESTING])
        sums[RESTING] += 1
    values[LOAD, k], values[CARRIED, k], values[COUNT, k] = load, carried, count
    i = trees.shape[1] // 2 + k
    trees[0, i] = trees[1, i] = load
    while i > 1:
        longest, shortest = max(trees[0, i], trees[0, i ^ 1]), min(trees[1, i], trees[1, i ^ 1])
        i >>= 1
        if trees[0, i] == longest and trees[1, i] == shortest:
            break
        trees[0, i], trees[1, i] = longest, shortest


@kernel(allocates=False)
def join(fleet: Fleet, routes: Routes, work: Work, node: int, a: int, k: int, sign: int) -> None:
    """Insert `node` behind `a` in the route of vehicle `k` (`sign` 1), or remove it from there (-1)."""
    distances, place, links, values = fleet.distances, fleet.place, routes.links, routes.values
    b = links[AFTER, a] if sign > 0 else links[AFTER, node]
    count = values[COUNT, k] + sign
    load, carried, start, end = 0.0, 0.0, place[a], place[b]
    if count:
        detour = distances[start, node] + distances[node, end] - distances[start, end]
        load = values[LOAD, k] + sign * detour
        carried = values[CARRIED, k] + sign * fleet.demands[node]
    assign(fleet.limits, values, work, k, load, carried, count)
    for i in (a, b, node, place.size - values.shape[1] + k):
        if not work.lists[STAMP, i]:
            work.lists[STAMP, i] = 1
            work.lists[CHANGED, int(work.sums[LISTED])] = i
            work.sums[LISTED] += 1.0
    if sign > 0:
        links[AFTER, a], links[BEFORE, node] = node, a
        links[AFTER, node], links[BEFORE, b] = b, node
        links[ROUTE, node] = k
    else:
        links[AFTER, a], links[BEFORE, b] = b, a
        links[ROUTE, node] = -1


@kernel(allocates=False)
def copy_entry(source: Routes, target: Routes, i: int) -> None:
    """Copy entry `i`, and for a mark the values of its vehicle."""
    k = i - source.links.shape[1] + source.values.shape[1]
    for row in range(3):
        target.links[row, i] = source.links[row, i]
        if k >= 0:
            target.values[row, k] = source.values[row, k]
