"""Tours as chains of poses, each fixed to a vehicle that may move, joined by shortest paths.

A pose is the configuration of the UAV at a node: an offset from the node's centre, and a heading. The
path begins at node n, the depot, or at a vehicle if its start is free. A leg arrives as soon as a path
of its exact length does: at the first computed root of D(t) = v (t - t0), where D is the length of the
shortest path to the place of the pose at time t.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ...jit import kernel
from ...models.messenger.dubins import (
    RELAXED_WORDS,
    local,
    relaxed,
    shortest,
    sine_and_lift,
    word_lengths,
    word_local,
)
from ...models.messenger.interception import intercept_heading

__all__ = [
    "DISC",
    "FIXED",
    "RIM",
    "TURNS",
    "Scene",
    "Stops",
    "arrive",
    "beyond",
    "confine",
    "end_time",
    "fly",
    "leg",
    "perturb",
    "place",
    "reach_next",
    "where",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Free parts of a pose: none, the heading, the offset along the boundary, or all within the disc.
FIXED, TURNS, RIM, DISC = 0, 1, 2, 3
#: Maximum number of steps of the search for a root, and its final error relative to the length.
STEPS, EXACT = 40, 1e-14
#: Relative difference of lengths that rounding explains.
NEAR = 1e-9


class Scene(NamedTuple):
    """Data of the kernels that a search does not change.

    `nodes` (n + 1, 5) is centre at time 0 (m), velocity (m/s) and radius (m) of each node, and `freedom` (n + 1,) the
    free parts of its pose. A `closed` path returns to its first pose. The UAV has `speed` (m/s) and turning radius
    `r` (m).
    """

    nodes: Floats
    freedom: Ints
    closed: bool
    speed: float
    r: float


class Stops(NamedTuple):
    """Tour: `order` (n + 1,), the nodes at which it stops, and `times` (n + 1,), the time of each stop (s).

    `poses` (n + 1, 3) is offset (m) and heading (rad) of each node. Kernels receive the number of stops separately,
    as `count`.
    """

    order: Ints
    times: Floats
    poses: Floats


@kernel
def duration(dx: float, dy: float, vx: float, vy: float, speed: float) -> float:
    """Return the duration of a straight flight to a point at (dx, dy) that moves with a velocity."""
    room = speed * speed - vx * vx - vy * vy
    along = dx * vx + dy * vy
    after: float = (along + math.sqrt(along * along + room * (dx * dx + dy * dy))) / room
    return after


@kernel
def arrive(
    x: float, y: float, h: float, t: float, node: Floats, pose: Floats, speed: float, r: float
) -> float:
    """Return the time at which the UAV, at (x, y, h) at time t, reaches `pose` of `node`.

    The time is inf if the search fails. `node` is a row of :attr:`Scene.nodes`.
    """
    qx, qy = node[0] + pose[0], node[1] + pose[1]
    vx, vy = node[2], node[3]
    # The straight flight is a lower bound. The search rises from it, since later roots may exist.
    before = duration(qx + vx * t - x, qy + vy * t - y, vx, vy, speed)
    a, b, c, word = shortest(x, y, h, qx + vx * (t + before), qy + vy * (t + before), pose[2], r)
    s = (a + b + c) / speed
    if (vx == 0.0 and vy == 0.0) or a + b + c == 0.0:
        return t + s
    d = a + b + c
    gap = d - speed * before
    slowest = -0.5 * (speed - math.sqrt(vx * vx + vy * vy))
    sin, lift = sine_and_lift(pose[2] - h)
    enough = EXACT * (d + abs(qx) + abs(qy))
    for _ in range(STEPS):
        ex, ey = qx + vx * (t + s), qy + vy * (t + s)
        u, v, slack = local(x, y, h, ex, ey, r)
        a, b, c = word_local(u, v, pose[2] - h, sin, lift, r, slack, word)
        now = a + b + c - speed * s
        if abs(now) <= enough:
            # This is a root of one word; another word may be shorter.
            a, b, c, shorter = shortest(x, y, h, ex, ey, pose[2], r)
            if shorter == word or a + b + c >= speed * s - enough:
                return t + s
            word, now = shorter, a + b + c - speed * s
        elif not now < math.inf:
            a, b, c, word = shortest(x, y, h, ex, ey, pose[2], r)
            now = a + b + c - speed * s
        # Use the secant if its slope is possible, otherwise the step to a pose at rest.
        slope = (now - gap) / (s - before) if s != before else -speed
        if slope > slowest or slope < -3.0 * speed:
            slope = -speed
        before, gap = s, now
        s = max(s - now / slope, 0.0)
    return intercept_heading(x, y, h, t, qx, qy, vx, vy, pose[2], speed, r)[0]


@kernel(interpretable=True, in_place=True)
def where(node: Floats, pose: Floats, t: float) -> tuple[float, float, float]:
    """Return the configuration of `pose` of `node` at time t."""
    return node[0] + node[2] * t + pose[0], node[1] + node[3] * t + pose[1], pose[2]


@kernel(interpretable=True, in_place=True)
def leg(
    x: float, y: float, h: float, ex: float, ey: float, eh: float, r: float, length: float
) -> tuple[float, float, float, int]:  # fmt: skip
    """Return the lengths and the word of the path between two configurations with the given length.

    It is the shortest path, unless a moving pose can only be met later.
    """
    a, b, c, word = shortest(x, y, h, ex, ey, eh, r)
    off = abs(a + b + c - length)
    if off > NEAR * (length + r):
        for other in range(6):
            d, e, f = word_lengths(x, y, h, ex, ey, eh, r, other)
            if abs(d + e + f - length) < off:
                off = abs(d + e + f - length)
                a, b, c, word = d, e, f, other
    return a, b, c, word


@kernel
def reach_next(i: int, t: float, j: int, stops: Stops, scene: Scene) -> float:
    """Return the time at which node j is met after node i at time t."""
    x, y, h = where(scene.nodes[i], stops.poses[i], t)
    return arrive(x, y, h, t, scene.nodes[j], stops.poses[j], scene.speed, scene.r)


@kernel(interpretable=True, in_place=True)
def end_time(stops: Stops, count: int, scene: Scene) -> float:
    """Return the time (s) at which a closed path reaches a home that moves; 0 for a home at rest."""
    i = stops.order[0]
    if not scene.closed or (scene.nodes[i, 2] == 0.0 and scene.nodes[i, 3] == 0.0):
        return 0.0
    last = stops.order[count - 1]
    time: float = reach_next(last, stops.times[count - 1], i, stops, scene)
    return time


@kernel(shared=True)
def fly(stops: Stops, count: int, begin: int, scene: Scene, ceiling: float) -> float:
    """Fill in the times of the stops from `begin` (at least 1) on; return the end of the path (s).

    The end is inf if a time exceeds `ceiling`.
    """
    order, times = stops.order, stops.times
    for k in range(begin, count):
        times[k] = reach_next(order[k - 1], times[k - 1], order[k], stops, scene)
        if not times[k] <= ceiling:
            return math.inf
    end: float = times[count - 1]
    if scene.closed:
        end = reach_next(order[count - 1], end, order[0], stops, scene)
    return end


@kernel
def beyond(
    before: int, t: float, i: int, after: int, pose: Floats, stops: Stops, scene: Scene, most: float
) -> float:
    """Return the time at node `after`, if `before` is met at t and node i between them with `pose`.

    If `after` is -1, return the time at node i. The result is inf if an early bound shows that it
    is not before `most`.
    """
    nodes, poses, speed, r = scene.nodes, stops.poses, scene.speed, scene.r
    x, y, h = where(nodes[before], poses[before], t)
    t = arrive(x, y, h, t, nodes[i], pose, speed, r)
    if after < 0 or not t < most:
        return t
    x, y, h = where(nodes[i], pose, t)
    if most < math.inf:
        # The straight line is a lower bound.
        dx, dy, _ = where(nodes[after], poses[after], most)
        if (dx - x) ** 2 + (dy - y) ** 2 >= (speed * (most - t)) ** 2:
            return math.inf
    met: float = arrive(x, y, h, t, nodes[after], poses[after], speed, r)
    return met


@kernel(interpretable=True, in_place=True)
def confine(pose: Floats, radius: float, freedom: int) -> None:
    """Move the offset of `pose` into the disc, or onto its boundary."""
    size = math.sqrt(pose[0] * pose[0] + pose[1] * pose[1])
    if size > radius or (freedom == RIM and size > 0.0):
        pose[0] *= radius / size
        pose[1] *= radius / size
    elif freedom == RIM:
        pose[0] = radius


@kernel
def perturb(
    before: int, t: float, i: int, after: int, stops: Stops, scene: Scene, rounds: int,
    trial: Floats, draw: Generator,
) -> float:  # fmt: skip
    """Improve the pose of node i between its neighbours by random steps of all sizes."""
    pose, radius, freedom, r = stops.poses[i], scene.nodes[i, 4], scene.freedom[i], scene.r
    best = beyond(before, t, i, after, pose, stops, scene, math.inf)
    moves = freedom >= RIM and radius > 0.0
    for _ in range(rounds if moves or r > 0.0 else 0):
        size = draw.random() ** 3
        for j in range(3):
            trial[j] = pose[j]
        choice = draw.random()
        if r > 0.0 and (choice < 0.7 or not moves):
            trial[2] += 2.0 * size * (2.0 * draw.random() - 1.0)
        if moves and (choice > 0.3 or r == 0.0):
            trial[0] += radius * size * (2.0 * draw.random() - 1.0)
            trial[1] += radius * size * (2.0 * draw.random() - 1.0)
            confine(trial, radius, freedom)
        value = beyond(before, t, i, after, trial, stops, scene, best)
        if value < best:
            best = value
            for j in range(3):
                pose[j] = trial[j]
    return best


@kernel
def towards(x: float, y: float, h: float, px: float, py: float, r: float) -> float:
    """Return the final heading of the shortest path to a point."""
    if r == 0.0:
        return math.atan2(py - y, px - x)
    a, b, word = relaxed(x, y, h, px, py, r)
    turned: float = (RELAXED_WORDS[word, 0] * a + RELAXED_WORDS[word, 1] * b) / r
    return h + turned


@kernel
def place(
    before: int, t: float, i: int, after: int, stops: Stops, scene: Scene, hint: Floats,
    trial: Floats, pose: Floats,
) -> float:  # fmt: skip
    """Fill `pose` with a good one for node i between its neighbours; return its :func:`beyond`.

    The candidates have the offset of the pose `hint`, that of the inside of the corner, or 0. Their
    headings are that of the hint and those of the shortest paths to the node and from it.
    """
    nodes, poses, freedom = scene.nodes, stops.poses, scene.freedom[i]
    speed, r = scene.speed, scene.r
    x, y, h = where(nodes[before], poses[before], t)
    radius, best = nodes[i, 4], math.inf
    heading_in = heading_out = turn = 0.0
    for spot in range(3):
        if spot == 0:
            trial[0], trial[1] = hint[0], hint[1]
        elif spot == 1:
            side = 0.5 * (heading_in + heading_out) + (
                0.5 * math.pi if turn >= 0.0 else -0.5 * math.pi
            )
            if after < 0:
                side = heading_in + math.pi
            trial[0], trial[1] = radius * math.cos(side), radius * math.sin(side)
        else:
            if freedom == RIM or radius == 0.0:
                break
            trial[0], trial[1] = 0.0, 0.0
        confine(trial, radius, freedom)
        px, py = nodes[i, 0] + trial[0], nodes[i, 1] + trial[1]
        dx, dy = px + nodes[i, 2] * t - x, py + nodes[i, 3] * t - y
        late = t + math.sqrt(dx * dx + dy * dy) / speed
        px, py = px + nodes[i, 2] * late, py + nodes[i, 3] * late
        heading_in = towards(x, y, h, px, py, r)
        heading_out = heading_in
        if after >= 0:
            ax, ay, ah = where(nodes[after], poses[after], late)
            late += math.sqrt((ax - px) ** 2 + (ay - py) ** 2) / speed
            ax, ay, ah = where(nodes[after], poses[after], late)
            heading_out = towards(ax, ay, ah + math.pi, px, py, r) + math.pi
        turn = heading_out - heading_in
        turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
        heading_out = heading_in + turn
        for which in range(4 if after >= 0 else 2):
            if which == 0:
                trial[2] = hint[2]
            else:
                trial[2] = heading_in + (0.0 if which == 1 else turn if which == 2 else 0.5 * turn)
            value = beyond(before, t, i, after, trial, stops, scene, best)
            if value < best:
                best = value
                for j in range(3):
                    pose[j] = trial[j]
    return best
