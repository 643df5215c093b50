"""Loops of the annealing of a fleet's routes by ruin and recreate.

Strings of nodes are removed from the routes and reinserted one by one at the cheapest position.
Source: J. Christiaens and G. Vanden Berghe, "Slack induction by string removals for vehicle routing
problems", Transportation Science 54 (2020), doi 10.1287/trsc.2019.0914. The energy, which includes the
balance of the routes, is ours.

Routes are linked lists: ``after[i]`` follows node i and ``before[i]`` precedes it. The list of vehicle
k starts and ends at the mark ``n + k``, which represents its depot.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["SUM", "anneal", "measure"]

#: Codes of the objectives.
SUM, MAX, DEVIATION, RANGE, VARIANCE = 0, 1, 2, 3, 5
#: Probability of skipping a position in recreate (the paper's "blink").
BLINK = 0.01
#: The same probability for the objective "range", which a longer route may reduce.
LOOSE = 0.5
#: Mean number of removed nodes, and the longest string.
REMOVED, LONGEST = 10.0, 10
#: Probability of a large ruin, and its number of removed nodes and longest string.
WIDE, FAR = 0.1, 40.0


@kernel
def measure(
    loads: NDArray[np.float64], carried: NDArray[np.float64], capacity: NDArray[np.float64],
    battery: NDArray[np.float64], rules: NDArray[np.float64],
) -> tuple[float, float, float]:  # fmt: skip
    """Return the energy, the objective and the relative violation of limits.

    `rules` holds the objective's code, q, the divisor in the deviation, the weight of the mean load in
    the energy, the limits on sum, deviation and range, the penalty for a violation as large as its
    limit in units of mean plus longest load, and the objective at which annealing ends.
    """
    m = loads.size
    total, longest, shortest = 0.0, -math.inf, math.inf
    broken = 0.0
    for k in range(m):
        load = loads[k]
        total += load
        longest = max(longest, load)
        shortest = min(shortest, load)
        if load > battery[k]:
            broken += (load - battery[k]) / battery[k] if battery[k] > 0.0 else load
        if carried[k] > capacity[k]:
            broken += (carried[k] - capacity[k]) / capacity[k] if capacity[k] > 0.0 else carried[k]
    mean = total / m
    squares = 0.0
    for k in range(m):
        squares += (loads[k] - mean) ** 2
    deviation = math.sqrt(squares / rules[2]) if rules[2] > 0.0 else 0.0
    for value, limit in ((total, rules[4]), (deviation, rules[5]), (longest - shortest, rules[6])):
        if value > limit:
            broken += (value - limit) / limit if limit > 0.0 else value
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
        objective = longest - shortest
    else:
        objective = longest + rules[1] * total
    energy = objective + rules[3] * mean
    return energy + rules[7] * broken * (mean + longest), objective, broken


@kernel
def _take(
    node: int, distances: NDArray[np.float64], place: NDArray[np.int64], after: NDArray[np.int64],
    before: NDArray[np.int64], route: NDArray[np.int64], loads: NDArray[np.float64],
    demands: NDArray[np.float64], carried: NDArray[np.float64], counts: NDArray[np.int64],
) -> None:  # fmt: skip
    """Remove `node` from its route."""
    a, b, k = before[node], after[node], route[node]
    here, start, end = place[node], place[a], place[b]
    loads[k] += distances[start, end] - distances[start, here] - distances[here, end]
    carried[k] -= demands[here]
    counts[k] -= 1
    if counts[k] == 0:
        loads[k] = carried[k] = 0.0
    after[a], before[b] = b, a
    route[node] = -1


@kernel
def _put(
    node: int, behind: int, k: int, distances: NDArray[np.float64], place: NDArray[np.int64],
    after: NDArray[np.int64], before: NDArray[np.int64], route: NDArray[np.int64],
    loads: NDArray[np.float64], demands: NDArray[np.float64], carried: NDArray[np.float64],
    counts: NDArray[np.int64],
) -> None:  # fmt: skip
    """Insert `node` into the route of vehicle `k`, behind a node or the mark of the depot."""
    next_ = after[behind]
    here, start, end = place[node], place[behind], place[next_]
    loads[k] += distances[start, here] + distances[here, end] - distances[start, end]
    carried[k] += demands[here]
    counts[k] += 1
    after[behind], before[node] = node, behind
    after[node], before[next_] = next_, node
    route[node] = k


@kernel
def _ruin(
    nodes: NDArray[np.int64], near: NDArray[np.int64], distances: NDArray[np.float64],
    place: NDArray[np.int64], after: NDArray[np.int64], before: NDArray[np.int64],
    route: NDArray[np.int64], loads: NDArray[np.float64], demands: NDArray[np.float64],
    carried: NDArray[np.float64], counts: NDArray[np.int64], removed: NDArray[np.int64], draw: Any,
) -> int:  # fmt: skip
    """Remove adjacent strings of nodes from the routes; return the number of nodes."""
    n = place.size - counts.size
    mean = nodes.size / counts.size
    wide = draw.random() < WIDE
    longest = min(float(FAR if wide else LONGEST), mean)
    limit = 4.0 * (FAR if wide else REMOVED) / (1.0 + longest) - 1.0
    strings = int(draw.random() * limit + 1.0)
    seed = nodes[draw.integers(0, nodes.size)]
    count = taken = 0
    for i in range(near.shape[1] + 1):
        node = seed if i == 0 else near[seed, i - 1]
        if node < 0 or taken >= strings:
            break
        if route[node] < 0:
            continue
        k = route[node]
        length = int(draw.random() * min(longest, float(counts[k])) + 1.0)
        length = min(length, counts[k])
        # The string starts up to its length before the node and may skip nodes (split string).
        preserved = 0
        if length > 1 and draw.random() < 0.5:
            while length + preserved < counts[k] and draw.random() < 0.5:
                preserved += 1
        first = node
        for _ in range(int(draw.random() * (length + preserved))):
            if before[first] < n:
                first = before[first]
        skip = int(draw.random() * length) if preserved else length
        current, passed, dropped = first, 0, 0
        while dropped < length and current < n:
            next_ = after[current]
            if dropped >= skip and passed < preserved:
                passed += 1
            else:
                _take(
                    current, distances, place, after, before, route, loads, demands, carried, counts
                )
                removed[count] = current
                count += 1
                dropped += 1
            current = next_
        taken += 1
    return count


@kernel
def _recreate(
    count: int, near: NDArray[np.int64], distances: NDArray[np.float64],
    place: NDArray[np.int64], after: NDArray[np.int64], before: NDArray[np.int64],
    route: NDArray[np.int64], loads: NDArray[np.float64], demands: NDArray[np.float64],
    carried: NDArray[np.float64], counts: NDArray[np.int64], removed: NDArray[np.int64],
    capacity: NDArray[np.float64], battery: NDArray[np.float64], rules: NDArray[np.float64],
    use_all: bool, least: NDArray[np.float64], spot: NDArray[np.int64], keys: NDArray[np.float64],
    draw: Any,
) -> None:  # fmt: skip
    """Reinsert the removed nodes one by one, each at the position of least energy."""
    m = counts.size
    n = place.size - m
    how = draw.integers(0, 8)
    for i in range(count):
        # Insertion sort: there are few nodes.
        node = removed[i]
        here = place[node]
        if how < 4:
            key = draw.random()
        elif how < 6:
            key = -distances[place[n], here]
        elif how < 7:
            key = distances[place[n], here]
        else:
            key = -demands[here]
        j = i
        while j > 0 and keys[j - 1] > key:
            keys[j], removed[j] = keys[j - 1], removed[j - 1]
            j -= 1
        keys[j], removed[j] = key, node
    # Number of positions until the next skipped one (geometric distribution).
    rate = math.log(1.0 - (LOOSE if rules[0] == RANGE else BLINK))
    passing = math.log(1.0 - draw.random()) / rate
    left = count
    for i in range(count):
        node = removed[i]
        here = place[node]
        empty = 0
        for k in range(m):
            least[k] = math.inf
            if counts[k] == 0:
                empty += 1
        # The remaining nodes may be just enough for the idle vehicles.
        only_empty = use_all and empty >= left
        left -= 1
        for k in range(m):
            if only_empty and counts[k] > 0:
                continue
            for side in range(2):
                if counts[k] > 0 and rules[0] == RANGE and draw.random() < LOOSE:
                    continue
                behind = n + k if side == 0 else before[n + k]
                start, end = place[behind], place[after[behind]]
                cost = distances[start, here] + distances[here, end] - distances[start, end]
                if cost < least[k]:
                    least[k] = cost
                    spot[k] = behind
        if not only_empty:
            for j in range(near.shape[1]):
                other = near[node, j]
                if other < 0:
                    break
                k = route[other]
                if k < 0:
                    continue
                for side in range(2):
                    passing -= 1.0
                    if passing < 0.0:
                        passing = math.log(1.0 - draw.random()) / rate
                        continue
                    behind = other if side == 0 else before[other]
                    start, end = place[behind], place[after[behind]]
                    cost = distances[start, here] + distances[here, end] - distances[start, end]
                    if cost < least[k]:
                        least[k] = cost
                        spot[k] = behind
        best, chosen = math.inf, -1
        for k in range(m):
            if least[k] == math.inf:
                continue
            loads[k] += least[k]
            carried[k] += demands[here]
            energy = measure(loads, carried, capacity, battery, rules)[0]
            loads[k] -= least[k]
            carried[k] -= demands[here]
            # Ties go to the shorter detour.
            if chosen < 0 or energy < best or (energy == best and least[k] < least[chosen]):
                best, chosen = energy, k
        if chosen < 0:
            # Every position was skipped.
            chosen = draw.integers(0, m)
            spot[chosen] = n + chosen
        _put(
            node, spot[chosen], chosen, distances, place, after, before, route, loads, demands,
            carried, counts,
        )  # fmt: skip


@kernel
def _copy(
    after: NDArray[np.int64], before: NDArray[np.int64], route: NDArray[np.int64],
    loads: NDArray[np.float64], carried: NDArray[np.float64], counts: NDArray[np.int64],
    whole: NDArray[np.int64], parts: NDArray[np.float64], back: bool,
) -> None:  # fmt: skip
    """Save the routes in two tables, or restore them if `back` is true."""
    for i in range(after.size):
        if back:
            after[i], before[i], route[i] = whole[0, i], whole[1, i], whole[2, i]
        else:
            whole[0, i], whole[1, i], whole[2, i] = after[i], before[i], route[i]
    for k in range(loads.size):
        if back:
            loads[k], carried[k], counts[k] = parts[0, k], parts[1, k], whole[3, k]
        else:
            parts[0, k], parts[1, k], whole[3, k] = loads[k], carried[k], counts[k]


@kernel
def anneal(
    nodes: NDArray[np.int64], near: NDArray[np.int64], distances: NDArray[np.float64],
    place: NDArray[np.int64], after: NDArray[np.int64], before: NDArray[np.int64],
    route: NDArray[np.int64], loads: NDArray[np.float64], demands: NDArray[np.float64],
    carried: NDArray[np.float64], counts: NDArray[np.int64],
    capacity: NDArray[np.float64], battery: NDArray[np.float64], rules: NDArray[np.float64],
    use_all: bool, hot: float, cold: float, steps: int, flag: NDArray[np.int8], draw: Any,
) -> int:  # fmt: skip
    """Anneal the routes in place, set them to the best ones found and return the number of steps."""
    m = counts.size
    removed = np.empty(nodes.size, np.int64)
    least, spot, keys = np.empty(m), np.empty(m, np.int64), np.empty(nodes.size)
    # Insert the nodes without a route: all of them in a start from scratch.
    count = 0
    for node in nodes:
        if route[node] < 0:
            removed[count] = node
            count += 1
    if count:
        _recreate(
            count, near, distances, place, after, before, route, loads, demands, carried, counts,
            removed, capacity, battery, rules, use_all, least, spot, keys, draw,
        )  # fmt: skip
    energy, objective, broken = measure(loads, carried, capacity, battery, rules)
    now, now_parts = np.empty((4, after.size), np.int64), np.empty((2, m))
    top, top_parts = np.empty((4, after.size), np.int64), np.empty((2, m))
    _copy(after, before, route, loads, carried, counts, now, now_parts, False)
    _copy(after, before, route, loads, carried, counts, top, top_parts, False)
    best, best_broken, best_energy = objective, broken, energy
    cooling = (cold / hot) ** (1.0 / max(steps, 1))
    heat = hot * energy
    done = 0
    while done < steps and not flag[0] and not (best_broken == 0.0 and best <= rules[8]):
        done += 1
        heat *= cooling
        count = _ruin(
            nodes, near, distances, place, after, before, route, loads, demands, carried, counts,
            removed, draw,
        )  # fmt: skip
        _recreate(
            count, near, distances, place, after, before, route, loads, demands, carried, counts,
            removed, capacity, battery, rules, use_all, least, spot, keys, draw,
        )  # fmt: skip
        candidate, objective, broken = measure(loads, carried, capacity, battery, rules)
        if candidate < energy - heat * math.log(1.0 - draw.random()):
            energy = candidate
            _copy(after, before, route, loads, carried, counts, now, now_parts, False)
            less = objective < best or (objective == best and candidate < best_energy)
            if broken < best_broken or (broken == best_broken and less):
                best, best_broken, best_energy = objective, broken, candidate
                _copy(after, before, route, loads, carried, counts, top, top_parts, False)
        else:
            _copy(after, before, route, loads, carried, counts, now, now_parts, True)
    _copy(after, before, route, loads, carried, counts, top, top_parts, True)
    return done
