"""Kernels of ``minco``: spline by a banded solve, objective with an adjoint gradient.

Source: Wang, Zhou, Xu and Gao, "Geometrically constrained trajectory optimization for multicopters",
IEEE Transactions on Robotics 38(5), 2022: durations and knots as unknowns, the spline of minimum
effort between them, gradients by one adjoint solve. Here the spline is solved for the derivatives at
the knots, which gives a symmetric band of half-width 2 (r - 1) instead of the 2r coefficients per
segment.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .minco_limits import BALL, HULL, Multipliers, Task, penalise

__all__ = ["evaluate", "positions", "spline"]

Floats = NDArray[np.float64]


@kernel(shared=True)
def positions(task: Task, x: Floats, jets: Floats) -> None:
    """Write the positions of the nodes into ``jets[:, 0]``."""
    segments, dimensions = task.nodes.shape[0], task.centre.shape[1]
    for n in range(task.kind.size):
        begin, end = task.first[n], task.first[n + 1]
        total = 0.0
        for i in range(begin, end):
            total += x[segments + i] ** 2
        for axis in range(dimensions):
            value = task.centre[n, axis]
            for i in range(begin, end):
                at = x[segments + i]
                if task.kind[n] == BALL:
                    at *= 2.0 / (1.0 + total)
                elif task.kind[n] == HULL:
                    at = at * at / total
                value += at * task.reach[i, axis]
            jets[n, 0, axis] = value


@kernel
def _pull_back(task: Task, x: Floats, jets: Floats, slope: Floats) -> None:
    """Write the gradient by the unknowns of the knots, from that by the positions."""
    segments, dimensions = task.nodes.shape[0], task.centre.shape[1]
    for n in range(task.kind.size):
        begin, end = task.first[n], task.first[n + 1]
        total, along = 0.0, 0.0
        for i in range(begin, end):
            at, part = x[segments + i], 0.0
            for axis in range(dimensions):
                part += jets[n, 0, axis] * task.reach[i, axis]
            total += at * at
            along += part * (at * at if task.kind[n] == HULL else at)
            slope[segments + i] = part
        for i in range(begin, end):
            at, part = x[segments + i], slope[segments + i]
            if task.kind[n] == BALL:
                share = 2.0 / (1.0 + total)
                slope[segments + i] = share * (part - share * at * along)
            elif task.kind[n] == HULL:
                slope[segments + i] = 2.0 * at / total * (part - along / total)


@kernel
def _form(task: Task, duration: float, value: Floats, change: Floats) -> None:
    """Write the Hessian of half the effort of a segment, and its derivative times the duration."""
    wide = task.forms.shape[1]
    r = wide // 2
    value[:] = 0.0
    change[:] = 0.0
    for j in range(task.orders.size):
        power = 1.0 - 2.0 * task.orders[j]
        for a in range(wide):
            for side in range(2):
                factor = duration ** (power + a % r)
                for i in range(r):
                    entry = factor * task.forms[j, a, side * r + i]
                    value[a, side * r + i] += entry
                    change[a, side * r + i] += (power + a % r + i) * entry
                    factor *= duration


@kernel
def _factorise(band: Floats) -> bool:
    """Factorise a symmetric band in place (Cholesky), ``band[i, j] = A[i, i - j]``."""
    count, width = band.shape
    for i in range(count):
        for j in range(min(i, width - 1), -1, -1):
            total = band[i, j]
            for k in range(1, min(width - j, i - j + 1)):
                total -= band[i, j + k] * band[i - j, k]
            if j:
                band[i, j] = total / band[i - j, 0]
            else:
                if not total > 0.0:
                    return False
                band[i, 0] = np.sqrt(total)
    return True


@kernel
def _solve(band: Floats, right: Floats) -> None:
    count, width = band.shape
    for i in range(count):
        total = right[i]
        for j in range(1, min(width, i + 1)):
            total -= band[i, j] * right[i - j]
        right[i] = total / band[i, 0]
    for i in range(count - 1, -1, -1):
        total = right[i]
        for j in range(1, min(width, count - i)):
            total -= band[i + j, j] * right[i + j]
        right[i] = total / band[i, 0]


@kernel(shared=True)
def spline(
    task: Task, durations: Floats, jets: Floats, form: Floats, change: Floats, band: Floats
) -> bool:
    """Write the free derivatives of the nodes into `jets`, whose positions are given.

    `form` and `change`, shape (K, 2r, 2r), receive the quadratic forms of the segments, and `band`,
    shape (D, unknowns, width), the factors. Return whether the factorisation succeeded.
    """
    nodes, r, dimensions = jets.shape
    most = r - 1
    for k in range(durations.size):
        _form(task, durations[k], form[k], change[k])
    right = np.zeros(nodes * most)
    for axis in range(dimensions):
        band[axis] = 0.0
        right[:] = 0.0
        for n in range(nodes):
            for i in range(1, r):
                jets[n, i, axis] = task.jets[n, i, axis]
        for k in range(durations.size):
            for a in range(2 * r):
                i, n = a % r, task.nodes[k, a // r]
                if i == 0 or not task.free[n, i, axis]:
                    continue
                row = task.place[n] * most + i - 1
                for b in range(2 * r):
                    j, m = b % r, task.nodes[k, b // r]
                    if j == 0 or not task.free[m, j, axis]:
                        right[row] -= form[k, a, b] * jets[m, j, axis]
                    else:
                        column = task.place[m] * most + j - 1
                        if column <= row:
                            band[axis, row, row - column] += form[k, a, b]
        for n in range(nodes):
            for i in range(1, r):
                if not task.free[n, i, axis]:
                    row = task.place[n] * most + i - 1
                    band[axis, row, 0] = 1.0
                    right[row] = jets[n, i, axis]
        if not _factorise(band[axis]):
            return False
        _solve(band[axis], right)
        for n in range(nodes):
            for i in range(1, r):
                jets[n, i, axis] = right[task.place[n] * most + i - 1]
    return True


@kernel
def evaluate(task: Task, held: Multipliers, x: Floats, slope: Floats) -> float:
    """Return the augmented Lagrangian at the unknowns `x`, and write its gradient.

    `x` has the logarithms of the durations and the unknowns of the knots. The value is infinite if
    the spline cannot be computed.
    """
    segments = task.nodes.shape[0]
    nodes, r, dimensions = task.jets.shape
    most = r - 1
    durations = np.exp(x[:segments])
    jets = np.zeros((nodes, r, dimensions))
    positions(task, x, jets)
    form, change = np.zeros((segments, 2 * r, 2 * r)), np.zeros((segments, 2 * r, 2 * r))
    band = np.zeros((dimensions, nodes * most, (task.width + 1) * most))
    if not spline(task, durations, jets, form, change, band):
        return np.inf
    back, by_time = np.zeros((nodes, r, dimensions)), np.zeros(segments)
    value = penalise(task, held, durations, jets, back, by_time)
    # Multipliers of the conditions of the spline: form @ jets = 0 for the free derivatives.
    dual, right = np.zeros((nodes, r, dimensions)), np.zeros(nodes * most)
    for axis in range(dimensions):
        for n in range(nodes):
            for i in range(1, r):
                free = task.free[n, i, axis]
                right[task.place[n] * most + i - 1] = -back[n, i, axis] if free else 0.0
        _solve(band[axis], right)
        for n in range(nodes):
            for i in range(1, r):
                dual[n, i, axis] = right[task.place[n] * most + i - 1]
    effort = 0.0
    for k in range(segments):
        for axis in range(dimensions):
            for a in range(2 * r):
                node, i = task.nodes[k, a // r], a % r
                bent, moved, turned = 0.0, 0.0, 0.0
                for b in range(2 * r):
                    m, j = task.nodes[k, b // r], b % r
                    bent += form[k, a, b] * jets[m, j, axis]
                    moved += change[k, a, b] * jets[m, j, axis]
                    turned += form[k, a, b] * dual[m, j, axis]
                at = jets[node, i, axis]
                effort += at * bent
                share = held.effort * at + dual[node, i, axis]
                by_time[k] += moved * share / durations[k]
                if i == 0:
                    back[node, 0, axis] += 2.0 * held.effort * bent + turned
    value += held.effort * effort
    for k in range(segments):
        value += held.time * durations[k]
        slope[k] = (by_time[k] + held.time) * durations[k]
    _pull_back(task, x, back, slope)
    return value
