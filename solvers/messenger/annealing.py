"""Simulated annealing by ruin and recreate: remove stops, then insert the vehicles that are missed.

A tour stops at some vehicles, with a pose for each, and passes the others on the way. Source of the
moves: J. Christiaens and G. Vanden Berghe, "Slack induction by string removals for vehicle routing
problems", Transportation Science 54 (2020), doi 10.1287/trsc.2019.0914.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ...jit import kernel
from .chain import FIXED, RIM, Scene, Stops, confine, fly, perturb, place, reach_next, where
from .passing import CLOSEST, GAP, LEG, PIECE, PIECES, passes, trace

__all__ = ["anneal"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Maximum length of a removed string of stops.
STRING = 6
#: Probability that an insertion place is skipped ("blink").
BLINK = 0.05
#: Random steps for the pose of a stop: after a change of its neighbours, and as a move by itself.
STEPS, OWN = 4, 12


@kernel
def _copy(stops: Stops, to: Stops) -> None:
    for k in range(len(stops.order)):
        to.order[k], to.times[k] = stops.order[k], stops.times[k]
        for j in range(3):
            to.poses[k, j] = stops.poses[k, j]


@kernel
def _tune(stops: Stops, count: int, k: int, scene: Scene, steps: int, draw: Generator) -> None:
    """Improve the pose of the k-th stop, and update its time."""
    order, times = stops.order, stops.times
    i = order[k]
    if k == 0 or scene.freedom[i] == FIXED:
        return
    after = order[k + 1] if k + 1 < count else order[0] if scene.closed else -1
    trial = np.empty(3)
    perturb(order[k - 1], times[k - 1], i, after, stops, scene, steps, trial, draw)
    times[k] = reach_next(order[k - 1], times[k - 1], i, stops, scene)


@kernel
def _turn_start(stops: Stops, count: int, scene: Scene, steps: int, draw: Generator) -> None:
    """Improve the pose at which the path begins, with its neighbours fixed."""
    i = stops.order[0]
    pose, radius, last = stops.poses[i], scene.nodes[i, 4], stops.order[count - 1]
    best, former = math.inf, np.empty(3)
    for step in range(steps):
        for j in range(3):
            former[j] = pose[j]
        size = draw.random() ** 3 if step else 0.0
        pose[2] += math.pi * size * (2.0 * draw.random() - 1.0)
        if scene.freedom[i] >= RIM and radius > 0.0:
            pose[0] += radius * size * (2.0 * draw.random() - 1.0)
            pose[1] += radius * size * (2.0 * draw.random() - 1.0)
            confine(pose, radius, scene.freedom[i])
        value = reach_next(i, 0.0, stops.order[1], stops, scene)
        if scene.closed:
            t = stops.times[count - 1]
            value += reach_next(last, t, i, stops, scene) - t
        if value < best:
            best = value
        else:
            for j in range(3):
                pose[j] = former[j]


@kernel
def _amplify(stops: Stops, count: int, scene: Scene, growth: Floats) -> None:
    """Fill `growth` with the derivative of the end with respect to the time of each stop.

    For a leg in direction u from stop a to stop b it is (v - u.V_a) / (v - u.V_b), with poses fixed to the vehicles.
    """
    order, times, poses = stops.order, stops.times, stops.poses
    nodes, speed = scene.nodes, scene.speed
    growth[count - 1] = 1.0
    if scene.closed:
        i = order[count - 1]
        x, y, _ = where(nodes[i], poses[i], times[count - 1])
        ex, ey, _ = where(nodes[order[0]], poses[order[0]], 0.0)
        size = math.sqrt((ex - x) ** 2 + (ey - y) ** 2)
        if size > 0.0:
            along = ((ex - x) * nodes[i, 2] + (ey - y) * nodes[i, 3]) / size
            i = order[0]
            back = ((ex - x) * nodes[i, 2] + (ey - y) * nodes[i, 3]) / size
            growth[count - 1] = (speed - along) / (speed - back)
    for k in range(count - 1, 0, -1):
        i, j = order[k - 1], order[k]
        x, y, _ = where(nodes[i], poses[i], times[k - 1])
        ex, ey, _ = where(nodes[j], poses[j], times[k])
        size = math.sqrt((ex - x) ** 2 + (ey - y) ** 2)
        growth[k - 1] = growth[k]
        if size > 0.0:
            ux, uy = (ex - x) / size, (ey - y) / size
            before = speed - ux * nodes[i, 2] - uy * nodes[i, 3]
            growth[k - 1] *= before / (speed - ux * nodes[j, 2] - uy * nodes[j, 3])


@kernel
def _next_missed(
    stops: Stops, count: int, scene: Scene, farthest: bool, pieces: Floats, near: Floats,
    draw: Generator,
) -> int:  # fmt: skip
    """Return a vehicle that the tour misses, the farthest or a random one, or -1; fill in `near`."""
    n = len(stops.order) - 1
    member, missed = np.zeros(n + 1, np.int8), np.empty(n + 1, np.int64)
    for k in range(count):
        member[stops.order[k]] = 1
    missing, chosen, extreme = 0, 0, 0.0
    size = trace(stops, count, scene, pieces)
    for i in range(n):
        if not member[i]:
            rim = scene.freedom[i] == RIM and scene.nodes[i, 4] > 0.0
            if not passes(scene.nodes[i], pieces, size, rim, scene.speed, scene.r, near):
                missed[missing] = i
                if missing == 0 or near[0, GAP] > extreme:
                    chosen, extreme = missing, near[0, GAP]
                missing += 1
    if missing == 0:
        return -1
    i = int(missed[chosen if farthest else int(draw.integers(0, missing))])
    passes(scene.nodes[i], pieces, size, False, scene.speed, scene.r, near)
    return i


@kernel
def _insert(
    stops: Stops, count: int, i: int, scene: Scene, value: float, near: Floats, draw: Generator
) -> int:
    """Insert a vehicle at the position that delays the end least; return it, or -1 without any."""
    order, times, poses = stops.order, stops.times, stops.poses
    trial, pose, best_pose, hint = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    growth = np.ones(len(order))
    _amplify(stops, count, scene, growth)
    best, position = math.inf, -1
    for c in range(CLOSEST + 1):
        if c < CLOSEST:
            if not near[c, GAP] < math.inf or count == 1:
                continue
            k = int(near[c, LEG])
            hint[0], hint[1], hint[2] = near[c, 0], near[c, 1], near[c, 2]
        else:
            if scene.closed and count > 1:
                continue
            k = count
            hint[0], hint[1], hint[2] = 0.0, 0.0, poses[order[count - 1], 2]
        if position >= 0 and draw.random() < BLINK:
            continue
        after = order[k] if k < count else order[0] if scene.closed else -1
        then = times[k] if k < count else value
        before = order[k - 1]
        cost = place(before, times[k - 1], i, after, stops, scene, hint, trial, pose) - then
        if k < count:
            cost *= growth[k]
        if cost < best:
            best, position = cost, k
            for j in range(3):
                best_pose[j] = pose[j]
    if position >= 0:
        for k in range(count, position, -1):
            order[k], times[k] = order[k - 1], times[k - 1]
        order[position] = i
        for j in range(3):
            poses[i, j] = best_pose[j]
    return position


@kernel
def recreate(
    stops: Stops, count: int, scene: Scene, value: float, ceiling: float, pieces: Floats,
    draw: Generator, flag: NDArray[np.int8],
) -> tuple[int, float]:  # fmt: skip
    """Insert stops until no vehicle is missed; return their number and the end (s), inf above `ceiling`."""
    near = np.empty((CLOSEST, GAP + 1))
    # Insert either the vehicle with the largest gap, or a random one.
    farthest = draw.random() < 0.5
    while value < math.inf and not flag[0]:
        i = _next_missed(stops, count, scene, farthest, pieces, near, draw)
        if i < 0:
            return count, value
        position = _insert(stops, count, i, scene, value, near, draw)
        if position < 0:
            break
        count += 1
        _tune(stops, count, position, scene, STEPS, draw)
        value = fly(stops, count, position, scene, ceiling)
    return count, math.inf


@kernel
def _ruin(order: Ints, count: int, draw: Generator) -> tuple[int, int]:
    """Remove a random string of stops; return the number of remaining stops and its position."""
    if count < 2:
        return count, 1
    limit = min(STRING, count - 1)
    size = 1 + int(draw.random() ** 2 * limit)
    begin = int(draw.integers(1, count - size + 1))
    keep = 0
    if size > 2 and draw.random() < 0.3:
        # Keep one stop of the string.
        keep = order[begin + int(draw.integers(0, size))]
    shift = size
    position = begin
    if keep:
        order[position] = keep
        position += 1
        shift -= 1
    for k in range(position, count - shift):
        order[k] = order[k + shift]
    return count - shift, begin


@kernel
def _move(stops: Stops, new: Stops, count: int, scene: Scene, draw: Generator) -> tuple[int, int]:
    """Change a pose, reverse, exchange two or remove stops in `new`; return its stops and first change."""
    order = stops.order
    u = draw.random()
    if u < 0.25 and count > 1:
        begin = int(draw.integers(1, count))
        if scene.freedom[order[0]] != FIXED and draw.random() < 2.0 / count:
            begin = 1
            _turn_start(new, count, scene, OWN, draw)
        else:
            _tune(new, count, begin, scene, OWN, draw)
        return count, begin
    if u < 0.45 and count > 2:
        p, q = int(draw.integers(1, count)), int(draw.integers(1, count))
        if u < 0.35:
            p, q = min(p, q), max(p, q)
            for k in range(p, q + 1):
                new.order[k] = order[p + q - k]
                new.poses[new.order[k], 2] += math.pi
        else:
            new.order[p], new.order[q] = order[q], order[p]
        return count, min(p, q)
    return _ruin(new.order, count, draw)


@kernel(interpretable=True, in_place=True)
def anneal(
    stops: Stops, count: int, scene: Scene, iterations: int, hot: float, cold: float,
    draw: Generator, flag: NDArray[np.int8],
) -> tuple[int, float]:  # fmt: skip
    """Improve a tour in place; return the number of its stops and its end time (s).

    A longer path is accepted with probability exp(-Δ / (T·length)), where T decreases from `hot` to
    `cold`.
    """
    pieces = np.empty((PIECES * (len(stops.order) + 2), PIECE))
    value = fly(stops, count, 1, scene, math.inf)
    count, value = recreate(stops, count, scene, value, math.inf, pieces, draw, flag)
    best_value, best_count = value, count
    best = Stops(stops.order.copy(), stops.times.copy(), stops.poses.copy())
    new = Stops(stops.order.copy(), stops.times.copy(), stops.poses.copy())
    for step in range(iterations):
        if flag[0]:
            break
        heat = hot * (cold / hot) ** (step / iterations)
        ceiling = value * (1.0 - heat * math.log(1.0 - draw.random()))
        _copy(stops, new)
        size, begin = _move(stops, new, count, scene, draw)
        candidate = fly(new, size, max(begin, 1), scene, 2.0 * ceiling)
        if not candidate < math.inf:
            continue
        if begin == 1 and size > 1 and scene.freedom[new.order[0]] != FIXED:
            _turn_start(new, size, scene, STEPS, draw)
        for k in range(max(begin - 1, 1), min(begin + 2, size)):
            _tune(new, size, k, scene, STEPS, draw)
        candidate = fly(new, size, max(begin - 1, 1), scene, ceiling)
        if not candidate < math.inf:
            continue
        size, candidate = recreate(new, size, scene, candidate, ceiling, pieces, draw, flag)
        if candidate <= ceiling:
            value, count = candidate, size
            _copy(new, stops)
            if value < best_value:
                best_value, best_count = value, count
                _copy(stops, best)
    _copy(best, stops)
    return best_count, best_value
