"""Structured interior-point method for the lengths of a tour's primitives.

The program is that of :mod:`crosstrack.models.messenger.motion`: non-negative lengths u of three
primitives per leg lead from one state (x, y, heading, length flown) to the next, and vehicles are
met within their radii. As an optimal control problem, each leg is a stage. A Newton step then takes
one backward and one forward pass over the legs (a Riccati recursion) instead of a sparse
factorization. With D the displacement of a leg, J a quarter turn and κ_k the curvature of primitive
k,

    ∂D/∂h = J D,  ∂²D/∂h² = -D,  ∂²D/∂h∂u_m = J ∂D/∂u_m,  ∂²D/∂u_k∂u_m = κ_k J ∂D/∂u_m for k <= m,

so second derivatives follow from first derivatives at negligible cost.

Source: Wächter and Biegler, Mathematical Programming 106 (2006) 25-57, for the barrier and the step
lengths; Rao, Wright and Rawlings, Journal of Optimization Theory and Applications 99 (1998) 723-757,
for the recursion.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .stages import (
    STIFF,
    Expansion,
    Legs,
    Point,
    Prices,
    beyond_home,
    end_leg,
    flight,
    merit,
    move,
    offset,
)

__all__ = ["improve"]

Floats = NDArray[np.float64]

#: Final barrier parameter, relative to a leg's typical length, and its reduction factor.
LAST, FALL = 1e-9, 0.2
#: Fraction to the boundary of a step.
BOUNDARY = 0.995
#: Number of consecutive steps that may increase the merit function.
PATIENT = 3


@kernel
def _factor(a: Floats) -> bool:
    """Overwrite the lower triangle of `a` (3, 3) with its Cholesky factor; False if none exists."""
    for i in range(3):
        for j in range(i + 1):
            rest = a[i, j]
            for k in range(j):
                rest -= a[i, k] * a[j, k]
            if i > j:
                a[i, j] = rest / a[j, j]
            elif rest > 1e-14 * abs(a[i, i]) and rest < math.inf:
                a[i, i] = math.sqrt(rest)
            else:
                return False
    return True


@kernel
def _solve(a: Floats, b: Floats) -> None:
    """Overwrite `b` (3,) with the solution of the system with Cholesky factor `a`."""
    for i in range(3):
        for k in range(i):
            b[i] -= a[i, k] * b[k]
        b[i] /= a[i, i]
    for i in range(2, -1, -1):
        for k in range(i + 1, 3):
            b[i] -= a[k, i] * b[k]
        b[i] /= a[i, i]


@kernel
def _expand(point: Point, legs: Legs, model: Expansion) -> None:
    """Fill in the expansion of each leg."""
    y, u = point.y, point.u
    for j in range(len(u)):
        dx, dy, da = flight(y[j, 2], u[j], legs.bend[j], model.slopes[j])
        model.swing[j, 0], model.swing[j, 1] = -dy, dx
        gap = model.gap[j]
        gap[0], gap[1] = y[j, 0] + dx - y[j + 1, 0], y[j, 1] + dy - y[j + 1, 1]
        gap[2] = y[j, 2] + da - y[j + 1, 2]
        gap[3] = y[j, 3] + u[j, 0] + u[j, 1] + u[j, 2] - y[j + 1, 3]


@kernel
def _expand_lengths(
    j: int, u: Floats, z: Floats, lam: Floats, bend: Floats, model: Expansion, mu: float,
    damp: float, block: Floats, mixed: Floats, col: Floats,
) -> None:  # fmt: skip
    """Fill in the second derivatives by the lengths of leg `j` (block, mixed) and the first (col)."""
    later, tilt, by = model.curve[j + 1], model.tilt[j + 1], model.slopes[j]
    swing, gap = model.swing[j], model.gap[j]
    for k in range(3):
        for i in range(len(tilt)):
            value = 0.0
            for p in range(4):
                value += later[i, p] * by[k, p]
            mixed[k, i] = value
    for k in range(3):
        # λ × the second derivative by the heading and the length.
        bent = lam[1] * by[k, 0] - lam[0] * by[k, 1]
        total = 0.0
        for i in range(4):
            for p in range(4):
                total += by[k, i] * later[i, p] * gap[p]
            total += by[k, i] * tilt[i]
        col[k] = total - mu / u[k]
        for i in range(k + 1):
            value = 0.0
            for p in range(4):
                value += mixed[i, p] * by[k, p]
            block[k, i] = value + bend[i] * bent
        block[k, k] += z[k] / u[k] + damp * (1.0 + bend[k] ** 2)
    for k in range(3):
        mixed[k, 2] += mixed[k, 0] * swing[0] + mixed[k, 1] * swing[1]
        mixed[k, 2] += lam[1] * by[k, 0] - lam[0] * by[k, 1]


@kernel
def _backward(
    point: Point, prices: Prices, legs: Legs, model: Expansion, mu: float, damp: float
) -> bool:
    """Fill in value functions and gains; return False if a leg's step is not unique."""
    count, m = len(point.u), model.tilt.shape[1]
    block, mixed, col = np.zeros((3, 3)), np.zeros((3, m)), np.zeros(3)
    model.curve[count], model.tilt[count] = 0.0, 0.0
    model.tilt[count, 3] = 1.0
    for j in range(count - 1, -1, -1):
        later, q, swing = model.curve[j + 1], model.tilt[j + 1], model.swing[j]
        end_leg(j, point, prices, legs, mu, later, q)
        _expand_lengths(
            j, point.u[j], prices.z[j], prices.lam[j + 1], legs.bend[j], model, mu, damp, block,
            mixed, col,
        )  # fmt: skip
        if not _factor(block):
            return False
        gain, shift, gap = model.gain[j], model.shift[j], model.gap[j]
        for k in range(3):
            shift[k] = col[k]
            for i in range(m):
                gain[i, k] = mixed[k, i]
        _solve(block, shift)
        for i in range(m):
            _solve(block, gain[i])
        # Value function at the start of the leg.
        now, v = model.curve[j], model.tilt[j]
        for i in range(m):
            v[i] = q[i]
            for p in range(m):
                now[i, p] = later[i, p]
            for p in range(4):
                v[i] += later[i, p] * gap[p]
        v[2] += v[0] * swing[0] + v[1] * swing[1]
        across = (
            later[0, 0] * swing[0] ** 2
            + later[1, 1] * swing[1] ** 2
            + 2.0 * later[0, 1] * swing[0] * swing[1]
        )
        for i in range(m):
            more = later[i, 0] * swing[0] + later[i, 1] * swing[1]
            now[i, 2] += more
            now[2, i] += more
        # D = (A_y, -A_x), so -(λ·D) is the second derivative with respect to the heading.
        lx, ly = prices.lam[j + 1, 0], prices.lam[j + 1, 1]
        now[2, 2] += across - lx * swing[1] + ly * swing[0]
        for i in range(m):
            for p in range(m):
                now[i, p] -= (
                    mixed[0, i] * gain[p, 0] + mixed[1, i] * gain[p, 1] + mixed[2, i] * gain[p, 2]
                )
            v[i] -= mixed[0, i] * shift[0] + mixed[1, i] * shift[1] + mixed[2, i] * shift[2]
    return True


@kernel
def _move_start(model: Expansion, free: Floats, damp: float, step: Floats) -> bool:
    """Fill in the step of a free start to the minimum of the value function; False if none exists."""
    curve, tilt, block = model.curve[0], model.tilt[0], np.zeros((3, 3))
    closed = len(tilt) > 4
    for i in range(3):
        step[i] = -free[i] * (tilt[i] + (tilt[i + 4] if closed else 0.0))
        for p in range(3):
            value = curve[i, p]
            if closed:
                value += curve[i + 4, p] + curve[i, p + 4] + curve[i + 4, p + 4]
            block[i, p] = free[i] * free[p] * value
        block[i, i] += 1.0 - free[i] + damp + 1e-9
    if not _factor(block):
        return False
    _solve(block, step)
    return True


@kernel
def _forward(start: Floats, point: Point, legs: Legs, model: Expansion, change: Point) -> None:
    """Fill in the Newton step, beginning with that of the start."""
    dy, du, dt = change
    m = dy.shape[1]
    for i in range(3):
        dy[0, i] = start[i]
        if m > 4:
            dy[0, i + 4] = start[i]
    for j in range(len(du)):
        gain, shift, swing = model.gain[j], model.shift[j], model.swing[j]
        gap, slopes, now, later = model.gap[j], model.slopes[j], dy[j], dy[j + 1]
        for i in range(m):
            later[i] = now[i] + (gap[i] if i < 4 else 0.0)
        for k in range(3):
            rest = -shift[k]
            for i in range(m):
                rest -= gain[i, k] * now[i]
            du[j, k] = rest
            for i in range(4):
                later[i] += slopes[k, i] * rest
        later[0] += swing[0] * now[2]
        later[1] += swing[1] * now[2]
        if j < len(dt) and legs.radius[j] > 0.0:
            r, drift = legs.radius[j], legs.drift[j]
            ax, ay = offset(point.y, j, legs)
            ax, ay = ax / r, ay / r
            rest = 0.5 * (1.0 - ax * ax - ay * ay) - point.t[j]
            rest -= ax * (later[0] - drift[0] * later[3]) / r
            dt[j] = rest - ay * (later[1] - drift[1] * later[3]) / r


@kernel
def _costate(curve: Floats, tilt: Floats, dy: Floats, i: int) -> float:
    """Return entry `i` of the costate at the end of a leg after the step."""
    value: float = tilt[i]
    for p in range(len(dy)):
        value += curve[i, p] * dy[p]
    return value


@kernel
def _limit(
    point: Point, prices: Prices, legs: Legs, model: Expansion, change: Point, mu: float,
    weight: Floats,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Return the primal and dual shares, the step's size and the slope; fill in the weights of penalties.

    The shares keep variables positive and turns below 1 rad.
    """
    dy, du, dt = change
    all_u, all_z, bend, radius = point.u, prices.z, legs.bend, legs.radius
    curve, tilt = model.curve, model.tilt
    ahead, dual, size, slope = 1.0, 1.0, 0.0, dy[len(du), 3]
    weight[:] = 1.0
    for j in range(len(du)):
        for k in range(3):
            rest, u, z = du[j, k], all_u[j, k], all_z[j, k]
            if ahead * rest < -BOUNDARY * u:
                ahead = -BOUNDARY * u / rest
            turned = abs(rest * bend[j, k])
            size = max(size, turned if turned > 0.0 else abs(rest))
            if turned * ahead > 1.0:
                ahead = 1.0 / turned
            change_z = mu / u - z - z / u * rest
            if dual * change_z < -BOUNDARY * z:
                dual = -BOUNDARY * z / change_z
            slope -= mu * rest / u
        if abs(dy[j + 1, 2]) * ahead > 1.0:
            ahead = 1.0 / abs(dy[j + 1, 2])
        for i in range(4):
            costate = _costate(curve[j + 1], tilt[j + 1], dy[j + 1], i)
            weight[0] = max(weight[0], 1.5 * abs(costate))
        if j < len(dt) and radius[j] > 0.0:
            rest, t, nu = dt[j], point.t[j], prices.nu[j]
            if ahead * rest < -BOUNDARY * t:
                ahead = -BOUNDARY * t / rest
            change_nu = (mu - nu * (t + rest)) / t
            if dual * change_nu < -BOUNDARY * nu:
                dual = -BOUNDARY * nu / change_nu
            weight[1] = max(weight[1], 1.5 * (nu + max(change_nu, 0.0)))
            slope -= mu * rest / t
        else:
            for i in range(3 if j == len(dt) else 2):
                weight[2] = max(weight[2], 1.5 * abs(prices.price[j, i]))
    return ahead, dual, size, slope


@kernel
def _update_prices(
    point: Point, prices: Prices, legs: Legs, model: Expansion, change: Point, mu: float,
    ahead: float, dual: float,
) -> None:  # fmt: skip
    """Move the multipliers by the shares `ahead` and `dual` of their steps."""
    (y, u, t), (dy, du, dt), (lam, z, nu, price) = point, change, prices
    curve, tilt = model.curve, model.tilt
    for j in range(len(u)):
        for k in range(3):
            z[j, k] += dual * (mu / u[j, k] - z[j, k] - z[j, k] / u[j, k] * du[j, k])
        for i in range(4):
            costate = _costate(curve[j + 1], tilt[j + 1], dy[j + 1], i)
            lam[j + 1, i] += ahead * (costate - lam[j + 1, i])
        if j == len(t):
            for i in range(3):
                off = beyond_home(y, j, i, legs) + dy[j + 1, i] - dy[0, i]
                off -= 0.0 if i == 2 else legs.drift[j, i] * dy[j + 1, 3]
                price[j, i] += ahead * STIFF * off
        elif legs.radius[j] > 0.0:
            nu[j] += dual * (mu - nu[j] * (t[j] + dt[j])) / t[j]
        else:
            for i in range(2):
                drift = legs.drift[j, i]
                off = y[j + 1, i] - legs.place[j, i] - drift * y[j + 1, 3]
                price[j, i] += ahead * STIFF * (off + dy[j + 1, i] - drift * dy[j + 1, 3])


@kernel
def _begin(y: Floats, u: Floats, legs: Legs, lam: Floats, mu: float) -> tuple[Point, Prices]:
    """Return the initial point and multipliers; states, lengths and costates are not copied."""
    t, nu = np.ones(len(legs.place)), np.zeros(len(legs.place))
    for j in range(len(t)):
        if legs.radius[j] > 0.0:
            ax, ay = offset(y, j, legs)
            ax, ay = ax / legs.radius[j], ay / legs.radius[j]
            t[j] = max(0.5 * (1.0 - ax * ax - ay * ay), 1e-2)
            nu[j] = mu / t[j]
    return Point(y, u, t), Prices(lam, mu / u, nu, np.zeros((len(u), 3)))


@kernel(interpretable=True, in_place=True)
def improve(
    y: Floats, u: Floats, legs: Legs, lam: Floats, mu: float, most: int, tolerance: float
) -> int:
    """Move states and lengths to a local optimum; return the number of steps, or -1 on failure.

    Overwrites the states `y` (k + 1, 4), see :class:`.stages.Point`, the positive lengths `u` (k, 3)
    and the costates `lam` (k + 1, 4), the derivatives of the remaining cost by each state. `mu` is
    the initial barrier parameter, `most` the maximum number of steps and `tolerance` the largest
    final violation.
    """
    count, n = len(u), len(legs.place)
    m = 7 if count > n else 4
    model = Expansion(
        np.zeros((count, 3, 4)), np.zeros((count, 2)), np.zeros((count, 4)),
        np.zeros((count + 1, m, m)), np.zeros((count + 1, m)), np.zeros((count, m, 3)),
        np.zeros((count, 3)),
    )  # fmt: skip
    change = Point(np.zeros((count + 1, m)), np.zeros((count, 3)), np.zeros(n))
    trial = Point(np.zeros((count + 1, 4)), np.zeros((count, 3)), np.zeros(n))
    weight, start, by = np.ones(3), np.zeros(3), np.zeros((3, 4))
    point, prices = _begin(y, u, legs, lam, mu)
    damp, patient, past = 0.0, PATIENT, math.inf
    for step in range(most):
        _expand(point, legs, model)
        # Increase the damping until the step of each leg is unique.
        last, damp = damp, 0.0
        while not (
            _backward(point, prices, legs, model, mu, damp)
            and _move_start(model, legs.free, damp, start)
        ):
            damp = 8.0 * damp if damp > 0.0 else max(last / 3.0, 1e-7)
            if damp > 1e12:
                return -1
        damp = damp if damp > 0.0 else last / 3.0
        _forward(start, point, legs, model, change)
        ahead, dual, size, slope = _limit(point, prices, legs, model, change, mu, weight)
        before, off, _ = merit(point, legs, mu, weight, by)
        slope -= off
        # Line search on the merit function, with a tolerance for rounding. Near an optimum, full
        # steps that increase it once or twice reduce it more in the end than short steps.
        for _ in range(12):
            move(point, change, ahead, trial)
            after, _, left = merit(trial, legs, mu, weight, by)
            if after <= before + 1e-4 * ahead * min(slope, 0.0) + 1e-12 * abs(before):
                break
            if patient > 0 and left <= 1e-2:
                break
            ahead *= 0.5
        patient = PATIENT if after <= before + 1e-4 * ahead * min(slope, 0.0) else patient - 1
        _update_prices(point, prices, legs, model, change, mu, ahead, dual)
        move(point, change, ahead, point)
        # Rounding may keep the violation above the tolerance, and it then no longer decreases.
        stuck = left <= 1e-10 and left >= 0.5 * past
        past = left
        if mu <= LAST and size <= 1e-4 and (left <= tolerance or stuck):
            return step + 1
        if ahead > 0.3 and left <= max(1e2 * mu, tolerance):
            mu = max(LAST, min(FALL * mu, mu**1.3))
    return -1
