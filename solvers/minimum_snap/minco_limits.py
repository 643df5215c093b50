"""Kernels of ``minco``: limits of vehicles and polytopes at instants, and their penalties.

The limits are kept by the augmented Lagrangian of Powell, Hestenes and Rockafellar (Nocedal and
Wright, "Numerical Optimization", section 17.4), with one multiplier per limit and instant.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["QUANTITIES", "Multipliers", "Task", "measure", "penalise"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

#: Limited quantities of a vehicle, in the order of their columns.
QUANTITIES = ("speed", "acceleration", "thrust above", "thrust below", "tilt", "body rate")
#: Kinds of knots: an affine set, a ball, a convex hull.
AFFINE, BALL, HULL = 0, 1, 2


class Task(NamedTuple):
    """Problem in arrays: K segments, N nodes, r derivatives per node, D axes, R rows, Q instants."""

    #: Derivatives 0 … 3 of the Hermite functions in s at the instants, shape (4, Q, 2r).
    basis: Floats
    #: Quadratic forms of the effort on [0, 1], shape (J, 2r, 2r), and their orders, shape (J,).
    forms: Floats
    orders: Ints
    #: Node at the start and at the end of each segment, shape (K, 2). A lap returns to node 0.
    nodes: Ints
    #: Place of each node in the band, shape (N,), and half-width of the band in blocks.
    place: Ints
    width: int
    #: Fixed derivatives, shape (N, r, D), and mask of the free ones of order 1 and above.
    jets: Floats
    free: Flags
    #: Kind of each knot, shape (N,), first unknown of each, shape (N + 1,), and point, shape (N, D).
    kind: Ints
    first: Ints
    centre: Floats
    #: Effect of each unknown of the knots on the position, m, shape (unknowns, D).
    reach: Floats
    #: Linear rows, sorted by segment: ``normal @ x^(order) <= offset``, in units of `size`.
    start: Ints
    order: Ints
    normal: Floats
    offset: Floats
    size: Floats
    #: Gravity, drag per mass, speed², acceleration², high², low², cos(tilt), rate², 1 with a thrust;
    #: inf, or 0 and -1 for low² and cos(tilt), is unlimited.
    limits: Floats


class Multipliers(NamedTuple):
    """Scaled multipliers of the limits and of the rows, and the weights of the objective."""

    #: Shape (K, Q, 6).
    vehicle: Floats
    #: Shape (R, Q).
    rows: Floats
    #: Weight of an instant of each segment, shape (K,).
    weight: Floats
    #: Weights of the total time and of the effort.
    time: float
    effort: float


@kernel
def _excess(limits: Floats, x: Floats, excess: Floats) -> None:
    """Write the relative excess of each limit, -1 for absent ones; `x`, shape (4, D): derivatives."""
    dimensions = x.shape[1]
    excess[:] = -1.0
    for column in range(2):
        if limits[2 + column] < np.inf:
            total = 0.0
            for axis in range(dimensions):
                total += x[1 + column, axis] ** 2
            excess[column] = total / limits[2 + column] - 1.0
    if limits[8] == 0.0:
        return
    square, cross, turn, spin, _, up = _forces(limits, x)
    high, low, cosine, fast = limits[4], limits[5], limits[6], limits[7]
    if high < np.inf:
        excess[2] = square / high - 1.0
    if low > 0.0:
        excess[3] = 1.0 - square / low
    if cosine > -1.0:
        excess[4] = (cosine * np.sqrt(square) - up) / limits[0]
    # |f x f'|² / |f|⁴ = |f'|² / |f|² - (f f')² / |f|⁴, and the square of the rate about the thrust
    if fast < np.inf:
        excess[5] = (turn / square - (cross / square) ** 2 + spin * spin) / fast - 1.0


@kernel
def _forces(limits: Floats, x: Floats) -> tuple[float, float, float, float, float, float]:
    """Return |f|², f f', |f'|², the rate about the thrust, its denominator, and the vertical force.

    f is the thrust per mass. Without yaw, the rate is (f₁ f'₀ - f₀ f'₁) / (|f| (|f| + f₂)) (Hopf
    fibration).
    """
    gravity, drag = limits[0], limits[1]
    up = x[2, 2] + drag * x[1, 2] + gravity
    square, cross, turn = 0.0, 0.0, 0.0
    for axis in range(3):
        force = x[2, axis] + drag * x[1, axis] if axis < 2 else up
        rate = x[3, axis] + drag * x[2, axis]
        square += force * force
        cross += force * rate
        turn += rate * rate
    least = 1e-12 * gravity * gravity
    square = max(square, least)
    lever = max(square + np.sqrt(square) * up, least)
    spin = (x[2, 1] + drag * x[1, 1]) * (x[3, 0] + drag * x[2, 0])
    spin -= (x[2, 0] + drag * x[1, 0]) * (x[3, 1] + drag * x[2, 1])
    return square, cross, turn, spin / lever, lever, up


@kernel
def _pull(limits: Floats, x: Floats, share: Floats, pull: Floats) -> None:
    """Add the gradients of the excesses times `share`, shape (6,), to `pull`, shape (4, D)."""
    dimensions = x.shape[1]
    for column in range(2):
        if share[column] > 0.0:
            for axis in range(dimensions):
                change = 2.0 * x[1 + column, axis] / limits[2 + column]
                pull[1 + column, axis] += share[column] * change
    if not (share[2] > 0.0 or share[3] > 0.0 or share[4] > 0.0 or share[5] > 0.0):
        return
    gravity, drag, fast = limits[0], limits[1], limits[7]
    square, cross, turn, spin, lever, up = _forces(limits, x)
    size = np.sqrt(square)
    # Derivative by f: along f, along f', and along the vertical. Derivative by f': along f', along f.
    along, across, rise, rate_along, rate_across, twist = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if share[2] > 0.0:
        along += share[2] * 2.0 / limits[4]
    if share[3] > 0.0:
        along -= share[3] * 2.0 / limits[5]
    if share[4] > 0.0:
        along += share[4] * limits[6] / (size * gravity)
        rise -= share[4] / gravity
    if share[5] > 0.0:
        factor = share[5] / (square * fast)
        along += factor * (4.0 * (cross / square) ** 2 - 2.0 * turn / square)
        across -= factor * 2.0 * cross / square
        rate_along += factor * 2.0
        rate_across -= factor * 2.0 * cross / square
        twist = share[5] * 2.0 * spin / (lever * fast)
        along -= twist * spin * (2.0 + up / size)
        rise -= twist * spin * size
    for axis in range(3):
        force = x[2, axis] + drag * x[1, axis] if axis < 2 else up
        rate = x[3, axis] + drag * x[2, axis]
        by_force = along * force + across * rate
        by_rate = rate_along * rate + rate_across * force
        if axis == 0:
            by_force -= twist * (x[3, 1] + drag * x[2, 1])
            by_rate += twist * (x[2, 1] + drag * x[1, 1])
        elif axis == 1:
            by_force += twist * (x[3, 0] + drag * x[2, 0])
            by_rate -= twist * (x[2, 0] + drag * x[1, 0])
        else:
            by_force += rise
        pull[1, axis] += drag * by_force
        pull[2, axis] += by_force + drag * by_rate
        pull[3, axis] += by_rate


@kernel
def _derivatives(basis: Floats, q: int, duration: float, local: Floats, x: Floats) -> None:
    """Write the derivatives 0 … 3 in time at instant `q`, shape (4, D); `local` has T^i d_i."""
    factor = 1.0
    for j in range(4):
        for axis in range(local.shape[1]):
            total = 0.0
            for a in range(local.shape[0]):
                total += basis[j, q, a] * local[a, axis]
            x[j, axis] = total * factor
        factor /= duration


@kernel
def _scaled(task: Task, k: int, duration: float, jets: Floats, local: Floats) -> None:
    r = jets.shape[1]
    for side in range(2):
        factor = 1.0
        for i in range(r):
            for axis in range(jets.shape[2]):
                local[side * r + i, axis] = factor * jets[task.nodes[k, side], i, axis]
            factor *= duration


@kernel
def measure(task: Task, durations: Floats, jets: Floats, vehicle: Floats, rows: Floats) -> None:
    """Write the relative excesses of the limits, shape (K, Q, 6), and of the rows, shape (R, Q)."""
    r, dimensions = jets.shape[1], jets.shape[2]
    local, x = np.zeros((2 * r, dimensions)), np.zeros((4, dimensions))
    for k in range(durations.size):
        _scaled(task, k, durations[k], jets, local)
        for q in range(task.basis.shape[1]):
            _derivatives(task.basis, q, durations[k], local, x)
            _excess(task.limits, x, vehicle[k, q])
            for row in range(task.start[k], task.start[k + 1]):
                total = -task.offset[row]
                for axis in range(dimensions):
                    total += task.normal[row, axis] * x[task.order[row], axis]
                rows[row, q] = total / task.size[row]


@kernel
def penalise(
    task: Task, held: Multipliers, durations: Floats, jets: Floats, back: Floats, by_time: Floats
) -> float:
    """Return the penalty; add its gradients by the jets and by the durations."""
    r, dimensions = jets.shape[1], jets.shape[2]
    local, force = np.zeros((2 * r, dimensions)), np.zeros((2 * r, dimensions))
    x, pull = np.zeros((4, dimensions)), np.zeros((4, dimensions))
    excess, share = np.zeros(6), np.zeros(6)
    value = 0.0
    for k in range(durations.size):
        duration, weight = durations[k], held.weight[k]
        _scaled(task, k, duration, jets, local)
        force[:] = 0.0
        for q in range(task.basis.shape[1]):
            _derivatives(task.basis, q, duration, local, x)
            _excess(task.limits, x, excess)
            active = False
            for column in range(6):
                over = excess[column] + held.vehicle[k, q, column]
                value -= 0.5 * weight * held.vehicle[k, q, column] ** 2
                share[column] = max(over, 0.0) * weight
                if over > 0.0:
                    value += 0.5 * weight * over * over
                    active = True
            if active:
                pull[:] = 0.0
                _pull(task.limits, x, share, pull)
            for row in range(task.start[k], task.start[k + 1]):
                total = -task.offset[row]
                for axis in range(dimensions):
                    total += task.normal[row, axis] * x[task.order[row], axis]
                over = total / task.size[row] + held.rows[row, q]
                value -= 0.5 * weight * held.rows[row, q] ** 2
                if over > 0.0:
                    value += 0.5 * weight * over * over
                    if not active:
                        pull[:] = 0.0
                        active = True
                    for axis in range(dimensions):
                        part = task.normal[row, axis] / task.size[row]
                        pull[task.order[row], axis] += weight * over * part
            if not active:
                continue
            factor = 1.0
            for j in range(4):
                for axis in range(dimensions):
                    by_time[k] -= j * pull[j, axis] * x[j, axis] / duration
                    along = factor * pull[j, axis]
                    if along != 0.0:
                        for a in range(2 * r):
                            force[a, axis] += task.basis[j, q, a] * along
                factor /= duration
        for side in range(2):
            factor = 1.0
            for i in range(r):
                for axis in range(dimensions):
                    along = force[side * r + i, axis]
                    by_time[k] += i * along * local[side * r + i, axis] / duration
                    back[task.nodes[k, side], i, axis] += factor * along
                factor *= duration
    return value
