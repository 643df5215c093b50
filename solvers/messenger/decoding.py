"""From an individual to the path that is flown: the decoding of the paper's algorithms.

An individual is an order of the vehicles and three genes a vehicle: the direction ψ (rad) from the
vehicle to the UAV at their encounter, the interval Δt (s) since the encounter before, and the
distance ρ between them as a share of the radius, which is 1 in the paper. The leg to the k-th vehicle
of the order begins with the position, heading and time at which the one before ended, and leads to
P + V t_k + ρ r (cos ψ, sin ψ) at t_k = t_{k-1} + Δt_k with any heading, by a path that is exactly
v Δt_k long. There is one if and only if the shortest path is not longer, and the length does not lie
in the gap of lengths that no path has; the paper prints that inequality reversed.

An interval without a path is repaired (paper: eqs. 9 and 10): it becomes that of the first
interception, which the paper nears by steps along a gradient. An interval of 0 asks for just that.

Arrays that all kernels of the paper's algorithms share:

fleet : float64, shape (n, 5)
    Position (m), velocity (m/s) and radius (m) of each vehicle.
craft : float64, shape (5,)
    x, y (m), heading (rad), speed (m/s) and turning radius (m) of the UAV.
genes : float64, shape (n, 3)
    ψ, Δt, ρ of each vehicle, whatever the order.
poses : float64, shape (n + 1, 4)
    x, y, heading and time at the start and after each leg.
legs : float64, shape (n, 6)
    Lengths of the three primitives of each leg, and the signs of their curvature; with turning radius
    0, where a turn has no length, their headings.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.messenger.dubins import advance, relaxed
from ...models.messenger.elongation import elongated
from ...models.messenger.interception import intercept

__all__ = ["along", "copy_tour", "decode", "fly", "inside", "meet", "stay"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Signs of the two primitives of :data:`~crosstrack.models.messenger.dubins.RELAXED_WORDS` by code.
_FIRST = (1.0, -1.0, 1.0, -1.0)
_SECOND = (0.0, 0.0, -1.0, 1.0)
#: Difference of two lengths that counts as rounding, as a share of all that they come from, and of
#: the radius of the disc.
_ROUNDING, _WITHIN = 1e-13, 1e-10


@kernel
def along(
    x: float, y: float, h: float, s: float, code: float, r: float
) -> tuple[float, float, float]:
    """Return the pose after a primitive of length `s` (m), whose sign or heading is `code`."""
    if r == 0.0:
        return x + s * math.cos(code), y + s * math.sin(code), code
    return advance(x, y, h, s, int(code), r)


@kernel
def _trace(
    poses: Floats, legs: Floats, k: int, r: float,
    a: float, b: float, c: float, s1: float, s2: float, s3: float,
) -> float:  # fmt: skip
    """Note the primitives of leg `k` and where they lead; return their length."""
    legs[k, 0], legs[k, 1], legs[k, 2] = a, b, c
    legs[k, 3], legs[k, 4], legs[k, 5] = s1, s2, s3
    x, y, h = poses[k, 0], poses[k, 1], poses[k, 2]
    for m in range(3):
        if legs[k, m] > 0.0:
            x, y, h = along(x, y, h, legs[k, m], legs[k, 3 + m], r)
    poses[k + 1, 0], poses[k + 1, 1], poses[k + 1, 2] = x, y, h
    return a + b + c


@kernel
def fly(
    poses: Floats, legs: Floats, k: int, qx: float, qy: float, d: float, r: float, noise: float
) -> float:
    """Fly leg `k` to the point (`qx`, `qy`) by a path of length `d`, or by the shortest one.

    Returns the length, which differs from `d` by `noise` at most; inf where there is no path.
    """
    x, y, h = poses[k, 0], poses[k, 1], poses[k, 2]
    if r > 0.0:
        a, b, code = relaxed(x, y, h, qx, qy, r)
        if abs(a + b - d) <= noise:
            return _trace(poses, legs, k, r, a, b, 0.0, _FIRST[code], _SECOND[code], 0.0)
        if d < a + b:
            return math.inf
        a, b, c, s1, s2, s3, ok = elongated(x, y, h, qx, qy, r, d)
        if not ok:
            return math.inf
        return _trace(poses, legs, k, r, a, b, c, float(s1), float(s2), float(s3))
    apart = math.hypot(qx - x, qy - y)
    ahead = math.atan2(qy - y, qx - x) if apart > 0.0 else h
    if abs(apart - d) <= noise:
        return _trace(poses, legs, k, r, apart, 0.0, 0.0, ahead, ahead, ahead)
    if d < apart:
        return math.inf
    # Two straight lines of equal length.
    aside = math.acos(apart / d)
    return _trace(poses, legs, k, r, 0.5 * d, 0.5 * d, 0.0, ahead + aside, ahead - aside, ahead)


@kernel
def stay(poses: Floats, legs: Floats, k: int) -> None:
    """Make leg `k` one of length 0."""
    for m in range(6):
        legs[k, m] = 0.0
    for m in range(4):
        poses[k + 1, m] = poses[k, m]


@kernel
def _arrive(poses: Floats, k: int, taken: float) -> float:
    """Note that leg `k` has `taken` so many seconds."""
    poses[k + 1, 3] = poses[k, 3] + taken
    return taken


@kernel
def meet(
    poses: Floats, legs: Floats, k: int, fleet: Floats, craft: Floats, i: int,
    psi: float, interval: float, rho: float,
) -> float:  # fmt: skip
    """Fly leg `k` to vehicle `i` and return how long it takes (s), repaired where it must be."""
    speed, r = craft[3], craft[4]
    x, y, h, t = poses[k, 0], poses[k, 1], poses[k, 2], poses[k, 3]
    reach = rho * fleet[i, 4]
    px, py = fleet[i, 0] + reach * math.cos(psi), fleet[i, 1] + reach * math.sin(psi)
    vx, vy = fleet[i, 2], fleet[i, 3]
    apart = math.hypot(px + vx * t - x, py + vy * t - y)
    noise = _ROUNDING * (abs(x) + abs(y) + r + speed * t + apart) + _WITHIN * fleet[i, 4]
    if interval > 0.0:
        end = t + interval
        length = fly(poses, legs, k, px + vx * end, py + vy * end, speed * interval, r, noise)
        if length < math.inf:
            return _arrive(poses, k, length / speed)
    if apart <= noise:
        stay(poses, legs, k)
        return 0.0
    wait = intercept(x, y, h, t, px, py, vx, vy, speed, r) - t
    # Rounding may leave the first interception just short of what can be flown.
    more = noise / speed
    for _ in range(100):
        end = t + wait
        length = fly(poses, legs, k, px + vx * end, py + vy * end, speed * wait, r, noise)
        if length < math.inf:
            return _arrive(poses, k, length / speed)
        wait += more
        more *= 2.0
    return math.inf


@kernel
def inside(poses: Floats, k: int, fleet: Floats, i: int, genes: Floats) -> bool:
    """Return whether leg `k` begins inside the disc of `i`, and if so note where, as genes."""
    t, radius = poses[k, 3], fleet[i, 4]
    dx = poses[k, 0] - fleet[i, 0] - fleet[i, 2] * t
    dy = poses[k, 1] - fleet[i, 1] - fleet[i, 3] * t
    apart = math.hypot(dx, dy)
    if apart > radius:
        return False
    genes[i, 0], genes[i, 1] = math.atan2(dy, dx), 0.0
    genes[i, 2] = apart / radius if radius > 0.0 else 1.0
    return True


@kernel
def decode(
    order: Ints, genes: Floats, fleet: Floats, craft: Floats, first: int,
    timed: bool, interior: bool, ceiling: float, poses: Floats, legs: Floats,
) -> float:  # fmt: skip
    """Fly the legs from `first` on, repair their intervals, and return when the tour ends (s).

    Parameters
    ----------
    order, genes, fleet, craft, poses, legs : ndarray
        See the module; intervals that are repaired are written back.
    first : int
        The leg to begin with, from what stands in its row of `poses`.
    timed : bool
        Whether intervals count; else every vehicle is met at its first interception.
    interior : bool
        Whether a vehicle counts as met where the UAV is inside its disc already.
    ceiling : float
        Time (s) from which on nobody is interested in the end; then it is inf.
    """
    for k in range(first, len(order)):
        i = order[k]
        if interior and inside(poses, k, fleet, i, genes):
            stay(poses, legs, k)
            continue
        interval = genes[i, 1] if timed else 0.0
        genes[i, 1] = meet(poses, legs, k, fleet, craft, i, genes[i, 0], interval, genes[i, 2])
        if not poses[k + 1, 3] < ceiling or genes[i, 1] == math.inf:
            return math.inf
    end: float = poses[len(order), 3]
    return end


@kernel
def copy_tour(
    first: int, order: Ints, genes: Floats, poses: Floats, legs: Floats,
    to_order: Ints, to_genes: Floats, to_poses: Floats, to_legs: Floats,
) -> None:  # fmt: skip
    """Copy an individual and its path from leg `first` on, and all genes."""
    n = len(order)
    for k in range(n):
        for m in range(3):
            to_genes[k, m] = genes[k, m]
    for k in range(first, n):
        to_order[k] = order[k]
        for m in range(6):
            to_legs[k, m] = legs[k, m]
    for k in range(first, n + 1):
        for m in range(4):
            to_poses[k, m] = poses[k, m]
