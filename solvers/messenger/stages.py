"""Legs of a tour as stages of a control problem, for :mod:`.newton`: data, slopes, penalties and ends."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = [
    "STIFF",
    "Expansion",
    "Legs",
    "Point",
    "Prices",
    "beyond_home",
    "end_leg",
    "flight",
    "merit",
    "move",
    "offset",
]

Floats = NDArray[np.float64]

#: Weight of the augmented Lagrangian; the equation holds exactly as its multiplier converges.
STIFF = 1e8


class Legs(NamedTuple):
    """Data of a tour with k legs and n vehicles, in the unit of a leg's typical length.

    `bend` (k, 3) is the signed curvature of each primitive. Vehicle j is at ``place[j] + drift[j] s`` after a flight
    of length s; `place` is (n, 2) and `drift` (k, 2). A leg after the last vehicle leads back to the start, which
    moves by ``drift[n] s``. `radius` (n,) is the largest distance at each encounter, `turn` the total turning angle
    of a closed tour (rad), and `free` (3,) is 1 for a free x, y or heading of the start, otherwise 0.
    """

    bend: Floats
    place: Floats
    drift: Floats
    radius: Floats
    turn: float
    free: Floats


class Point(NamedTuple):
    """States y (k + 1, 4), lengths u (k, 3) and slacks t (n,) of the discs, or their changes.

    A state is x, y, heading and length flown, at the start and at the end of each leg.
    """

    y: Floats
    u: Floats
    t: Floats


class Prices(NamedTuple):
    """Multipliers: costates (k + 1, 4), of lengths (k, 3), slacks (n,) and equations (k, 3)."""

    lam: Floats
    z: Floats
    nu: Floats
    price: Floats


class Expansion(NamedTuple):
    """Expansion of the legs, and the value functions and gains of the recursion.

    `slopes` (k, 3, 4) and `swing` (k, 2) are the derivatives of a leg's end by its lengths and of
    its displacement by its heading, `gap` (k, 4) is its end minus the next state, `curve`
    (k + 1, m, m) and `tilt` (k + 1, m) are the derivatives of the value function, and the step of
    the lengths is ``-shift - gain.T @ dy`` with `gain` (k, m, 3) and `shift` (k, 3). A closed tour
    (m = 7 instead of 4) appends a copy of the start's pose to each state.
    """

    slopes: Floats
    swing: Floats
    gap: Floats
    curve: Floats
    tilt: Floats
    gain: Floats
    shift: Floats


@kernel
def flight(h: float, u: Floats, bend: Floats, by: Floats) -> tuple[float, float, float]:
    """Return displacement and turn of a leg; fill `by` (3, 4) with derivatives by its lengths."""
    x, y, a = 0.0, 0.0, h
    for k in range(3):
        half = 0.5 * bend[k] * u[k]
        chord = u[k] if bend[k] == 0.0 else 2.0 * math.sin(half) / bend[k]
        x += chord * math.cos(a + half)
        y += chord * math.sin(a + half)
        a += 2.0 * half
        by[k, 0], by[k, 1] = math.cos(a) + bend[k] * y, math.sin(a) - bend[k] * x
        by[k, 2], by[k, 3] = bend[k], 1.0
    for k in range(3):
        by[k, 0] -= bend[k] * y
        by[k, 1] += bend[k] * x
    return x, y, a - h


@kernel
def offset(y: Floats, j: int, legs: Legs) -> tuple[float, float]:
    """Return the place at the end of leg `j` relative to its vehicle."""
    place, drift = legs.place, legs.drift
    ax = y[j + 1, 0] - place[j, 0] - drift[j, 0] * y[j + 1, 3]
    return ax, y[j + 1, 1] - place[j, 1] - drift[j, 1] * y[j + 1, 3]


@kernel
def beyond_home(y: Floats, j: int, i: int, legs: Legs) -> float:
    """Return entry `i` of the pose at the end of leg `j` minus that of the home, where the leg leads."""
    if i == 2:
        return float(y[j + 1, 2] - y[0, 2] - legs.turn)
    return float(y[j + 1, i] - y[0, i] - legs.drift[j, i] * y[j + 1, 3])


@kernel
def merit(
    point: Point, legs: Legs, mu: float, weight: Floats, by: Floats
) -> tuple[float, float, float]:
    """Return the barrier function with penalties, the penalties alone, and the violation."""
    (y, u, t), bend, radii = point, legs.bend, legs.radius
    value, off, wrong = y[len(u), 3], 0.0, 0.0
    for j in range(len(u)):
        dx, dy, da = flight(y[j, 2], u[j], bend[j], by)
        gap = abs(y[j, 0] + dx - y[j + 1, 0]) + abs(y[j, 1] + dy - y[j + 1, 1])
        gap += abs(y[j, 2] + da - y[j + 1, 2])
        gap += abs(y[j, 3] + u[j, 0] + u[j, 1] + u[j, 2] - y[j + 1, 3])
        off += weight[0] * gap
        wrong += gap
        for k in range(3):
            value -= mu * math.log(u[j, k])
        if j < len(t):
            radius = radii[j]
            ax, ay = offset(y, j, legs)
            if radius > 0.0:
                gap = abs(0.5 * (1.0 - (ax * ax + ay * ay) / radius**2) - t[j])
                off += weight[1] * gap
                wrong += gap * radius
                value -= mu * math.log(t[j])
                continue
            gap = abs(ax) + abs(ay)
        else:
            gap = abs(beyond_home(y, j, 0, legs)) + abs(beyond_home(y, j, 1, legs))
            gap += abs(beyond_home(y, j, 2, legs))
        off += weight[2] * gap
        wrong += gap
    return value + off, off, wrong


@kernel
def end_leg(
    j: int, point: Point, prices: Prices, legs: Legs, mu: float, curve: Floats, tilt: Floats
) -> None:
    """Add the conditions at the end of leg `j` to the value function (curve, tilt)."""
    y, price = point.y, prices.price
    if j == len(point.t):  # back at the start: difference to the copy of the start's state
        for i in range(3):
            pull = price[j, i] + STIFF * beyond_home(y, j, i, legs)
            moves = 0.0 if i == 2 else legs.drift[j, i]
            tilt[i] += pull
            tilt[i + 4] -= pull
            tilt[3] -= moves * pull
            curve[i, i] += STIFF
            curve[i + 4, i + 4] += STIFF
            curve[i, i + 4] -= STIFF
            curve[i + 4, i] -= STIFF
            curve[i, 3] -= moves * STIFF
            curve[3, i] -= moves * STIFF
            curve[i + 4, 3] += moves * STIFF
            curve[3, i + 4] += moves * STIFF
            curve[3, 3] += moves * moves * STIFF
        return
    ax, ay = offset(y, j, legs)
    r, cx, cy = legs.radius[j], legs.drift[j, 0], legs.drift[j, 1]
    if r > 0.0:
        t, nu = point.t[j], prices.nu[j]
        ax, ay = ax / r, ay / r
        steep, flat = nu / t / r**2, nu / r**2
        hxx, hxy, hyy = steep * ax * ax + flat, steep * ax * ay, steep * ay * ay + flat
        pull = (mu / t - nu / t * (0.5 * (1.0 - ax * ax - ay * ay) - t)) / r
        gx, gy = pull * ax, pull * ay
    else:
        hxx, hxy, hyy = STIFF, 0.0, STIFF
        gx, gy = price[j, 0] + STIFF * ax, price[j, 1] + STIFF * ay
    sx, sy = -(hxx * cx + hxy * cy), -(hxy * cx + hyy * cy)
    curve[0, 0] += hxx
    curve[0, 1] += hxy
    curve[1, 0] += hxy
    curve[1, 1] += hyy
    curve[0, 3] += sx
    curve[3, 0] += sx
    curve[1, 3] += sy
    curve[3, 1] += sy
    curve[3, 3] -= sx * cx + sy * cy
    tilt[0] += gx
    tilt[1] += gy
    tilt[3] -= gx * cx + gy * cy


@kernel
def move(point: Point, change: Point, ahead: float, to: Point) -> None:
    """Fill in the point after a share `ahead` of the step."""
    (y, u, t), (dy, du, dt), (to_y, to_u, to_t) = point, change, to
    for j in range(len(y)):
        for i in range(4):
            to_y[j, i] = y[j, i] + ahead * dy[j, i]
    for j in range(len(u)):
        for k in range(3):
            to_u[j, k] = u[j, k] + ahead * du[j, k]
    for j in range(len(t)):
        to_t[j] = t[j] + ahead * dt[j]
