"""Effect of a leg on the states of a tour, for :mod:`.newton`: slopes, penalties, end conditions."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["STIFF", "ended", "flight", "merit", "moved"]

Floats = NDArray[np.float64]

#: Weight of the augmented Lagrangian; the equation holds exactly as its multiplier converges.
STIFF = 1e8


@kernel
def flight(h: float, u: Floats, bend: Floats, by: Floats) -> tuple[float, float, float]:
    """Return displacement and turn of a leg; fill `by` (3, 2) with derivatives by its lengths."""
    x, y, a = 0.0, 0.0, h
    for k in range(3):
        half = 0.5 * bend[k] * u[k]
        chord = u[k] if bend[k] == 0.0 else 2.0 * math.sin(half) / bend[k]
        x += chord * math.cos(a + half)
        y += chord * math.sin(a + half)
        a += 2.0 * half
        by[k, 0] = math.cos(a) + bend[k] * y
        by[k, 1] = math.sin(a) - bend[k] * x
    for k in range(3):
        by[k, 0] -= bend[k] * y
        by[k, 1] += bend[k] * x
    return x, y, a - h


@kernel
def merit(
    y: Floats, u: Floats, t: Floats, bend: Floats, place: Floats, drift: Floats, radius: Floats,
    turn: float, mu: float, weight: Floats, by: Floats,
) -> tuple[float, float, float]:  # fmt: skip
    """Return the barrier function with penalties, the penalties alone, and the violation."""
    legs, n = len(u), len(place)
    value, off, wrong = y[legs, 3], 0.0, 0.0
    for j in range(legs):
        dx, dy, da = flight(y[j, 2], u[j], bend[j], by)
        gap = abs(y[j, 0] + dx - y[j + 1, 0]) + abs(y[j, 1] + dy - y[j + 1, 1])
        gap += abs(y[j, 2] + da - y[j + 1, 2])
        gap += abs(y[j, 3] + u[j, 0] + u[j, 1] + u[j, 2] - y[j + 1, 3])
        off += weight[0] * gap
        wrong += gap
        for k in range(3):
            value -= mu * math.log(u[j, k])
        if j < n:
            ax = y[j + 1, 0] - place[j, 0] - drift[j, 0] * y[j + 1, 3]
            ay = y[j + 1, 1] - place[j, 1] - drift[j, 1] * y[j + 1, 3]
            if radius[j] > 0.0:
                gap = abs(0.5 * (1.0 - (ax * ax + ay * ay) / radius[j] ** 2) - t[j])
                off += weight[1] * gap
                wrong += gap * radius[j]
                value -= mu * math.log(t[j])
            else:
                off += weight[2] * (abs(ax) + abs(ay))
                wrong += abs(ax) + abs(ay)
        else:
            gap = abs(y[j + 1, 0] - y[0, 0]) + abs(y[j + 1, 1] - y[0, 1])
            gap += abs(y[j + 1, 2] - y[0, 2] - turn)
            off += weight[2] * gap
            wrong += gap
    return value + off, off, wrong


@kernel
def ended(
    state: Floats, base: Floats, j: int, n: int, p: Floats, c: Floats, r: float, turn: float,
    t: float, nu: float, price: Floats, mu: float, curve: Floats, tilt: Floats,
) -> None:  # fmt: skip
    """Add the conditions at the end of leg `j` to the value function (curve, tilt)."""
    if j == n:  # back at the start: difference to the copy of the start's state
        for i in range(3):
            off = state[i] - base[i] - (turn if i == 2 else 0.0)
            curve[i, i] += STIFF
            curve[i + 4, i + 4] += STIFF
            curve[i, i + 4] -= STIFF
            curve[i + 4, i] -= STIFF
            tilt[i] += price[i] + STIFF * off
            tilt[i + 4] -= price[i] + STIFF * off
        return
    ax, ay = state[0] - p[0] - c[0] * state[3], state[1] - p[1] - c[1] * state[3]
    if r > 0.0:
        ax, ay = ax / r, ay / r
        steep, flat = nu / t / r**2, nu / r**2
        hxx, hxy, hyy = steep * ax * ax + flat, steep * ax * ay, steep * ay * ay + flat
        pull = (mu / t - nu / t * (0.5 * (1.0 - ax * ax - ay * ay) - t)) / r
        gx, gy = pull * ax, pull * ay
    else:
        hxx, hxy, hyy = STIFF, 0.0, STIFF
        gx, gy = price[0] + STIFF * ax, price[1] + STIFF * ay
    sx, sy = -(hxx * c[0] + hxy * c[1]), -(hxy * c[0] + hyy * c[1])
    curve[0, 0] += hxx
    curve[0, 1] += hxy
    curve[1, 0] += hxy
    curve[1, 1] += hyy
    curve[0, 3] += sx
    curve[3, 0] += sx
    curve[1, 3] += sy
    curve[3, 1] += sy
    curve[3, 3] -= sx * c[0] + sy * c[1]
    tilt[0] += gx
    tilt[1] += gy
    tilt[3] -= gx * c[0] + gy * c[1]


@kernel
def moved(
    y: Floats, u: Floats, t: Floats, dy: Floats, du: Floats, dt: Floats, ahead: float,
    to_y: Floats, to_u: Floats, to_t: Floats,
) -> None:  # fmt: skip
    """Fill the last three arguments with the first three after a share `ahead` of the step."""
    for j in range(len(y)):
        for i in range(4):
            to_y[j, i] = y[j, i] + ahead * dy[j, i]
    for j in range(len(u)):
        for k in range(3):
            to_u[j, k] = u[j, k] + ahead * du[j, k]
    for j in range(len(t)):
        to_t[j] = t[j] + ahead * dt[j]
