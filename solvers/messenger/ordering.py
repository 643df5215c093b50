"""Orders of many vehicles, by annealing of a path that is simple to compute.

The UAV flies the shortest path to the point of the next disc that is nearest to the line towards the vehicle
after it. If it departs sooner, it meets the later vehicles sooner, apart from jumps of the shortest path.
A change is therefore evaluated only until the path joins the former one. The change of the end follows from
the derivative of the end with respect to the time of an encounter. The whole path is computed if this
estimate is accepted.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ...jit import kernel
from ...models.messenger.dubins import FULL, RELAXED_WORDS, relaxed_local
from ...models.messenger.interception import intercept
from .chain import Scene, duration

__all__ = ["anneal_order"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Nearest vehicles next to which a vehicle is moved.
NEIGHBOURS = 12
#: Longest string of vehicles that is moved.
STRING = 4
#: Number of legs after a change until the path has joined the former one.
JOIN = 2
#: Steps of the time of a leg, and its relative error.
STEPS, NEAR = 8, 1e-9


@kernel
def _meet(
    here: Floats, i: int, after: int, nodes: Floats, speed: float, r: float, there: Floats
) -> None:
    """Fill in the pose and time at which the UAV, at pose and time `here`, meets node i before another."""
    x, y, h, t = here[0], here[1], here[2], here[3]
    vx, vy, radius = nodes[i, 2], nodes[i, 3], nodes[i, 4]
    dx, dy = nodes[i, 0] + vx * t - x, nodes[i, 1] + vy * t - y
    if dx * dx + dy * dy <= radius * radius:
        there[0], there[1], there[2], there[3] = x, y, h, t
        return
    s = duration(dx, dy, vx, vy, speed)
    if radius > 0.0:
        cx, cy = dx + vx * s, dy + vy * s  # the centre, and that of the following vehicle
        share, ex, ey = 0.0, 0.0, 0.0
        if after >= 0:
            wx, wy = nodes[after, 2], nodes[after, 3]
            ex, ey = nodes[after, 0] + wx * (t + s) - x, nodes[after, 1] + wy * (t + s) - y
            late = duration(ex - cx, ey - cy, wx, wy, speed)
            ex, ey = ex + wx * late, ey + wy * late
            square = ex * ex + ey * ey
            if square > 0.0:
                share = min(max((cx * ex + cy * ey) / square, 0.0), 1.0)
        ox, oy = share * ex - cx, share * ey - cy
        size = math.sqrt(ox * ox + oy * oy)
        if size > radius:
            ox, oy = ox * radius / size, oy * radius / size
        dx, dy = dx + ox, dy + oy
        s = duration(dx, dy, vx, vy, speed)
    if r > 0.0:
        cos, sin = math.cos(h), math.sin(h)
        for _ in range(STEPS):
            ex, ey = dx + vx * s, dy + vy * s
            a, b, word = relaxed_local(ex * cos + ey * sin, ey * cos - ex * sin, r, 0.0)
            h = here[2] + (RELAXED_WORDS[word, 0] * a + RELAXED_WORDS[word, 1] * b) / r
            off = (a + b) / speed - s
            s += off / (1.0 - (vx * math.cos(h) + vy * math.sin(h)) / speed)
            if abs(off) <= NEAR * s:
                break
        else:
            dx, dy = x + dx - vx * t, y + dy - vy * t
            # The length jumps: the vehicle is met later, on a longer path, which a circle may replace.
            s = intercept(x, y, here[2], t, dx, dy, vx, vy, speed, r) - t + FULL * r / speed
            dx, dy = dx + vx * t - x, dy + vy * t - y
    else:
        h = math.atan2(dy + vy * s, dx + vx * s)
    there[0], there[1], there[2], there[3] = x + dx + vx * s, y + dy + vy * s, h, t + s


@kernel
def time_order(
    order: Ints, begin: int, end: int, scene: Scene, path: Floats, ceiling: float
) -> float:
    """Fill in the encounters from `begin` (at least 1) to before `end`; return the last time.

    It includes the straight flight back of a complete closed tour, and is inf above `ceiling`.
    """
    n = len(order)
    for k in range(begin, end):
        after = order[k + 1] if k + 1 < n else -1
        _meet(path[k - 1], order[k], after, scene.nodes, scene.speed, scene.r, path[k])
        if not path[k, 3] <= ceiling:
            return math.inf
    last: float = path[end - 1, 3]
    if end == n and scene.closed:
        last += math.hypot(path[0, 0] - path[n - 1, 0], path[0, 1] - path[n - 1, 1]) / scene.speed
    return last


@kernel
def _growth(order: Ints, scene: Scene, path: Floats, growth: Floats) -> None:
    """Fill in the derivative of the end with respect to the time of each encounter."""
    nodes, speed = scene.nodes, scene.speed
    growth[len(order) - 1] = 1.0
    for k in range(len(order) - 1, 0, -1):
        dx, dy = path[k, 0] - path[k - 1, 0], path[k, 1] - path[k - 1, 1]
        size, i, j = math.sqrt(dx * dx + dy * dy), order[k - 1], order[k]
        growth[k - 1] = growth[k]
        if size > 0.0:
            dx, dy = dx / size, dy / size
            growth[k - 1] *= (speed - dx * nodes[i, 2] - dy * nodes[i, 3]) / (
                speed - dx * nodes[j, 2] - dy * nodes[j, 3]
            )


@kernel
def _neighbours(order: Ints, nodes: Floats, path: Floats, near: Ints) -> None:
    """Fill in the nodes that are nearest to each node when the path meets it."""
    n, count = len(order), near.shape[1]
    apart = np.empty(count)
    for k in range(n):
        i, t = order[k], path[k, 3]
        apart[:] = math.inf
        for j in order:
            if j == i:
                continue
            dx = nodes[j, 0] - nodes[i, 0] + (nodes[j, 2] - nodes[i, 2]) * t
            dy = nodes[j, 1] - nodes[i, 1] + (nodes[j, 3] - nodes[i, 3]) * t
            size = math.sqrt(dx * dx + dy * dy)
            if size >= apart[count - 1]:
                continue
            row = count - 1
            while row > 0 and size < apart[row - 1]:
                apart[row], near[i, row] = apart[row - 1], near[i, row - 1]
                row -= 1
            apart[row], near[i, row] = size, j


@kernel
def _change(order: Ints, new: Ints, p: int, q: int, draw: Generator) -> tuple[int, int]:
    """Move a string at p next to q in `new`, or reverse the stretch; return the changed range."""
    n = len(order)
    u = draw.random()
    if u < 0.3:  # p and q become neighbours by a reversal
        low, high = (p + 1, q) if p < q else (q, p - 1)
        if draw.random() < 0.5:
            low, high = (p, q - 1) if p < q else (q + 1, p)
        low = max(low, 1)
        for k in range(low, high + 1):
            new[k] = order[low + high - k]
        return low, high
    size = 1 + int(draw.random() ** 2 * STRING)
    back = draw.random() < 0.5
    if p < q:
        size = min(size, q - p)
        high = q if draw.random() < 0.7 else max(q - 1, p + size - 1)
        low, shift = p, high - size + 1
        for k in range(p + size, high + 1):
            new[k - size] = order[k]
    else:
        size = min(size, n - p)
        low, high = q + 1 if draw.random() < 0.7 else max(q, 1), p + size - 1
        shift = low
        for k in range(p - 1, low - 1, -1):
            new[k + size] = order[k]
    for m in range(size):
        new[shift + m] = order[p + size - 1 - m] if back else order[p + m]
    return low, high


@kernel(interpretable=True, in_place=True)
def anneal_order(
    order: Ints, scene: Scene, path: Floats, steps: int, hot: float, cold: float,
    draw: Generator, flag: NDArray[np.int8],
) -> float:  # fmt: skip
    """Improve an order in place, whose first node is where the path begins; return the end (s).

    `path`, shape (n, 4), contains the start, and receives pose and time of the encounters.
    """
    n, nodes = len(order), scene.nodes
    value = time_order(order, 1, n, scene, path, math.inf)
    if n < 3:
        return value
    new, spot, rank = order.copy(), path.copy(), np.empty(len(nodes), np.int64)
    best, best_value = order.copy(), value
    growth, near = np.ones(n), np.zeros((len(nodes), min(NEIGHBOURS, n - 2)), np.int64)
    fresh, refresh = False, 0
    for step in range(steps):
        if flag[0]:
            break
        if not fresh:
            _growth(order, scene, path, growth)
            for k in range(n):
                rank[order[k]] = k
            if step >= refresh:
                _neighbours(order, nodes, path, near)
                refresh = step + 100 * n
            fresh = True
        heat = hot * (cold / hot) ** (step / steps)
        ceiling = value * (1.0 - heat * math.log(1.0 - draw.random()))
        p = int(draw.integers(1, n))
        q = rank[near[order[p], int(draw.random() ** 2 * near.shape[1])]]
        low, high = _change(order, new, p, q, draw)
        begin, join = max(low - 1, 1), min(high + JOIN, n - 1)
        for m in range(4):
            spot[begin - 1, m] = path[begin - 1, m]
        most = path[join, 3] + (ceiling - value) / growth[join]
        there = time_order(new, begin, join + 1, scene, spot, most)
        if there < math.inf and join + 1 < n:
            there = time_order(new, join + 1, n, scene, spot, 2.0 * ceiling)
        if there <= ceiling:
            value, fresh = there, False
            for k in range(low, high + 1):
                order[k] = new[k]
            for k in range(begin, n):
                for m in range(4):
                    path[k, m] = spot[k, m]
            if value < best_value:
                best_value = value
                for k in range(n):
                    best[k] = order[k]
        else:
            for k in range(low, high + 1):
                new[k] = order[k]
    for k in range(n):
        order[k] = best[k]
    return time_order(order, 1, n, scene, path, math.inf)
