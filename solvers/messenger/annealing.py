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
from .chain import FIXED, RIM, confine, fly, perturb, place, reach_next, where
from .passing import CLOSEST, PIECE, PIECES, passed, trace

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
def _copy(
    order: Ints, poses: Floats, times: Floats, to: Ints, to_poses: Floats, to_times: Floats
) -> None:
    for k in range(len(order)):
        to[k] = order[k]
        to_times[k] = times[k]
    for i in range(len(poses)):
        for j in range(3):
            to_poses[i, j] = poses[i, j]


@kernel
def _tune(
    order: Ints, count: int, k: int, closed: bool, nodes: Floats, poses: Floats, freedom: Ints,
    speed: float, r: float, times: Floats, steps: int, trial: Floats, draw: Generator,
) -> None:  # fmt: skip
    """Improve the pose of the k-th stop, and update its time."""
    i = order[k]
    if k == 0 or freedom[i] == FIXED:
        return
    after = order[k + 1] if k + 1 < count else order[0] if closed else -1
    perturb(
        order[k - 1], times[k - 1], i, after, nodes, poses, freedom[i], speed, r, steps, trial, draw
    )
    times[k] = reach_next(order[k - 1], times[k - 1], i, nodes, poses, speed, r)


@kernel
def _turn_start(
    order: Ints, count: int, closed: bool, nodes: Floats, poses: Floats, freedom: int, speed: float,
    r: float, times: Floats, steps: int, kept: Floats, draw: Generator,
) -> None:  # fmt: skip
    """Improve the pose at which the path begins, with its neighbours fixed."""
    i = order[0]
    pose, radius, last = poses[i], nodes[i, 4], order[count - 1]
    best = math.inf
    for step in range(steps):
        for j in range(3):
            kept[j] = pose[j]
        size = draw.random() ** 3 if step else 0.0
        pose[2] += math.pi * size * (2.0 * draw.random() - 1.0)
        if freedom >= RIM and radius > 0.0:
            pose[0] += radius * size * (2.0 * draw.random() - 1.0)
            pose[1] += radius * size * (2.0 * draw.random() - 1.0)
            confine(pose, radius, freedom)
        value = reach_next(i, 0.0, order[1], nodes, poses, speed, r)
        if closed:
            value += (
                reach_next(last, times[count - 1], i, nodes, poses, speed, r) - times[count - 1]
            )
        if value < best:
            best = value
        else:
            for j in range(3):
                pose[j] = kept[j]


@kernel
def _amplify(
    order: Ints, count: int, closed: bool, nodes: Floats, poses: Floats, times: Floats, speed: float,
    growth: Floats,
) -> None:  # fmt: skip
    """Fill `growth` with the derivative of the end of a tour with respect to the time of each stop.

    The derivative of a leg in direction u from stop a to stop b is (v - u.V_a) / (v - u.V_b), with
    poses fixed to the vehicles.
    """
    growth[count - 1] = 1.0
    if closed:
        i = order[count - 1]
        x, y, _ = where(nodes[i], poses[i], times[count - 1])
        ex, ey, _ = where(nodes[order[0]], poses[order[0]], 0.0)
        size = math.sqrt((ex - x) ** 2 + (ey - y) ** 2)
        if size > 0.0:
            along = ((ex - x) * nodes[i, 2] + (ey - y) * nodes[i, 3]) / size
            growth[count - 1] = (speed - along) / speed
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
def recreate(
    order: Ints, count: int, closed: bool, nodes: Floats, poses: Floats, freedom: Ints, speed: float,
    r: float, times: Floats, value: float, ceiling: float, pieces: Floats, draw: Generator,
    flag: NDArray[np.int8],
) -> tuple[int, float]:  # fmt: skip
    """Insert stops until the tour meets every vehicle; return the number of stops and the end time (s).

    The end is inf if it exceeds `ceiling`, or if `flag` is set.
    """
    n = len(order) - 1
    member, missed = np.zeros(n + 1, np.int8), np.empty(n + 1, np.int64)
    for k in range(count):
        member[order[k]] = 1
    legs, hints, gaps = np.empty(CLOSEST, np.int64), np.empty((CLOSEST, 4)), np.empty(CLOSEST)
    growth = np.ones(n + 1)
    trial, pose, best_pose, hint = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    # Insert either the vehicle with the largest gap, or a random one.
    farthest = draw.random() < 0.5
    while value < math.inf and not flag[0]:
        missing, chosen, extreme = 0, 0, 0.0
        size = trace(order, count, closed, nodes, poses, times, speed, r, pieces)
        for i in range(n):
            if not member[i]:
                rim = freedom[i] == RIM and nodes[i, 4] > 0.0
                if not passed(nodes[i], pieces, size, rim, speed, r, legs, hints, gaps):
                    missed[missing] = i
                    if missing == 0 or gaps[0] > extreme:
                        chosen, extreme = missing, gaps[0]
                    missing += 1
        if missing == 0:
            return count, value
        i = missed[chosen if farthest else int(draw.integers(0, missing))]
        passed(nodes[i], pieces, size, False, speed, r, legs, hints, gaps)
        _amplify(order, count, closed, nodes, poses, times, speed, growth)
        best, place_at = math.inf, -1
        for c in range(CLOSEST + 1):
            if c < CLOSEST:
                if not gaps[c] < math.inf or count == 1:
                    continue
                k = legs[c]
                for j in range(3):
                    hint[j] = hints[c, j]
            else:
                if closed and count > 1:
                    continue
                k = count
                hint[0], hint[1], hint[2] = 0.0, 0.0, poses[order[count - 1], 2]
            if place_at >= 0 and draw.random() < BLINK:
                continue
            after = order[k] if k < count else order[0] if closed else -1
            then = times[k] if k < count else value
            cost = place(
                order[k - 1], times[k - 1], i, after, nodes, poses, freedom[i], speed, r, hint,
                trial, pose,
            ) - then  # fmt: skip
            if k < count:
                cost *= growth[k]
            if cost < best:
                best, place_at = cost, k
                for j in range(3):
                    best_pose[j] = pose[j]
        if place_at < 0:
            return count, math.inf
        for k in range(count, place_at, -1):
            order[k], times[k] = order[k - 1], times[k - 1]
        order[place_at] = i
        for j in range(3):
            poses[i, j] = best_pose[j]
        member[i] = 1
        count += 1
        _tune(
            order,
            count,
            place_at,
            closed,
            nodes,
            poses,
            freedom,
            speed,
            r,
            times,
            STEPS,
            trial,
            draw,
        )
        value = fly(order, count, place_at, closed, nodes, poses, speed, r, ceiling, times)
    return count, math.inf


@kernel
def _ruin(order: Ints, count: int, draw: Generator) -> tuple[int, int]:
    """Remove a random string of stops; return the number of remaining stops and the string's index."""
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
def anneal(
    order: Ints, count: int, closed: bool, nodes: Floats, poses: Floats, freedom: Ints, speed: float,
    r: float, times: Floats, iterations: int, hot: float, cold: float, draw: Generator,
    flag: NDArray[np.int8],
) -> tuple[int, float]:  # fmt: skip
    """Improve a tour in place; return the number of its stops and its end time (s).

    A longer path is accepted with probability exp(-Δ / (T·length)), where T decreases from `hot` to
    `cold`.
    """
    n = len(order)
    pieces = np.empty((PIECES * (n + 2), PIECE))
    value = fly(order, count, 1, closed, nodes, poses, speed, r, math.inf, times)
    count, value = recreate(
        order,
        count,
        closed,
        nodes,
        poses,
        freedom,
        speed,
        r,
        times,
        value,
        math.inf,
        pieces,
        draw,
        flag,
    )
    best, best_count = value, count
    best_order, best_poses, best_times = order.copy(), poses.copy(), times.copy()
    new, new_poses, new_times = order.copy(), poses.copy(), times.copy()
    trial = np.empty(3)
    for step in range(iterations):
        if flag[0]:
            break
        heat = hot * (cold / hot) ** (step / iterations)
        ceiling = value * (1.0 - heat * math.log(1.0 - draw.random()))
        _copy(order, poses, times, new, new_poses, new_times)
        size = count
        u = draw.random()
        if u < 0.25 and count > 1:
            begin = int(draw.integers(1, count))
            if freedom[order[0]] != FIXED and draw.random() < 2.0 / count:
                begin = 1
                _turn_start(
                    new, size, closed, nodes, new_poses, freedom[order[0]], speed, r, new_times, OWN,
                    trial, draw,
                )  # fmt: skip
            else:
                _tune(
                    new, size, begin, closed, nodes, new_poses, freedom, speed, r, new_times, OWN,
                    trial, draw,
                )  # fmt: skip
        elif u < 0.35 and count > 2:
            # Reverse a stretch of the tour.
            p, q = int(draw.integers(1, count)), int(draw.integers(1, count))
            p, q = min(p, q), max(p, q)
            for k in range(p, q + 1):
                new[k] = order[p + q - k]
                new_poses[new[k], 2] += math.pi
            begin = p
        elif u < 0.45 and count > 2:
            p, q = int(draw.integers(1, count)), int(draw.integers(1, count))
            new[p], new[q] = order[q], order[p]
            begin = min(p, q)
        else:
            size, begin = _ruin(new, count, draw)
        candidate = fly(
            new, size, max(begin, 1), closed, nodes, new_poses, speed, r, 2.0 * ceiling, new_times
        )
        if not candidate < math.inf:
            continue
        if begin == 1 and size > 1 and freedom[new[0]] != FIXED:
            _turn_start(
                new,
                size,
                closed,
                nodes,
                new_poses,
                freedom[new[0]],
                speed,
                r,
                new_times,
                STEPS,
                trial,
                draw,
            )
        for k in range(max(begin - 1, 1), min(begin + 2, size)):
            _tune(
                new,
                size,
                k,
                closed,
                nodes,
                new_poses,
                freedom,
                speed,
                r,
                new_times,
                STEPS,
                trial,
                draw,
            )
        candidate = fly(
            new, size, max(begin - 1, 1), closed, nodes, new_poses, speed, r, ceiling, new_times
        )
        if not candidate < math.inf:
            continue
        size, candidate = recreate(
            new,
            size,
            closed,
            nodes,
            new_poses,
            freedom,
            speed,
            r,
            new_times,
            candidate,
            ceiling,
            pieces,
            draw,
            flag,
        )
        if candidate <= ceiling:
            value, count = candidate, size
            _copy(new, new_poses, new_times, order, poses, times)
            if value < best:
                best, best_count = value, count
                _copy(order, poses, times, best_order, best_poses, best_times)
    _copy(best_order, best_poses, best_times, order, poses, times)
    return best_count, best
