"""Fused kernels for the usual case: positions fixed, ends fixed, inner derivatives free.

The unknowns are the derivatives of order 1 … r-1 at the inner knots, and the Hessian is block
tridiagonal with blocks of r-1. One sweep forward assembles block row k, eliminates it (LDL', no
square roots) and reduces the right-hand sides of all axes at once; one sweep backward writes the
jets and, while they are at hand, sums up the objective and measures the jumps. Nothing but the
coupling ``upper`` is kept in between: reduced right-hand sides wait where the jets will stand. For
r = 4 the jumps are then the right-hand sides of the same two sweeps, until they are rounding.

Written out for r = 2, 3, 4, since blocks so small are quick only in registers. The numbers are those
of ``hermite.table_of`` (a test compares). The factors of powers of 1 / T are the units of the rows:
a Cholesky factor does not change its relative errors when rows and columns are scaled, so no local
time is divided out beforehand.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .hermite import REFINED

__all__ = ["accelerate", "is_usual", "jerk", "snap"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: How often the kernel for r = 4 solves: once, and again for what is left.
_ATTEMPTS = 4


@kernel(interpretable=True)
def is_usual(fixed: Bools, continuity: int) -> bool:
    """Return whether the fused kernels may be used: `fixed` has the shape (A, M + 1, r)."""
    axes, knots, order = fixed.shape
    if order < 2 or order > 4 or continuity != order - 1:
        return False
    for a in range(axes):
        for k in range(knots):
            end = k == 0 or k == knots - 1
            if not fixed[a, k, 0]:
                return False
            for i in range(1, order):
                if fixed[a, k, i] != end:
                    return False
    return True


@kernel(interpretable=True)
def snap(
    durations: Floats, values: Floats, jets: Floats, objective: Floats, upper: Floats, work: Floats
) -> tuple[float, int, int]:
    """Minimise ∫ (x'''')² dt: r = 4.

    Parameters
    ----------
    durations : ndarray, shape (M,)
        T_k.
    values : ndarray, shape (A, M + 1, 4)
        Positions at all knots, derivatives at the two ends.
    jets : ndarray, shape (A, M, 2, 4)
        Filled with the derivatives at the start and the end of each segment.
    objective : ndarray, shape (A,)
        Filled with J.
    upper : ndarray, shape (M, 9)
        Room for the coupling of each knot with the next one; (M, (r - 1)²) in general. Room is
        lent, since NumPy asks the system for large pages and compiled code does not.
    work : ndarray, shape (A, M, 3)
        Room for reduced right-hand sides; with other r, it is not used.

    Returns
    -------
    residual : float
        Worst jump of the derivatives 4, 5, 6 at inner knots, relative to the largest on the axis.
    failed : int
        The knot whose pivot is not positive, or -1.
    refinements : int
        Solves after the first one.
    """
    count, axes = durations.size, values.shape[0]
    upper[0] = 0.0
    # `work`: reduced right-hand sides on the way forward; jumps, the next ones, on the way back.
    # Of each axis: what the segment to the right says at its start (3), the largest jumps (3) and
    # the largest values (3), and the sum of the objective with what was rounded off (2).
    state, moved = np.empty((axes, 11)), np.empty((axes, 3))
    best = np.inf
    for attempt in range(_ATTEMPTS):
        first = attempt == 0
        for a in range(axes):
            for i in range(3):
                work[a, 0, i] = values[a, 0, i + 1] if first else 0.0
                moved[a, i] = values[a, count, i + 1] if first else 0.0
            if first:
                jets[a, 0, 0, 0] = values[a, 0, 0]
                for i in range(4):
                    jets[a, count - 1, 1, i] = values[a, count, i]
        h = 1.0 / durations[0]
        l1, l2 = h, h * h
        l3, l4 = l2 * h, l2 * l2
        l5, l6 = l4 * h, l4 * l2
        w11 = w12 = w13 = w21 = w22 = w23 = w31 = w32 = w33 = 0.0
        for k in range(1, count):
            # The coupling of the knot before with this one, in the segment to the left.
            f11, f12, f13 = 24480.0 * l5, -4680.0 * l4, 360.0 * l3
            f21, f22, f23 = 4680.0 * l4, -840.0 * l3, 60.0 * l2
            f31, f32, f33 = 360.0 * l3, -60.0 * l2, 4.0 * l1
            h = 1.0 / durations[k]
            r1, r2 = h, h * h
            r3, r4 = r2 * h, r2 * r2
            r5, r6 = r4 * h, r4 * r2
            d1 = 25920.0 * (l5 + r5) - (f11 * w11 + f21 * w21 + f31 * w31)
            s12 = 5400.0 * (r4 - l4) - (f11 * w12 + f21 * w22 + f31 * w32)
            s13 = 480.0 * (l3 + r3) - (f11 * w13 + f21 * w23 + f31 * w33)
            s22 = 1200.0 * (l3 + r3) - (f12 * w12 + f22 * w22 + f32 * w32)
            s23 = 120.0 * (r2 - l2) - (f12 * w13 + f22 * w23 + f32 * w33)
            s33 = 16.0 * (l1 + r1) - (f13 * w13 + f23 * w23 + f33 * w33)
            i1 = 1.0 / d1
            m21, m31 = s12 * i1, s13 * i1
            d2 = s22 - m21 * s12
            t = s23 - m31 * s12
            i2 = 1.0 / d2
            m32 = t * i2
            d3 = s33 - m31 * s13 - m32 * t
            i3 = 1.0 / d3
            if not (d1 > 0.0 and d2 > 0.0 and d3 > 0.0):
                return np.inf, k, 0
            for a in range(axes):
                z1, z2, z3 = work[a, k - 1, 0], work[a, k - 1, 1], work[a, k - 1, 2]
                now = work[a, k]
                if first:
                    here = values[a, k, 0]
                    left, right = here - values[a, k - 1, 0], values[a, k + 1, 0] - here
                    y1 = 50400.0 * (right * r6 + left * l6)
                    y2 = 10080.0 * (right * r5 - left * l5)
                    y3 = 840.0 * (right * r4 + left * l4)
                    jets[a, k, 0, 0] = jets[a, k - 1, 1, 0] = here
                else:
                    y1, y2, y3 = -now[0], -now[1], -now[2]
                y1 -= f11 * z1 + f21 * z2 + f31 * z3
                y2 -= f12 * z1 + f22 * z2 + f32 * z3 + m21 * y1
                y3 -= f13 * z1 + f23 * z2 + f33 * z3 + m31 * y1 + m32 * y2
                y3 *= i3
                y2 = y2 * i2 - m32 * y3
                now[0], now[1], now[2] = y1 * i1 - m21 * y2 - m31 * y3, y2, y3
            e1, e2, e3 = 24480.0 * r5, 4680.0 * r4, 360.0 * r3
            e2 -= m21 * e1
            w31 = (e3 - m31 * e1 - m32 * e2) * i3
            w21 = e2 * i2 - m32 * w31
            w11 = e1 * i1 - m21 * w21 - m31 * w31
            e1, e2, e3 = -4680.0 * r4, -840.0 * r3, -60.0 * r2
            e2 -= m21 * e1
            w32 = (e3 - m31 * e1 - m32 * e2) * i3
            w22 = e2 * i2 - m32 * w32
            w12 = e1 * i1 - m21 * w22 - m31 * w32
            e1, e2, e3 = 360.0 * r3, 60.0 * r2, 4.0 * r1
            e2 -= m21 * e1
            w33 = (e3 - m31 * e1 - m32 * e2) * i3
            w23 = e2 * i2 - m32 * w33
            w13 = e1 * i1 - m21 * w23 - m31 * w33
            row = upper[k]
            row[0], row[1], row[2] = w11, w12, w13
            row[3], row[4], row[5] = w21, w22, w23
            row[6], row[7], row[8] = w31, w32, w33
            l1, l2, l3, l4, l5, l6 = r1, r2, r3, r4, r5, r6

        state[:] = 0.0
        for k in range(count - 1, -1, -1):
            row = upper[k]
            long = durations[k]
            h = 1.0 / long
            long2 = long * long
            long3, h4 = long2 * long, h * h * h * h
            h5, h6, h7 = h4 * h, h4 * h * h, h4 * h * h * h
            for a in range(axes):
                now, end, own = jets[a, k, 0], jets[a, k, 1], state[a]
                u1, u2, u3 = moved[a, 0], moved[a, 1], moved[a, 2]
                v0 = work[a, k, 0] - (row[0] * u1 + row[1] * u2 + row[2] * u3)
                a0 = work[a, k, 1] - (row[3] * u1 + row[4] * u2 + row[5] * u3)
                j0 = work[a, k, 2] - (row[6] * u1 + row[7] * u2 + row[8] * u3)
                moved[a, 0], moved[a, 1], moved[a, 2] = v0, a0, j0
                if not first:
                    v0, a0, j0 = now[1] + v0, now[2] + a0, now[3] + j0
                now[1], now[2], now[3] = v0, a0, j0
                if k > 0:
                    last = jets[a, k - 1, 1]
                    last[1], last[2], last[3] = v0, a0, j0
                v1, a1, j1 = end[1], end[2], end[3]
                plus_v, minus_v = (v1 + v0) * long, (v1 - v0) * long
                plus_a, minus_a = (a1 + a0) * long2, (a1 - a0) * long2
                plus_j, minus_j = (j1 + j0) * long3, (j1 - j0) * long3
                g1 = plus_j - 2.0 * minus_a
                g2 = minus_j - 6.0 * plus_a + 12.0 * minus_v
                g3 = plus_j - 12.0 * minus_a + 60.0 * plus_v - 120.0 * (end[0] - now[0])
                q1, q2, q3 = 3.0 * g1, 5.0 * g2, 7.0 * g3
                _add(own, 9, (minus_j * minus_j + g1 * q1 + g2 * q2 + g3 * q3) * h7)
                # x'''', x''''' and x'''''' at both ends, as they stand in the gradient.
                if k < count - 1:
                    then = work[a, k + 1]
                    then[0] = _jump(own, 0, (12.0 * q2 + 60.0 * q3) * h6)
                    then[1] = _jump(own, 1, (-2.0 * q1 - 6.0 * q2 - 12.0 * q3) * h5)
                    then[2] = _jump(own, 2, (minus_j + q1 + q2 + q3) * h4)
                b1, b2, b3 = abs(q1), abs(q2), abs(q3)
                own[6] = max(own[6], max(12.0 * b2, 60.0 * b3) * h6)
                own[7] = max(own[7], max(2.0 * b1, max(6.0 * b2, 12.0 * b3)) * h5)
                own[8] = max(own[8], max(max(abs(minus_j), b1), max(b2, b3)) * h4)
                own[0] = (60.0 * q3 - 12.0 * q2) * h6
                own[1] = (2.0 * q1 - 6.0 * q2 + 12.0 * q3) * h5
                own[2] = (q1 - minus_j - q2 + q3) * h4
        worst = _close(state, 3, objective)
        if worst <= REFINED or not worst < 0.5 * best:
            return worst, -1, attempt
        best = worst
    return best, -1, _ATTEMPTS - 1


@kernel(interpretable=True)
def jerk(
    durations: Floats, values: Floats, jets: Floats, objective: Floats, upper: Floats, work: Floats
) -> tuple[float, int, int]:
    """Minimise ∫ (x''')² dt: r = 3; see :func:`snap`."""
    count, axes = durations.size, values.shape[0]
    upper[0] = 0.0
    for a in range(axes):
        for i in range(3):
            jets[a, 0, 0, i] = values[a, 0, i]
            jets[a, count - 1, 1, i] = values[a, count, i]
    h = 1.0 / durations[0]
    l1, l2 = h, h * h
    l3, l4 = l2 * h, l2 * l2
    w11 = w12 = w21 = w22 = 0.0
    for k in range(1, count):
        f11, f12 = 168.0 * l3, -24.0 * l2
        f21, f22 = 24.0 * l2, -3.0 * l1
        h = 1.0 / durations[k]
        r1, r2 = h, h * h
        r3, r4 = r2 * h, r2 * r2
        d1 = 192.0 * (l3 + r3) - (f11 * w11 + f21 * w21)
        s12 = 36.0 * (r2 - l2) - (f11 * w12 + f21 * w22)
        s22 = 9.0 * (l1 + r1) - (f12 * w12 + f22 * w22)
        i1 = 1.0 / d1
        m21 = s12 * i1
        d2 = s22 - m21 * s12
        i2 = 1.0 / d2
        if not (d1 > 0.0 and d2 > 0.0):
            return np.inf, k, 0
        for a in range(axes):
            before = jets[a, k - 1, 0]
            z1, z2 = before[1], before[2]
            here = values[a, k, 0]
            left, right = here - values[a, k - 1, 0], values[a, k + 1, 0] - here
            y1 = 360.0 * (right * r4 + left * l4) - (f11 * z1 + f21 * z2)
            y2 = 60.0 * (right * r3 - left * l3) - (f12 * z1 + f22 * z2)
            y2 = (y2 - m21 * y1) * i2
            now = jets[a, k, 0]
            now[0], now[1], now[2] = here, y1 * i1 - m21 * y2, y2
        w21 = (24.0 * r2 - m21 * (168.0 * r3)) * i2
        w11 = 168.0 * r3 * i1 - m21 * w21
        w22 = (-3.0 * r1 - m21 * (-24.0 * r2)) * i2
        w12 = -24.0 * r2 * i1 - m21 * w22
        row = upper[k]
        row[0], row[1], row[2], row[3] = w11, w12, w21, w22
        l1, l2, l3, l4 = r1, r2, r3, r4

    state = np.zeros((axes, 8))
    for k in range(count - 1, -1, -1):
        row = upper[k]
        long = durations[k]
        h = 1.0 / long
        long2, h3 = long * long, h * h * h
        h4, h5 = h3 * h, h3 * h * h
        for a in range(axes):
            now, end, own = jets[a, k, 0], jets[a, k, 1], state[a]
            v1, a1 = end[1], end[2]
            v0 = now[1] - (row[0] * v1 + row[1] * a1)
            a0 = now[2] - (row[2] * v1 + row[3] * a1)
            now[1], now[2] = v0, a0
            if k > 0:
                last = jets[a, k - 1, 1]
                last[0], last[1], last[2] = now[0], v0, a0
            plus_v, minus_v = (v1 + v0) * long, (v1 - v0) * long
            plus_a, minus_a = (a1 + a0) * long2, (a1 - a0) * long2
            g1 = plus_a - 2.0 * minus_v
            g2 = minus_a - 6.0 * plus_v + 12.0 * (end[0] - now[0])
            q1, q2 = 3.0 * g1, 5.0 * g2
            _add(own, 6, (minus_a * minus_a + g1 * q1 + g2 * q2) * h5)
            if k < count - 1:
                _jump(own, 0, (-2.0 * q1 - 6.0 * q2) * h4)
                _jump(own, 1, (minus_a + q1 + q2) * h3)
            own[4] = max(own[4], max(2.0 * abs(q1), 6.0 * abs(q2)) * h4)
            own[5] = max(own[5], max(abs(minus_a), max(abs(q1), abs(q2))) * h3)
            own[0] = (2.0 * q1 - 6.0 * q2) * h4
            own[1] = (q1 - minus_a - q2) * h3
    return _close(state, 2, objective), -1, 0


@kernel(interpretable=True)
def accelerate(
    durations: Floats, values: Floats, jets: Floats, objective: Floats, upper: Floats, work: Floats
) -> tuple[float, int, int]:
    """Minimise ∫ (x'')² dt: r = 2, the cubic spline; see :func:`snap`."""
    count, axes = durations.size, values.shape[0]
    upper[0] = 0.0
    for a in range(axes):
        for i in range(2):
            jets[a, 0, 0, i] = values[a, 0, i]
            jets[a, count - 1, 1, i] = values[a, count, i]
    left = 1.0 / durations[0]
    above = 0.0
    for k in range(1, count):
        right = 1.0 / durations[k]
        pivot = 4.0 * (left + right) - 2.0 * left * above
        if not pivot > 0.0:
            return np.inf, k, 0
        inverse = 1.0 / pivot
        for a in range(axes):
            here = values[a, k, 0]
            slope = (here - values[a, k - 1, 0]) * left * left
            slope += (values[a, k + 1, 0] - here) * right * right
            now = jets[a, k, 0]
            now[0] = here
            now[1] = (6.0 * slope - 2.0 * left * jets[a, k - 1, 0, 1]) * inverse
        above = 2.0 * right * inverse
        upper[k, 0] = above
        left = right

    state = np.zeros((axes, 5))
    for k in range(count - 1, -1, -1):
        long = durations[k]
        h = 1.0 / long
        for a in range(axes):
            now, end, own = jets[a, k, 0], jets[a, k, 1], state[a]
            v1 = end[1]
            v0 = now[1] - upper[k, 0] * v1
            now[1] = v0
            if k > 0:
                last = jets[a, k - 1, 1]
                last[0], last[1] = now[0], v0
            g0 = (v1 - v0) * long
            g1 = (v1 + v0) * long - 2.0 * (end[0] - now[0])
            _add(own, 3, (g0 * g0 + 3.0 * g1 * g1) * h * h * h)
            if k < count - 1:
                _jump(own, 0, (g0 + 3.0 * g1) * h * h)
            own[2] = max(own[2], max(abs(g0), 3.0 * abs(g1)) * h * h)
            own[0] = (3.0 * g1 - g0) * h * h
    return _close(state, 1, objective), -1, 0


@kernel
def _add(own: Floats, place: int, term: float) -> None:
    """Add without losing what is rounded off (Neumaier): J of a million segments is exact too."""
    total = own[place] + term
    if abs(own[place]) >= abs(term):
        own[place + 1] += (own[place] - total) + term
    else:
        own[place + 1] += (term - total) + own[place]
    own[place] = total


@kernel
def _jump(own: Floats, place: int, value: float) -> float:
    """Compare what the segment to the left says at its end with the one to the right."""
    free = (own.size - 2) // 3
    jump: float = value + own[place]
    own[free + place] = max(own[free + place], abs(jump))
    return jump


@kernel
def _close(state: Floats, free: int, objective: Floats) -> float:
    """Write the objective of every axis; return the worst jump."""
    worst = 0.0
    for a in range(state.shape[0]):
        objective[a] = state[a, 3 * free] + state[a, 3 * free + 1]
        for i in range(free):
            if state[a, 2 * free + i] > 0.0:
                worst = max(worst, state[a, free + i] / state[a, 2 * free + i])
    return worst
