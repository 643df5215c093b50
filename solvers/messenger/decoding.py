"""Encoding, evaluation and repair of the paper's individuals, and conversion to the path flown.

An individual is an order of the vehicles and two genes per vehicle (paper: eq. 6): the polar angle θ (rad)
of the access point on the boundary of its disc, and the interval Δt (s) since the encounter before. The
leg to the k-th vehicle of the order leads to the access point at the time t_k = t_{k-1} + Δt_k (eq. 5)
with a free heading at the end, by a path of the length v Δt_k. Such a path exists if and only if the
shortest path is not longer and v Δt_k is outside the gap of lengths that no path has. The paper prints
this inequality reversed.

Arguments of all kernels of the paper's algorithms:

task : Task
    The problem, and the poses of the individual decoded last, which kernels overwrite.
order : int64, shape (n,)
    Order of the vehicles.
genes : float64, shape (n, 2)
    θ and Δt of each vehicle, in the order of `task.fleet`.
k, i : int
    Leg, and the vehicle that it leads to.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.messenger.dubins import advance, relaxed, relaxed_length
from ...models.messenger.elongation import elongated
from ...models.messenger.interception import intercept

__all__ = [
    "KAPPA",
    "Task",
    "access",
    "assess",
    "bisect",
    "copy_pairs",
    "follow",
    "meet",
    "shortest_time",
    "trace",
    "upper_bound",
    "violation",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Weight of a violation in eq. 8 (paper: κ, much larger than a tour).
KAPPA = 1e9
#: Termination tolerance of Algorithm 1, relative to the time of a straight flight (paper: ε_b, not
#: given).
CLOSE = 1e-9
#: Relative error of the length of a leg after Algorithm 1.
ROUNDING = 1e-8
#: Maximum steps of Algorithm 1 and of the repair (paper, Table I: 1 / ε_r for the repair, ε_r not
#: given).
STEPS, REPAIRS = 100, 100
#: Relative interval of the difference quotient in eq. 9 (paper: η), and step size of eq. 10 (η_t).
ETA, RATE = 1e-6, 1.0
#: Signs of the two primitives of :data:`~crosstrack.models.messenger.dubins.RELAXED_WORDS` by code.
_FIRST = (1.0, -1.0, 1.0, -1.0)
_SECOND = (0.0, 0.0, -1.0, 1.0)


class Task(NamedTuple):
    """Problem as arrays, and scratch poses.

    `fleet` (n, 5) is position (m), velocity (m/s) and radius (m) of each vehicle; `poses` (n + 1, 4) is x, y (m),
    heading (rad) and time (s) at the start and after each leg. The UAV has `speed` (m/s) and turning radius `r`
    (m). A leg may be too short by `margin` (m; paper: ε). `flag` (1,) is the stop flag.
    """

    fleet: Floats
    poses: Floats
    speed: float
    r: float
    margin: float
    flag: NDArray[np.int8]


@kernel
def copy_pairs(values: Floats, to: Floats) -> None:
    """Copy an array of shape (n, 2) in a loop: an assignment of slices takes 4 s longer to compile."""
    for k in range(len(values)):
        to[k, 0], to[k, 1] = values[k, 0], values[k, 1]


@kernel
def access(i: int, theta: float, t: float, task: Task) -> tuple[float, float]:
    """Return the access point of vehicle `i` at time `t` (paper: eq. 5)."""
    fleet = task.fleet
    x = fleet[i, 0] + fleet[i, 2] * t + fleet[i, 4] * math.cos(theta)
    return x, fleet[i, 1] + fleet[i, 3] * t + fleet[i, 4] * math.sin(theta)


@kernel
def violation(
    x: float, y: float, h: float, qx: float, qy: float, r: float, d: float, margin: float
) -> tuple[float, float]:
    """Return the constraint violation of a leg of length `d`, and the heading at its end.

    The violation c of eq. 7 (m) is positive if the shortest path is longer than `d` + `margin`,
    negative if `d` is in the gap of lengths that no path has, and 0 if the leg is feasible. An
    infeasible leg ends with the heading of the shortest path.
    """
    a, b, code = relaxed(x, y, h, qx, qy, r)
    c = a + b - d
    after = h + (_FIRST[code] * a + _SECOND[code] * b) / r
    margin += ROUNDING * (a + b)
    if c > margin:
        return c, after
    if c > -margin:
        return 0.0, after
    a, b, last, s1, s2, s3, ok = elongated(x, y, h, qx, qy, r, d)
    if not ok:
        return c, after
    return 0.0, h + (s1 * a + s2 * b + s3 * last) / r


@kernel
def bisect(
    x: float, y: float, h: float, t: float, px: float, py: float, vx: float, vy: float,
    speed: float, r: float,
) -> float:  # fmt: skip
    """Return the time (s) that the UAV needs from `t` on to meet a moving point: Algorithm 1.

    The bisection finds a root of δ(τ) = D_min / v - τ between the bounds of Lemma 1. Correction:
    D_min jumps, so the signs of δ at these bounds can be wrong. Then the lower bound becomes 0, or
    the upper bound is doubled. At a jump the printed bisection does not terminate; the result is
    then that of :func:`~crosstrack.models.messenger.interception.intercept`, whose arguments these
    are.
    """
    px, py, pace = px + vx * t, py + vy * t, math.hypot(vx, vy)
    here = relaxed_length(x, y, h, px, py, r)
    low, high = here / (speed + pace), here / (speed - pace)
    close = CLOSE * here / speed
    if relaxed_length(x, y, h, px + vx * low, py + vy * low, r) < speed * low:
        low = 0.0
    while relaxed_length(x, y, h, px + vx * high, py + vy * high, r) > speed * high + close * speed:
        high *= 2.0
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        late = relaxed_length(x, y, h, px + vx * middle, py + vy * middle, r) / speed - middle
        if abs(late) <= close:
            return middle
        if late > 0.0:
            low = middle
        else:
            high = middle
        if high - low <= 1e-3 * close:
            break
    return intercept(x, y, h, 0.0, px, py, vx, vy, speed, r)


@kernel
def shortest_time(k: int, i: int, theta: float, task: Task) -> float:
    """Return the shortest time (s) of leg `k` to the access point `theta` of vehicle `i`."""
    pose, fleet = task.poses[k], task.fleet
    px, py = access(i, theta, 0.0, task)
    return bisect(
        pose[0], pose[1], pose[2], pose[3], px, py, fleet[i, 2], fleet[i, 3], task.speed, task.r
    )


@kernel
def upper_bound(k: int, i: int, theta: float, task: Task) -> float:
    """Return t_max of Lemma 1 (s) for leg `k` to the access point `theta` of vehicle `i`."""
    pose = task.poses[k]
    px, py = access(i, theta, pose[3], task)
    length = relaxed_length(pose[0], pose[1], pose[2], px, py, task.r)
    bound: float = length / (task.speed - math.hypot(task.fleet[i, 2], task.fleet[i, 3]))
    return bound


@kernel
def meet(k: int, i: int, genes: Floats, task: Task) -> float:
    """Fill in the pose after leg `k`, according to the genes; return c of eq. 7 (m)."""
    pose, after = task.poses[k], task.poses[k + 1]
    after[3] = pose[3] + genes[i, 1]
    after[0], after[1] = access(i, genes[i, 0], after[3], task)
    c, after[2] = violation(
        pose[0], pose[1], pose[2], after[0], after[1], task.r, task.speed * genes[i, 1], task.margin
    )
    return c


@kernel
def _repaired(k: int, i: int, genes: Floats, c: float, task: Task) -> float:
    """Return the interval of leg `k` after steps along the gradient of c (paper: eqs. 9 and 10)."""
    interval: float = genes[i, 1]
    pose, speed, theta = task.poses[k], task.speed, genes[i, 0]
    x, y, h, t = pose[0], pose[1], pose[2], pose[3]
    for _ in range(REPAIRS):
        eta = ETA * (interval + abs(c) / speed)
        qx, qy = access(i, theta, t + interval + eta, task)
        ahead = relaxed_length(x, y, h, qx, qy, task.r) - speed * (interval + eta)
        slope = (ahead - c) / eta
        # A difference quotient across a jump has the wrong sign or size.
        if not -2.0 * speed < slope < 0.0:
            slope = -speed
        interval = max(interval - RATE * c / slope, 0.0)
        qx, qy = access(i, theta, t + interval, task)
        c, _ = violation(x, y, h, qx, qy, task.r, speed * interval, 0.01 * task.margin)
        if c == 0.0:
            break
    return interval


@kernel
def assess(order: Ints, genes: Floats, task: Task, repair: bool) -> tuple[float, float]:
    """Decode an individual; return the end of the tour (s) and Σ|c| (m).

    If `repair`, infeasible intervals are repaired one after the other in `genes`.
    """
    off = 0.0
    for k in range(len(order)):
        i = order[k]
        c = meet(k, i, genes, task)
        if c != 0.0 and repair:
            genes[i, 1] = _repaired(k, i, genes, c, task)
            c = meet(k, i, genes, task)
        off += abs(c)
    end: float = task.poses[len(order), 3]
    return end, off


@kernel
def follow(order: Ints, genes: Floats, task: Task, first: int, ceiling: float) -> float:
    """Meet each vehicle in the shortest time, from leg `first` on; return the end of the tour (s).

    Writes the intervals to `genes`. The end is inf if it is not before `ceiling` (s).
    """
    for k in range(first, len(order)):
        i = order[k]
        genes[i, 1] = shortest_time(k, i, genes[i, 0], task)
        if meet(k, i, genes, task) != 0.0 or not task.poses[k + 1, 3] < ceiling:
            return math.inf
    end: float = task.poses[len(order), 3]
    return end


@kernel
def _fly(
    pose: Floats, after: Floats, leg: Floats, qx: float, qy: float, d: float, r: float, noise: float
) -> float:
    """Fill in a leg of length `d` up to `noise` and its end pose; return its length (m), inf without a path."""
    x, y, h = pose[0], pose[1], pose[2]
    a, b, code = relaxed(x, y, h, qx, qy, r)
    c, s1, s2, s3 = 0.0, int(_FIRST[code]), int(_SECOND[code]), 0
    if abs(a + b - d) > noise:
        if d < a + b:
            return math.inf
        a, b, c, s1, s2, s3, ok = elongated(x, y, h, qx, qy, r, d)
        if not ok:
            return math.inf
    x, y, h = advance(x, y, h, a, s1, r)
    x, y, h = advance(x, y, h, b, s2, r)
    after[0], after[1], after[2] = advance(x, y, h, c, s3, r)
    leg[0], leg[1], leg[2], leg[3], leg[4], leg[5] = a, b, c, s1, s2, s3
    return a + b + c


@kernel
def trace(order: Ints, genes: Floats, task: Task, legs: Floats) -> float:
    """Fill in the path of an individual exactly, without the margin ε; return its end (s).

    `legs`, shape (n, 6), receives the lengths of the three primitives of each leg and the signs of
    their curvature. An interval equal to the shortest time up to ε is replaced by the exact
    shortest time. If D_min jumps there, it is replaced by the time of the first interception. The
    end is inf if rounding leaves no path.
    """
    speed, r = task.speed, task.r
    for k in range(len(order)):
        i = order[k]
        pose, after = task.poses[k], task.poses[k + 1]
        x, y, h, t = pose[0], pose[1], pose[2], pose[3]
        px, py = access(i, genes[i, 0], t, task)
        vx, vy = task.fleet[i, 2], task.fleet[i, 3]
        noise = 1e-13 * (abs(x) + abs(y) + r + speed * t + math.hypot(px - x, py - y))
        noise += 1e-10 * task.fleet[i, 4]
        high = genes[i, 1]
        shortest = relaxed_length(x, y, h, px + vx * high, py + vy * high, r)
        short = abs(shortest - speed * high)
        if noise < short <= task.margin + ROUNDING * shortest:
            more = 2.0 * short / (speed - math.hypot(vx, vy))
            low, high = max(high - more, 0.0), high + more
            for _ in range(60):
                middle = 0.5 * (low + high)
                if relaxed_length(x, y, h, px + vx * middle, py + vy * middle, r) > speed * middle:
                    low = middle
                else:
                    high = middle
        length = _fly(pose, after, legs[k], px + vx * high, py + vy * high, speed * high, r, noise)
        if length == math.inf:
            high = intercept(x, y, h, 0.0, px, py, vx, vy, speed, r)
            more = noise / speed
            for _ in range(100):
                length = _fly(
                    pose, after, legs[k], px + vx * high, py + vy * high, speed * high, r, noise
                )
                if length < math.inf:
                    break
                # Because of rounding, the first interception may be slightly too short for a path.
                high += more
                more *= 2.0
        if length == math.inf:
            return math.inf
        after[3] = t + length / speed
    end: float = task.poses[len(order), 3]
    return end
