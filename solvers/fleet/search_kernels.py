"""Loops of the annealing of a fleet's routes by ruin and recreate.

Strings of nodes are removed from the routes and reinserted one by one at the cheapest position.
Source: J. Christiaens and G. Vanden Berghe, "Slack induction by string removals for vehicle routing
problems", Transportation Science 54 (2020), doi 10.1287/trsc.2019.0914. The energy, which includes the
balance of the routes, is ours.

The time per step depends neither on the number of nodes nor on that of vehicles: a node is inserted into the
routes of its nearest nodes and a few others, its energy follows from totals (:mod:`.fleet_kernels`), and only
changed entries are copied or restored.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .fleet_kernels import (
    AFTER,
    BEFORE,
    BEHIND,
    BROKEN,
    CARRIED,
    CHANGED,
    COUNT,
    IDLE,
    LISTED,
    LOAD,
    MARK,
    RANGE,
    REFERENCE,
    RESTING,
    ROUTE,
    SAVED,
    SQUARES,
    STALE,
    STAMP,
    TAKEN,
    TOKEN,
    TOTAL,
    TRIED,
    VIOLATED,
    Fleet,
    Routes,
    Work,
    assign,
    copy_entry,
    excess,
    join,
    judge,
    measure,
)  # fmt: skip

__all__ = ["anneal"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]

#: Probability of skipping a position in recreate (the paper's "blink").
BLINK = 0.01
#: The same probability for the objective "range", which a longer route may reduce.
LOOSE = 0.5
#: Mean number of removed nodes, and the longest string.
REMOVED, LONGEST = 10.0, 10
#: Probability of a large ruin, and its number of removed nodes and longest string.
WIDE, FAR = 0.1, 40.0
#: Most vehicles whose routes are all tried in an insertion, and number of random ones among more vehicles.
FEW, OTHERS = 5, 2
#: Number of steps after which sums are computed afresh, against the growth of rounding errors.
AFRESH = 4096


@kernel(allocates=False)
def _pick(draw: Any, count: int) -> int:
    """Return a random number of 0 … count - 1; compiles faster than ``draw.integers``."""
    return min(int(draw.random() * count), count - 1)


@kernel(allocates=False)
def _ruin(fleet: Fleet, routes: Routes, work: Work, draw: Any) -> int:
    """Remove adjacent strings of nodes from the routes; return the number of nodes."""
    nodes, near, links, values = fleet.nodes, fleet.near, routes.links, routes.values
    m = values.shape[1]
    n = links.shape[1] - m
    wide = draw.random() < WIDE
    longest = min(float(FAR if wide else LONGEST), nodes.size / m)
    limit = 4.0 * (FAR if wide else REMOVED) / (1.0 + longest) - 1.0
    strings = int(draw.random() * limit + 1.0)
    seed = nodes[_pick(draw, nodes.size)]
    count = taken = 0
    for i in range(near.shape[1] + 1):
        node = seed if i == 0 else near[seed, i - 1]
        if node < 0 or taken >= strings:
            break
        k = links[ROUTE, node]
        if k < 0:
            continue
        size = int(values[COUNT, k])
        length = min(int(draw.random() * min(longest, float(size)) + 1.0), size)
        # The string starts up to its length before the node and may skip nodes (split string).
        preserved = 0
        if length > 1 and draw.random() < 0.5:
            while length + preserved < size and draw.random() < 0.5:
                preserved += 1
        first = node
        for _ in range(int(draw.random() * (length + preserved))):
            if links[BEFORE, first] < n:
                first = links[BEFORE, first]
        skip = int(draw.random() * length) if preserved else length
        current, passed, dropped = first, 0, 0
        while dropped < length and current < n:
            next_ = links[AFTER, current]
            if dropped >= skip and passed < preserved:
                passed += 1
            else:
                join(fleet, routes, work, current, links[BEFORE, current], k, -1)
                work.lists[TAKEN, count] = current
                count += 1
                dropped += 1
            current = next_
        taken += 1
    return count


@kernel(allocates=False)
def _sort(fleet: Fleet, work: Work, count: int, draw: Any) -> None:
    """Order the removed nodes: at random, from far to near or reversed, or by demand."""
    home, how, lists, costs = fleet.place[-1], _pick(draw, 8), work.lists, work.costs
    for i in range(count):
        # Insertion sort: there are few nodes.
        node = lists[TAKEN, i]
        if how < 4:
            key = draw.random()
        elif how < 6:
            key = -fleet.distances[home, node]
        elif how < 7:
            key = fleet.distances[home, node]
        else:
            key = -fleet.demands[node]
        j = i
        while j > 0 and costs[0, j - 1] > key:
            costs[0, j], lists[TAKEN, j] = costs[0, j - 1], lists[TAKEN, j - 1]
            j -= 1
        costs[0, j], lists[TAKEN, j] = key, node


@kernel(allocates=False)
def _vehicle(work: Work, m: int, which: int, all_idle: bool, draw: Any) -> int:
    """Return a vehicle whose route may be far away: the shortest, a random one, or an idle one."""
    idle = int(work.sums[RESTING])
    if all_idle:
        return int(work.lists[IDLE, which if idle <= FEW else _pick(draw, idle)])
    if m <= FEW:
        return which
    if which == 0:
        i, half = 1, int(work.trees.shape[1] // 2)
        while i < half:
            i *= 2
            i += 1 if work.trees[1, i] > work.trees[1, i + 1] else 0
        return i - half
    if which <= OTHERS or not idle:
        return _pick(draw, m)
    return int(work.lists[IDLE, _pick(draw, idle)])


@kernel(allocates=False)
def _recreate(fleet: Fleet, routes: Routes, work: Work, count: int, draw: Any) -> None:
    """Reinsert the removed nodes one by one, each at the position of least energy."""
    near, distances, place, limits = fleet.near, fleet.distances, fleet.place, fleet.limits
    links, values, sums, trees = routes.links, routes.values, work.sums, work.trees
    rules, lists, costs, m = fleet.rules, work.lists, work.costs, values.shape[1]
    n, half, width = place.size - m, trees.shape[1] // 2, 2 * near.shape[1]
    # Number of positions until the next skipped one (geometric distribution).
    loose = rules[0] == RANGE
    rate = math.log(1.0 - (LOOSE if loose else BLINK))
    passing = math.log(1.0 - draw.random()) / rate
    for i in range(count):
        node = lists[TAKEN, i]
        lists[TOKEN, n + m] += 1
        token, trials = lists[TOKEN, n + m], 0
        # The remaining nodes may be just enough for the idle vehicles.
        idle = int(sums[RESTING])
        all_idle = fleet.use_all and idle >= count - i
        others = min(idle, FEW) if all_idle else (m if m <= FEW else 1 + OTHERS + min(idle, 1))
        # First the positions next to near nodes, then the first and last ones of routes.
        step, end = width if all_idle else 0, -1
        while step != end:
            if step < width:
                other = near[node, step // 2]
                if other < 0:
                    step = width
                    continue
                k = links[ROUTE, other]
                if k < 0:
                    step += 2
                    continue
                behind = other if step % 2 == 0 else links[BEFORE, other]
                passing -= 1.0
                skipped = passing < 0.0
                if skipped:
                    passing = math.log(1.0 - draw.random()) / rate
            else:
                if end < 0:
                    reached = 0 if m <= FEW else trials
                    end = width + 2 * (reached + others)
                j = (step - width) // 2
                if step % 2 == 0:
                    k = (
                        lists[TRIED, j]
                        if j < reached
                        else _vehicle(work, m, j - reached, all_idle, draw)
                    )
                    behind = n + k
                else:
                    behind = links[BEFORE, n + k]
                skipped = loose and values[COUNT, k] > 0.0 and draw.random() < LOOSE
            step += 1
            if skipped:
                continue
            a, b = place[behind], place[links[AFTER, behind]]
            cost = distances[a, node] + distances[node, b] - distances[a, b]
            if lists[TOKEN, k] != token:
                lists[TOKEN, k], lists[TRIED, trials] = token, k
                costs[1, k], lists[BEHIND, k] = cost, behind
                trials += 1
            elif cost < costs[1, k]:
                costs[1, k], lists[BEHIND, k] = cost, behind
        best, chosen = math.inf, -1
        for j in range(trials):
            k = lists[TRIED, j]
            old, new = values[LOAD, k], values[LOAD, k] + costs[1, k]
            total, reference = sums[TOTAL] + costs[1, k], sums[REFERENCE]
            squares = sums[SQUARES] + (new - reference) ** 2 - (old - reference) ** 2
            broken = sums[BROKEN]
            if rules[9] > 0.0:
                was = excess(limits, k, old, values[CARRIED, k])
                now = excess(limits, k, new, values[CARRIED, k] + fleet.demands[node])
                violated = sums[VIOLATED] - (1.0 if was > 0.0 else 0.0)
                broken = broken - was + now if violated or now > 0.0 else 0.0
            longest, shortest = trees[0, 1], trees[1, 1]
            if (old == longest and new < old) or (old == shortest and new > old):
                # The other vehicles decide: the siblings of all ancestors in the trees.
                longest = shortest = new
                at = half + k
                while at > 1:
                    longest = max(longest, trees[0, at ^ 1])
                    shortest = min(shortest, trees[1, at ^ 1])
                    at >>= 1
            energy = judge(
                rules, m, total, squares - (total - m * reference) ** 2 / m, max(longest, new),
                min(shortest, new), broken,
            )[0]  # fmt: skip
            # Ties go to the shorter detour.
            if chosen < 0 or energy < best or (energy == best and costs[1, k] < costs[1, chosen]):
                best, chosen = energy, k
        if chosen < 0:
            # Every position was skipped.
            chosen = _pick(draw, m)
            lists[BEHIND, chosen] = n + chosen
        join(fleet, routes, work, node, lists[BEHIND, chosen], chosen, 1)


@kernel(interpretable=True, in_place=True, allocates=False)
def anneal(
    fleet: Fleet,
    routes: Routes,
    now: Routes,
    top: Routes,
    work: Work,
    hot: float,
    cold: float,
    steps: int,
    flag: NDArray[np.int8],
    draw: Any,
) -> tuple[int, float, float]:
    """Anneal the routes in place and set them to the best ones found.

    `now` and `top` are scratch arrays. Returns the number of steps, and the objective and the violation of
    limits of the best routes.
    """
    rules, values = fleet.rules, routes.values
    m, size = values.shape[1], routes.links.shape[1]
    n, behind = size - m, 0
    sums, lists, trees = work.sums, work.lists, work.trees
    measure(fleet, routes, work)
    for i in range(size):
        copy_entry(routes, now, i)
        copy_entry(routes, top, i)
    energy = best = best_broken = best_energy = math.inf
    cooling = (cold / hot) ** (1.0 / max(steps, 1))
    heat, done = 0.0, -1
    while done < 0 or not (
        done >= steps or flag[0] or (best_broken == 0.0 and best <= rules[8])
    ):  # fmt: skip
        done += 1
        count = 0
        if done:
            count = _ruin(fleet, routes, work, draw)
        else:
            # Insert the nodes without a route: all of them in a start from scratch.
            for node in fleet.nodes:
                if routes.links[ROUTE, node] < 0:
                    lists[TAKEN, count] = node
                    count += 1
        _sort(fleet, work, count, draw)
        _recreate(fleet, routes, work, count, draw)
        squares = sums[SQUARES] - (sums[TOTAL] - m * sums[REFERENCE]) ** 2 / m
        candidate, objective, broken = judge(
            rules, m, sums[TOTAL], squares, trees[0, 1], trees[1, 1], sums[BROKEN]
        )
        accepted = done == 0 or candidate < energy - heat * math.log(1.0 - draw.random())
        heat = heat * cooling if done else hot * candidate
        for i in range(int(sums[LISTED])):
            entry = lists[CHANGED, i]
            lists[STAMP, entry] = 0
            if accepted:
                copy_entry(routes, now, entry)
                if not lists[MARK, entry]:
                    lists[STALE, behind], lists[MARK, entry] = entry, 1
                    behind += 1
                continue
            if entry >= n:
                k = entry - n
                assign(
                    fleet.limits, values, work, k, now.values[LOAD, k], now.values[CARRIED, k],
                    now.values[COUNT, k],
                )  # fmt: skip
            copy_entry(now, routes, entry)
        sums[LISTED] = 0.0
        if not accepted:
            for i in range(SAVED):
                sums[i] = sums[SAVED + i]
            continue
        energy = candidate
        less = objective < best or (objective == best and candidate < best_energy)
        if broken < best_broken or (broken == best_broken and less):
            best, best_broken, best_energy = objective, broken, candidate
            for i in range(behind):
                lists[MARK, lists[STALE, i]] = 0
                copy_entry(now, top, lists[STALE, i])
            behind = 0
        if done % AFRESH == AFRESH - 1:
            energy = measure(fleet, routes, work)[0]
            for k in range(m):
                now.values[LOAD, k] = values[LOAD, k]
        for i in range(SAVED):
            sums[SAVED + i] = sums[i]
    for i in range(size):
        copy_entry(top, routes, i)
    return done, best, best_broken
