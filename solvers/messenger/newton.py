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
from .stages import STIFF, ended, flight, merit, moved

__all__ = ["improve"]

Floats = NDArray[np.float64]

#: Final barrier parameter, relative to a leg's typical length, and its reduction factor.
LAST, FALL = 1e-9, 0.2
#: Fraction to the boundary of a step.
BOUNDARY = 0.995
#: Number of consecutive steps that may increase the merit function.
PATIENT = 3


@kernel
def factor(a: Floats, m: int) -> bool:
    """Overwrite the lower triangle of `a` (m, m) with its Cholesky factor; False if none exists."""
    for i in range(m):
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
def solved(a: Floats, m: int, b: Floats) -> None:
    """Overwrite `b` (m,) with the solution of the system with Cholesky factor `a`."""
    for i in range(m):
        for k in range(i):
            b[i] -= a[i, k] * b[k]
        b[i] /= a[i, i]
    for i in range(m - 1, -1, -1):
        for k in range(i + 1, m):
            b[i] -= a[k, i] * b[k]
        b[i] /= a[i, i]


@kernel
def backward(
    y: Floats, u: Floats, t: Floats, nu: Floats, z: Floats, lam: Floats, price: Floats, bend: Floats,
    place: Floats, drift: Floats, radius: Floats, turn: float, mu: float, damp: float,
    swing: Floats, ways: Floats, gap: Floats, curve: Floats, tilt: Floats, gain: Floats, shift: Floats,
) -> bool:  # fmt: skip
    """Fill in value functions (curve, tilt) and gains; return False if a leg's step is not unique."""
    legs, n, m = len(u), len(place), curve.shape[1]
    block, mixed, products, col = np.zeros((3, 3)), np.zeros((3, m)), np.zeros((3, m)), np.zeros(3)
    for i in range(m):
        tilt[legs, i] = 1.0 if i == 3 else 0.0
        for p in range(m):
            curve[legs, i, p] = 0.0
    for j in range(legs - 1, -1, -1):
        later, q = curve[j + 1], tilt[j + 1]
        at = min(j, n - 1)
        ended(y[j + 1], y[0], j, n, place[at], drift[at], radius[at], turn, t[at], nu[at],
              price[j], mu, later, q)  # fmt: skip
        lx, ly = lam[j + 1, 0], lam[j + 1, 1]
        for i in range(m):
            # Product of the later Hessian with the slopes of each primitive.
            for k in range(3):
                products[k, i] = (
                    later[i, 0] * ways[j, k, 0]
                    + later[i, 1] * ways[j, k, 1]
                    + later[i, 2] * bend[j, k]
                    + later[i, 3]
                )
        for k in range(3):
            total = 0.0
            for i in range(4):
                slope = ways[j, k, i] if i < 2 else bend[j, k] if i == 2 else 1.0
                for p in range(4):
                    total += slope * later[i, p] * gap[j, p]
                total += slope * q[i]
            col[k] = total - mu / u[j, k]
            for p in range(k, 3):
                value = (
                    products[k, 0] * ways[j, p, 0]
                    + products[k, 1] * ways[j, p, 1]
                    + products[k, 2] * bend[j, p]
                    + products[k, 3]
                )
                turned = ly * ways[j, p, 0] - lx * ways[j, p, 1]
                block[p, k] = value + bend[j, k] * turned
            block[k, k] += z[j, k] / u[j, k] + damp * (1.0 + bend[j, k] ** 2)
            for i in range(m):
                mixed[k, i] = products[k, i]
            mixed[k, 2] += products[k, 0] * swing[j, 0] + products[k, 1] * swing[j, 1]
            mixed[k, 2] += ly * ways[j, k, 0] - lx * ways[j, k, 1]
        if not factor(block, 3):
            return False
        for i in range(m):
            for k in range(3):
                gain[j, i, k] = mixed[k, i]
            solved(block, 3, gain[j, i])
        for k in range(3):
            shift[j, k] = col[k]
        solved(block, 3, shift[j])
        # Value function at the start of the leg.
        now, v = curve[j], tilt[j]
        for i in range(m):
            v[i] = q[i]
            for p in range(m):
                now[i, p] = later[i, p]
            for p in range(4):
                v[i] += later[i, p] * gap[j, p]
        across = (
            later[0, 0] * swing[j, 0] ** 2
            + later[1, 1] * swing[j, 1] ** 2
            + 2.0 * later[0, 1] * swing[j, 0] * swing[j, 1]
        )
        v[2] += v[0] * swing[j, 0] + v[1] * swing[j, 1]
        for i in range(m):
            more = later[i, 0] * swing[j, 0] + later[i, 1] * swing[j, 1]
            now[i, 2] += more
            now[2, i] += more
        # D = (A_y, -A_x), so -(λ·D) is the second derivative with respect to the heading.
        now[2, 2] += across - lx * swing[j, 1] + ly * swing[j, 0]
        for i in range(m):
            for p in range(m):
                now[i, p] -= (
                    mixed[0, i] * gain[j, p, 0]
                    + mixed[1, i] * gain[j, p, 1]
                    + mixed[2, i] * gain[j, p, 2]
                )
            v[i] -= (
                mixed[0, i] * shift[j, 0] + mixed[1, i] * shift[j, 1] + mixed[2, i] * shift[j, 2]
            )
    return True


@kernel
def improve(
    y: Floats, u: Floats, bend: Floats, place: Floats, drift: Floats, radius: Floats,
    turn: float, free: Floats, lam: Floats, mu: float, most: int, tolerance: float,
) -> int:  # fmt: skip
    """Move states and lengths to a local optimum; return the number of steps, or -1 on failure.

    Parameters
    ----------
    y : ndarray, shape (k + 1, 4)
        x, y, heading and length flown at the start and at the end of each of the k legs;
        overwritten.
    u : ndarray, shape (k, 3)
        Lengths, positive; overwritten.
    bend : ndarray, shape (k, 3)
        Signed curvature of each primitive.
    place, drift : ndarray, shape (n, 2)
        Position of vehicle j after a flight of length s: ``place[j] + drift[j] s``. A leg after the
        last vehicle leads back to the start.
    radius : ndarray, shape (n,)
        Largest distance at each encounter, at least 0.
    turn : float
        Total turning angle of a closed tour, in rad.
    free : ndarray, shape (3,)
        1 if the x, y or heading of the start is free, otherwise 0.
    lam : ndarray, shape (k + 1, 4)
        Costates: derivative of the remaining cost with respect to each state; overwritten.
    mu : float
        Initial barrier parameter.
    most : int
        Maximum number of steps.
    tolerance : float
        Largest final violation, in the unit of the data, which must be about a leg's length.
    """
    legs, n = len(u), len(place)
    m = 7 if legs > n else 4
    curve, tilt = np.zeros((legs + 1, m, m)), np.zeros((legs + 1, m))
    gain, shift = np.zeros((legs, m, 3)), np.zeros((legs, 3))
    swing, ways, gap = np.zeros((legs, 2)), np.zeros((legs, 3, 2)), np.zeros((legs, 4))
    price = np.zeros((legs, 3))
    dy, du, dt = np.zeros((legs + 1, m)), np.zeros((legs, 3)), np.zeros(n)
    t, nu, z = np.ones(n), np.zeros(n), np.zeros((legs, 3))
    block, col, by = np.zeros((3, 3)), np.zeros(3), np.zeros((3, 2))
    trial_y, trial_u, trial_t = np.zeros((legs + 1, 4)), np.zeros((legs, 3)), np.zeros(n)
    weight = np.ones(3)
    for j in range(n):
        if radius[j] > 0.0:
            ax = (y[j + 1, 0] - place[j, 0] - drift[j, 0] * y[j + 1, 3]) / radius[j]
            ay = (y[j + 1, 1] - place[j, 1] - drift[j, 1] * y[j + 1, 3]) / radius[j]
            t[j] = max(0.5 * (1.0 - ax * ax - ay * ay), 1e-2)
            nu[j] = mu / t[j]
    for j in range(legs):
        for k in range(3):
            z[j, k] = mu / u[j, k]
    damp, patient, past = 0.0, PATIENT, math.inf
    for step in range(most):
        for j in range(legs):
            dx, d_y, da = flight(y[j, 2], u[j], bend[j], ways[j])
            swing[j, 0], swing[j, 1] = -d_y, dx
            gap[j, 0], gap[j, 1] = y[j, 0] + dx - y[j + 1, 0], y[j, 1] + d_y - y[j + 1, 1]
            gap[j, 2] = y[j, 2] + da - y[j + 1, 2]
            gap[j, 3] = y[j, 3] + u[j, 0] + u[j, 1] + u[j, 2] - y[j + 1, 3]
        # Backward pass: increase the damping until the step of each leg is unique.
        last, damp = damp, 0.0
        while True:
            fine = backward(
                y, u, t, nu, z, lam, price, bend, place, drift, radius, turn, mu, damp, swing, ways, gap,
                curve, tilt, gain, shift,
            )  # fmt: skip
            if fine:
                # A free start moves to the minimum of the value function.
                for i in range(3):
                    col[i] = -free[i] * (tilt[0, i] + (tilt[0, i + 4] if m > 4 else 0.0))
                    for p in range(3):
                        value = curve[0, i, p]
                        if m > 4:
                            value += (
                                curve[0, i + 4, p] + curve[0, i, p + 4] + curve[0, i + 4, p + 4]
                            )
                        block[i, p] = free[i] * free[p] * value
                    block[i, i] += 1.0 - free[i] + damp + 1e-9
                fine = factor(block, 3)
            if fine:
                solved(block, 3, col)
                break
            damp = 8.0 * damp if damp > 0.0 else max(last / 3.0, 1e-7)
            if damp > 1e12:
                return -1
        damp = damp if damp > 0.0 else last / 3.0
        # Forward pass: the step, and its largest share that keeps variables positive.
        for i in range(3):
            dy[0, i] = col[i]
            if m > 4:
                dy[0, i + 4] = col[i]
        ahead, dual, size, slope = 1.0, 1.0, 0.0, 0.0
        weight[0] = weight[1] = weight[2] = 1.0
        for j in range(legs):
            for k in range(3):
                rest = -shift[j, k]
                for i in range(m):
                    rest -= gain[j, i, k] * dy[j, i]
                du[j, k] = rest
                if ahead * rest < -BOUNDARY * u[j, k]:
                    ahead = -BOUNDARY * u[j, k] / rest
                turned = abs(rest * bend[j, k])
                size = max(
                    size, abs(rest) if bend[j, k] == 0.0 else min(turned, abs(rest) + turned)
                )
                if turned * ahead > 1.0:
                    ahead = 1.0 / turned
                change = mu / u[j, k] - z[j, k] - z[j, k] / u[j, k] * rest
                if dual * change < -BOUNDARY * z[j, k]:
                    dual = -BOUNDARY * z[j, k] / change
                slope -= mu * rest / u[j, k]
            for i in range(m):
                dy[j + 1, i] = dy[j, i] + (gap[j, i] if i < 4 else 0.0)
            for k in range(3):
                dy[j + 1, 0] += ways[j, k, 0] * du[j, k]
                dy[j + 1, 1] += ways[j, k, 1] * du[j, k]
                dy[j + 1, 2] += bend[j, k] * du[j, k]
                dy[j + 1, 3] += du[j, k]
            dy[j + 1, 0] += swing[j, 0] * dy[j, 2]
            dy[j + 1, 1] += swing[j, 1] * dy[j, 2]
            if abs(dy[j + 1, 2]) * ahead > 1.0:
                ahead = 1.0 / abs(dy[j + 1, 2])
            for i in range(4):
                value = tilt[j + 1, i]
                for p in range(m):
                    value += curve[j + 1, i, p] * dy[j + 1, p]
                weight[0] = max(weight[0], 1.5 * abs(value))
            if j < n and radius[j] > 0.0:
                r = radius[j]
                ax = (y[j + 1, 0] - place[j, 0] - drift[j, 0] * y[j + 1, 3]) / r
                ay = (y[j + 1, 1] - place[j, 1] - drift[j, 1] * y[j + 1, 3]) / r
                rest = 0.5 * (1.0 - ax * ax - ay * ay) - t[j]
                rest -= ax * (dy[j + 1, 0] - drift[j, 0] * dy[j + 1, 3]) / r
                rest -= ay * (dy[j + 1, 1] - drift[j, 1] * dy[j + 1, 3]) / r
                dt[j] = rest
                if ahead * rest < -BOUNDARY * t[j]:
                    ahead = -BOUNDARY * t[j] / rest
                change = (mu - nu[j] * (t[j] + rest)) / t[j]
                if dual * change < -BOUNDARY * nu[j]:
                    dual = -BOUNDARY * nu[j] / change
                weight[1] = max(weight[1], 1.5 * (nu[j] + max(change, 0.0)))
                slope -= mu * rest / t[j]
            else:
                for i in range(3 if j == n else 2):
                    weight[2] = max(weight[2], 1.5 * abs(price[j, i]))
        slope += dy[legs, 3]
        before, off, _ = merit(y, u, t, bend, place, drift, radius, turn, mu, weight, by)
        slope -= off
        # Line search on the merit function, with a tolerance for rounding. Near an optimum, full
        # steps that increase it once or twice reduce it more in the end than short steps.
        for _ in range(12):
            moved(y, u, t, dy, du, dt, ahead, trial_y, trial_u, trial_t)
            after, _, left = merit(
                trial_y, trial_u, trial_t, bend, place, drift, radius, turn, mu, weight, by
            )
            if after <= before + 1e-4 * ahead * min(slope, 0.0) + 1e-12 * abs(before):
                break
            if patient > 0 and left <= 1e-2:
                break
            ahead *= 0.5
        patient = PATIENT if after <= before + 1e-4 * ahead * min(slope, 0.0) else patient - 1
        for j in range(legs):
            for k in range(3):
                z[j, k] += dual * (mu / u[j, k] - z[j, k] - z[j, k] / u[j, k] * du[j, k])
            for i in range(4):
                value = tilt[j + 1, i]
                for p in range(m):
                    value += curve[j + 1, i, p] * dy[j + 1, p]
                lam[j + 1, i] += ahead * (value - lam[j + 1, i])
            if j == n:
                for i in range(3):
                    off = y[j + 1, i] - y[0, i] - (turn if i == 2 else 0.0)
                    price[j, i] += ahead * STIFF * (off + dy[j + 1, i] - dy[0, i])
            elif radius[j] > 0.0:
                nu[j] += dual * (mu - nu[j] * (t[j] + dt[j])) / t[j]
            else:
                for i in range(2):
                    off = y[j + 1, i] - place[j, i] - drift[j, i] * y[j + 1, 3]
                    price[j, i] += ahead * STIFF * (off + dy[j + 1, i] - drift[j, i] * dy[j + 1, 3])
        moved(y, u, t, dy, du, dt, ahead, y, u, t)
        # Rounding may keep the violation above the tolerance, and it then no longer decreases.
        stuck = left <= 1e-10 and left >= 0.5 * past
        past = left
        if mu <= LAST and size <= 1e-4 and (left <= tolerance or stuck):
            return step + 1
        if ahead > 0.3 and left <= max(1e2 * mu, tolerance):
            mu = max(LAST, min(FALL * mu, mu**1.3))
    return -1
