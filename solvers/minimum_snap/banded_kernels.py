"""Fused kernels for the usual case: positions fixed, ends fixed, inner derivatives free.

The unknowns are the derivatives of order 1 … r-1 at the inner knots, and the Hessian is block
tridiagonal with blocks of r-1. One sweep forward assembles block row k, eliminates it (LDL', no
square roots) and reduces the right-hand sides of all axes at once. One sweep backward writes the
jets and sums up the objective. Between the sweeps, only the coupling ``upper`` is stored: the
reduced right-hand sides use the memory of the jets. The kernels do not refine. They are for
durations that are similar to their neighbours' (:func:`is_calm`).

The kernels are unrolled for r = 2, 3, 4, because such small blocks are fast only in registers. The
numbers are those of ``hermite.table_of`` (a test compares them). The factors of powers of 1 / T are
the units of the rows. Scaling rows and columns does not change the relative errors of a Cholesky
factor, so local times are not divided out beforehand.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["accelerate", "add", "is_calm", "is_usual", "jerk", "snap"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@kernel(interpretable=True)
def is_usual(fixed: Bools, continuity: int) -> bool:
    """Return whether only positions and the two ends are fixed; `fixed` has shape (A, M + 1, r)."""
    axes, knots, order = fixed.shape
    if continuity != order - 1:
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
def is_calm(durations: Floats, ratio: float) -> bool:
    """Return whether no duration is more than `ratio` times that of a neighbour."""
    for k in range(1, durations.size):
        before, after = durations[k - 1], durations[k]
        if not (before <= ratio * after and after <= ratio * before):
            return False
    return True


@kernel(interpretable=True)
def snap(durations: Floats, values: Floats, jets: Floats, objective: Floats, upper: Floats) -> int:
    """Minimise ∫ (x'''')² dt: r = 4.

    Parameters
    ----------
    durations : ndarray, shape (M,)
        T_k, s.
    values : ndarray, shape (A, M + 1, 4)
        Positions at all knots, derivatives at the two ends.
    jets : ndarray, shape (A, M, 2, 4)
        Filled with the derivatives at the start and the end of each segment.
    objective : ndarray, shape (A,)
        Filled with J.
    upper : ndarray, shape (M, 9)
        Workspace for the coupling of each knot with the next one; (M, (r - 1)²) in general. The
        caller allocates it, because NumPy uses large memory pages and compiled code does not.

    Returns
    -------
    failed : int
        Index of the knot whose pivot is not positive, or -1.
    """
    count, axes = durations.size, values.shape[0]
    upper[0] = 0.0
    for a in range(axes):
        for i in range(4):
            jets[a, 0, 0, i] = values[a, 0, i]
            jets[a, count - 1, 1, i] = values[a, count, i]
    h = 1.0 / durations[0]
    l1, l2 = h, h * h
    l3, l4 = l2 * h, l2 * l2
    l5, l6 = l4 * h, l4 * l2
    w11 = w12 = w13 = w21 = w22 = w23 = w31 = w32 = w33 = 0.0
    for k in range(1, count):
        # Coupling of the previous knot with this one, from the segment to the left.
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
            return k
        for a in range(axes):
            then, now = jets[a, k - 1, 0], jets[a, k, 0]
            z1, z2, z3 = then[1], then[2], then[3]
            here = values[a, k, 0]
            left, right = here - values[a, k - 1, 0], values[a, k + 1, 0] - here
            y1 = 50400.0 * (right * r6 + left * l6)
            y2 = 10080.0 * (right * r5 - left * l5)
            y3 = 840.0 * (right * r4 + left * l4)
            y1 -= f11 * z1 + f21 * z2 + f31 * z3
            y2 -= f12 * z1 + f22 * z2 + f32 * z3 + m21 * y1
            y3 -= f13 * z1 + f23 * z2 + f33 * z3 + m31 * y1 + m32 * y2
            y3 *= i3
            y2 = y2 * i2 - m32 * y3
            now[0], now[1] = here, y1 * i1 - m21 * y2 - m31 * y3
            now[2], now[3] = y2, y3
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

    sums = np.zeros((axes, 2))
    for k in range(count - 1, -1, -1):
        row = upper[k]
        long = durations[k]
        h = 1.0 / long
        long2 = long * long
        long3, h3 = long2 * long, h * h * h
        h7 = h3 * h3 * h
        for a in range(axes):
            now, end = jets[a, k, 0], jets[a, k, 1]
            v1, a1, j1 = end[1], end[2], end[3]
            v0 = now[1] - (row[0] * v1 + row[1] * a1 + row[2] * j1)
            a0 = now[2] - (row[3] * v1 + row[4] * a1 + row[5] * j1)
            j0 = now[3] - (row[6] * v1 + row[7] * a1 + row[8] * j1)
            now[1], now[2], now[3] = v0, a0, j0
            if k > 0:
                last = jets[a, k - 1, 1]
                last[0], last[1], last[2], last[3] = now[0], v0, a0, j0
            plus_v, minus_v = (v1 + v0) * long, (v1 - v0) * long
            plus_a, minus_a = (a1 + a0) * long2, (a1 - a0) * long2
            plus_j, minus_j = (j1 + j0) * long3, (j1 - j0) * long3
            g1 = plus_j - 2.0 * minus_a
            g2 = minus_j - 6.0 * plus_a + 12.0 * minus_v
            g3 = plus_j - 12.0 * minus_a + 60.0 * plus_v - 120.0 * (end[0] - now[0])
            q1, q2, q3 = 3.0 * g1, 5.0 * g2, 7.0 * g3
            add(sums[a], (minus_j * minus_j + g1 * q1 + g2 * q2 + g3 * q3) * h7)
    objective[:] = sums[:, 0] + sums[:, 1]
    return -1


@kernel(interpretable=True)
def jerk(durations: Floats, values: Floats, jets: Floats, objective: Floats, upper: Floats) -> int:
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
            return k
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

    sums = np.zeros((axes, 2))
    for k in range(count - 1, -1, -1):
        row = upper[k]
        long = durations[k]
        h = 1.0 / long
        long2, h5 = long * long, h * h * h * h * h
        for a in range(axes):
            now, end = jets[a, k, 0], jets[a, k, 1]
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
            add(sums[a], (minus_a * minus_a + g1 * q1 + g2 * q2) * h5)
    objective[:] = sums[:, 0] + sums[:, 1]
    return -1


@kernel(interpretable=True)
def accelerate(
    durations: Floats, values: Floats, jets: Floats, objective: Floats, upper: Floats
) -> int:
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
            return k
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

    sums = np.zeros((axes, 2))
    for k in range(count - 1, -1, -1):
        long = durations[k]
        h = 1.0 / long
        for a in range(axes):
            now, end = jets[a, k, 0], jets[a, k, 1]
            v1 = end[1]
            v0 = now[1] - upper[k, 0] * v1
            now[1] = v0
            if k > 0:
                last = jets[a, k - 1, 1]
                last[0], last[1] = now[0], v0
            g0 = (v1 - v0) * long
            g1 = (v1 + v0) * long - 2.0 * (end[0] - now[0])
            add(sums[a], (g0 * g0 + 3.0 * g1 * g1) * h * h * h)
    objective[:] = sums[:, 0] + sums[:, 1]
    return -1


@kernel
def add(own: Floats, term: float) -> None:
    """Add with compensated rounding errors (Neumaier), so that J of a million segments is exact."""
    total = own[0] + term
    if abs(own[0]) >= abs(term):
        own[1] += (own[0] - total) + term
    else:
        own[1] += (term - total) + own[0]
    own[0] = total
