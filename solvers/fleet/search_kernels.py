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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["Fleet", "Routes", "anneal", "measure"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]

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


class Fleet(NamedTuple):
    """Data of a fleet of m vehicles and n nodes, scaled so that the longest distance is 1.

    `near`, shape (n, k), holds the nearest other nodes of each node, -1 beyond the last, and `place`, shape
    (n + m,), the node of each node and mark. `rules`, shape (9,), holds the code of the objective, q,
    divisor in the deviation, weight of the mean load in the energy, limits on sum, deviation and range,
    penalty for a violation as large as its limit in units of mean plus longest load, and objective at which
    annealing ends.
    """

    nodes: Whole
    near: Whole
    distances: Floats
    place: Whole
    demands: Floats
    capacity: Floats
    battery: Floats
    rules: Floats
    use_all: bool


class Routes(NamedTuple):
    """Routes as linked lists, modified in place.

    `after`, `before` and `route`, shape (n + m,), are the next and previous entry of each node and mark,
    and the vehicle of each node, -1 without one. `loads`, `carried` and `counts`, shape (m,), are length,
    demand and number of nodes of each route.
    """

    after: Whole
    before: Whole
    route: Whole
    loads: Floats
    carried: Floats
    counts: Whole


@kernel(interpretable=True, in_place=True)
def measure(fleet: Fleet, routes: Routes) -> tuple[float, float, float]:
    """Return the energy, the objective and the relative violation of limits."""
    loads, carried, capacity = routes.loads, routes.carried, fleet.capacity
    battery, rules = fleet.battery, fleet.rules
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
def _detour(fleet: Fleet, here: int, start: int, end: int) -> float:
    """Return the additional length of a route that visits node `here` between two nodes."""
    distances = fleet.distances
    return float(distances[start, here] + distances[here, end] - distances[start, end])


@kernel
def _take(fleet: Fleet, routes: Routes, node: int) -> None:
    """Remove `node` from its route."""
    a, b, k = routes.before[node], routes.after[node], routes.route[node]
    here, start, end = fleet.place[node], fleet.place[a], fleet.place[b]
    distances = fleet.distances
    routes.loads[k] += distances[start, end] - distances[start, here] - distances[here, end]
    routes.carried[k] -= fleet.demands[here]
    routes.counts[k] -= 1
    if routes.counts[k] == 0:
        routes.loads[k] = routes.carried[k] = 0.0
    routes.after[a], routes.before[b] = b, a
    routes.route[node] = -1


@kernel
def _put(fleet: Fleet, routes: Routes, node: int, behind: int, k: int) -> None:
    """Insert `node` into the route of vehicle `k`, behind a node or the mark of the depot."""
    next_ = routes.after[behind]
    here = fleet.place[node]
    routes.loads[k] += _detour(fleet, here, fleet.place[behind], fleet.place[next_])
    routes.carried[k] += fleet.demands[here]
    routes.counts[k] += 1
    routes.after[behind], routes.before[node] = node, behind
    routes.after[node], routes.before[next_] = next_, node
    routes.route[node] = k


@kernel
def _ruin(fleet: Fleet, routes: Routes, removed: Whole, draw: Any) -> int:
    """Remove adjacent strings of nodes from the routes; return the number of nodes."""
    nodes, near, after, before = fleet.nodes, fleet.near, routes.after, routes.before
    counts = routes.counts
    n = after.size - counts.size
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
        if routes.route[node] < 0:
            continue
        k = routes.route[node]
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
                _take(fleet, routes, current)
                removed[count] = current
                count += 1
                dropped += 1
            current = next_
        taken += 1
    return count


@kernel
def _recreate(fleet: Fleet, routes: Routes, count: int, removed: Whole, draw: Any) -> None:
    """Reinsert the removed nodes one by one, each at the position of least energy."""
    near, distances, place, after = fleet.near, fleet.distances, fleet.place, routes.after
    before, loads, carried, counts = routes.before, routes.loads, routes.carried, routes.counts
    demands, rules = fleet.demands, fleet.rules
    m = counts.size
    n = place.size - m
    least, spot, keys = np.empty(m), np.empty(m, np.int64), np.empty(count)
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
        only_empty = fleet.use_all and empty >= left
        left -= 1
        for k in range(m):
            if only_empty and counts[k] > 0:
                continue
            for side in range(2):
                if counts[k] > 0 and rules[0] == RANGE and draw.random() < LOOSE:
                    continue
                behind = n + k if side == 0 else before[n + k]
                cost = _detour(fleet, here, place[behind], place[after[behind]])
                if cost < least[k]:
                    least[k] = cost
                    spot[k] = behind
        if not only_empty:
            for j in range(near.shape[1]):
                other = near[node, j]
                if other < 0:
                    break
                k = routes.route[other]
                if k < 0:
                    continue
                for side in range(2):
                    passing -= 1.0
                    if passing < 0.0:
                        passing = math.log(1.0 - draw.random()) / rate
                        continue
                    behind = other if side == 0 else before[other]
                    cost = _detour(fleet, here, place[behind], place[after[behind]])
                    if cost < least[k]:
                        least[k] = cost
                        spot[k] = behind
        best, chosen = math.inf, -1
        for k in range(m):
            if least[k] == math.inf:
                continue
            loads[k] += least[k]
            carried[k] += demands[here]
            energy = measure(fleet, routes)[0]
            loads[k] -= least[k]
            carried[k] -= demands[here]
            # Ties go to the shorter detour.
            if chosen < 0 or energy < best or (energy == best and least[k] < least[chosen]):
                best, chosen = energy, k
        if chosen < 0:
            # Every position was skipped.
            chosen = draw.integers(0, m)
            spot[chosen] = n + chosen
        _put(fleet, routes, node, spot[chosen], chosen)


@kernel
def _copy(source: Routes, target: Routes) -> None:
    """Copy the routes in `source` to `target`."""
    for i in range(source.after.size):
        target.after[i], target.before[i] = source.after[i], source.before[i]
        target.route[i] = source.route[i]
    for k in range(source.loads.size):
        target.loads[k], target.carried[k] = source.loads[k], source.carried[k]
        target.counts[k] = source.counts[k]


@kernel
def _copied(routes: Routes) -> Routes:
    return Routes(
        routes.after.copy(), routes.before.copy(), routes.route.copy(), routes.loads.copy(),
        routes.carried.copy(), routes.counts.copy(),
    )  # fmt: skip


@kernel(interpretable=True, in_place=True)
def anneal(
    fleet: Fleet,
    routes: Routes,
    hot: float,
    cold: float,
    steps: int,
    flag: NDArray[np.int8],
    draw: Any,
) -> int:
    """Anneal the routes in place, set them to the best ones found and return the number of steps."""
    removed = np.empty(fleet.nodes.size, np.int64)
    # Insert the nodes without a route: all of them in a start from scratch.
    count = 0
    for node in fleet.nodes:
        if routes.route[node] < 0:
            removed[count] = node
            count += 1
    if count:
        _recreate(fleet, routes, count, removed, draw)
    energy, objective, broken = measure(fleet, routes)
    now, top = _copied(routes), _copied(routes)
    best, best_broken, best_energy = objective, broken, energy
    cooling = (cold / hot) ** (1.0 / max(steps, 1))
    heat = hot * energy
    done = 0
    while done < steps and not flag[0] and not (best_broken == 0.0 and best <= fleet.rules[8]):
        done += 1
        heat *= cooling
        count = _ruin(fleet, routes, removed, draw)
        _recreate(fleet, routes, count, removed, draw)
        candidate, objective, broken = measure(fleet, routes)
        if candidate < energy - heat * math.log(1.0 - draw.random()):
            energy = candidate
            _copy(routes, now)
            less = objective < best or (objective == best and candidate < best_energy)
            if broken < best_broken or (broken == best_broken and less):
                best, best_broken, best_energy = objective, broken, candidate
                _copy(routes, top)
        else:
            _copy(now, routes)
    _copy(top, routes)
    return done
