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
    #: Gravity, drag per mass, speed², acceleration², high², low², cos(tilt), rate²; inf or 0: none.
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
def _excess(limits: Floats, x: Floats, excess: Floats, slope: Floats) -> None:
    """Write the relative excess of each limit, and its gradient by the derivatives 1 … 3.

    `x`, shape (4, D), are the derivatives, `excess` has the shape (6,), and `slope` (6, 4, D). The
    excess of a limit that is absent is -1, with the gradient 0.
    """
    dimensions = x.shape[1]
    excess[:] = -1.0
    slope[:] = 0.0
    for column in range(2):
        if limits[2 + column] < np.inf:
            total = 0.0
            for axis in range(dimensions):
                total += x[1 + column, axis] ** 2
                slope[column, 1 + column, axis] = 2.0 * x[1 + column, axis] / limits[2 + column]
            excess[column] = total / limits[2 + column] - 1.0
    if not (limits[4] < np.inf or limits[5] > 0.0 or limits[6] > -1.0 or limits[7] < np.inf):
        return
    drag, gravity = limits[1], limits[0]
    square, cross, turn = 0.0, 0.0, 0.0
    for axis in range(dimensions):
        force = x[2, axis] + drag * x[1, axis] + (gravity if axis == dimensions - 1 else 0.0)
        rate = x[3, axis] + drag * x[2, axis]
        square += force * force
        cross += force * rate
        turn += rate * rate
    square = max(square, 1e-12 * gravity * gravity)
    high, low, cosine, fast = limits[4], limits[5], limits[6], limits[7]
    if high < np.inf:
        excess[2] = square / high - 1.0
    if low > 0.0:
        excess[3] = 1.0 - square / low
    size = np.sqrt(square)
    if cosine > -1.0:
        up = x[2, dimensions - 1] + drag * x[1, dimensions - 1] + gravity
        excess[4] = (cosine * size - up) / gravity
    first, second = 0.0, 0.0
    # |f x f'|² / |f|⁴ = |f'|² / |f|² - (f f')² / |f|⁴
    if fast < np.inf:
        excess[5] = (turn / square - (cross / square) ** 2) / fast - 1.0
    # Rate about the thrust without yaw (Hopf fibration): (f₁ f'₀ - f₀ f'₁) / (|f| (|f| + f₂)).
    spin, lever, up = 0.0, 1.0, 0.0
    if fast < np.inf and dimensions == 3:
        first, second = x[2, 0] + drag * x[1, 0], x[2, 1] + drag * x[1, 1]
        up = x[2, 2] + drag * x[1, 2] + gravity
        lever = max(square + size * up, 1e-12 * gravity * gravity)
        spin = second * (x[3, 0] + drag * x[2, 0]) - first * (x[3, 1] + drag * x[2, 1])
        spin /= lever
        excess[5] += spin * spin / fast
    for axis in range(dimensions):
        force = x[2, axis] + drag * x[1, axis] + (gravity if axis == dimensions - 1 else 0.0)
        rate = x[3, axis] + drag * x[2, axis]
        for column in range(2, 6):
            by_force, by_rate = 0.0, 0.0
            if column == 2 and high < np.inf:
                by_force = 2.0 * force / high
            elif column == 3 and low > 0.0:
                by_force = -2.0 * force / low
            elif column == 4 and cosine > -1.0:
                by_force = cosine * force / (size * gravity)
                if axis == dimensions - 1:
                    by_force -= 1.0 / gravity
            elif column == 5 and fast < np.inf:
                by_rate = 2.0 * (rate - cross / square * force) / (square * fast)
                by_force = (
                    -2.0 * turn * force / square
                    - 2.0 * cross * rate / square
                    + 4.0 * (cross / square) ** 2 * force
                ) / (square * fast)
                if spin != 0.0:
                    share = 2.0 * spin / (lever * fast)
                    by_force -= share * spin * (2.0 * force + up * force / size)
                    if axis == 0:
                        by_rate += share * second
                        by_force -= share * (x[3, 1] + drag * x[2, 1])
                    elif axis == 1:
                        by_rate -= share * first
                        by_force += share * (x[3, 0] + drag * x[2, 0])
                    else:
                        by_force -= share * spin * size
            slope[column, 1, axis] = drag * by_force
            slope[column, 2, axis] = by_force + drag * by_rate
            slope[column, 3, axis] = by_rate


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
    slope = np.zeros((6, 4, dimensions))
    for k in range(durations.size):
        _scaled(task, k, durations[k], jets, local)
        for q in range(task.basis.shape[1]):
            _derivatives(task.basis, q, durations[k], local, x)
            _excess(task.limits, x, vehicle[k, q], slope)
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
    excess, slope = np.zeros(6), np.zeros((6, 4, dimensions))
    value = 0.0
    for k in range(durations.size):
        duration, weight = durations[k], held.weight[k]
        _scaled(task, k, duration, jets, local)
        force[:] = 0.0
        for q in range(task.basis.shape[1]):
            _derivatives(task.basis, q, duration, local, x)
            _excess(task.limits, x, excess, slope)
            active = False
            for column in range(6):
                over = excess[column] + held.vehicle[k, q, column]
                value -= 0.5 * weight * held.vehicle[k, q, column] ** 2
                if over > 0.0:
                    value += 0.5 * weight * over * over
                    if not active:
                        pull[:] = 0.0
                        active = True
                    for j in range(1, 4):
                        for axis in range(dimensions):
                            pull[j, axis] += weight * over * slope[column, j, axis]
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
                        share = task.normal[row, axis] / task.size[row]
                        pull[task.order[row], axis] += weight * over * share
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
