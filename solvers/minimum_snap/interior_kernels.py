"""Compiled primal-dual Newton steps on a chain of segments, based on :mod:`.chain_kernels`.

Every bound is ``sign * value >= edge``: side 0 is the lower bound (sign 1), side 1 the negated upper
bound (sign -1).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .chain_kernels import (
    advance,
    bound_gradient,
    factorise,
    hold_still,
    largest_of,
    multiply,
    newton_step,
    row_values,
    times,
    transposed,
)

__all__ = ["CONVERGED", "STALLED", "STOPPED", "Iterate", "Posed", "centre", "interior_point"]

CONVERGED, STALLED, STOPPED = 0, 1, 2

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


class Posed(NamedTuple):
    """Quadratic program of a chain: minimise ``|cost @ y|² / 2`` within bounds."""

    #: Rows of the cost, shape (segments, c, width).
    cost: Floats
    #: Rows of the bounds, with a largest entry of 1, shape (Q, width).
    rows: Floats
    #: Index of the first bound row of each segment, shape (segments + 1,).
    start: Ints
    #: Lower bounds, and negated upper bounds, shape (2, Q); -inf for unbounded sides.
    edge: Floats
    #: Mask of the fixed coordinates of the knots, shape (segments + 1, n).
    fixed: Flags
    #: Factor that normalises each bound row, shape (Q,).
    share: Floats


class Iterate(NamedTuple):
    """Coordinates of the knots and the interiors, then slacks and multipliers, shape (2, Q).

    Slacks are positive. Slacks and multipliers of unbounded sides are 1 and 0.
    """

    knots: Floats
    inner: Floats
    slack: Floats
    z: Floats

    def copied(self) -> Iterate:
        """Return a writable copy."""
        return Iterate(*(part.copy() for part in self))

    def extended(self, order: Ints, slack: Floats, bounded: Flags, mu: float) -> Iterate:
        """Return the iterate with further rows, sorted by `order`.

        The new rows have the slacks `slack`, shape (2, rows), and multipliers ``mu / slack``.
        """
        old = self.slack.shape[1]
        more = np.ones((2, order.size - old))
        new = bounded & (order >= old)
        return self._replace(
            slack=np.where(new, slack, np.concatenate([self.slack, more], axis=1)[:, order]),
            z=np.where(new, mu / slack, np.concatenate([self.z, 0.0 * more], axis=1)[:, order]),
        )


@kernel
def _residuals(posed: Posed, now: Iterate, rest: Floats) -> tuple[Floats, Floats, float, float]:
    """Fill `rest` with the residuals of the bounds.

    Return the gradient of the Lagrangian, the cost and the largest summand of its gradient.
    """
    value = multiply(posed.cost, now.knots, now.inner)
    at = row_values(posed.rows, posed.start, now.knots, now.inner)
    pull = np.zeros(at.size)
    for q in range(at.size):
        pull[q] = now.z[1, q] - now.z[0, q]
        for side in range(2):
            if posed.edge[side, q] > -np.inf:
                sign = 1.0 - 2.0 * side
                rest[side, q] = sign * at[q] - posed.edge[side, q] - now.slack[side, q]
    g_knots, g_inner = np.zeros(now.knots.shape), np.zeros(now.inner.shape)
    transposed(posed.cost, value, g_knots, g_inner)
    bound_gradient(posed.rows, posed.start, pull, g_knots, g_inner)
    hold_still(posed.fixed, g_knots)
    cost, typical = 0.0, 0.0
    for k in range(posed.cost.shape[0]):
        for i in range(posed.cost.shape[1]):
            cost += 0.5 * value[k, i] * value[k, i]
            for j in range(posed.cost.shape[2]):
                typical = max(typical, abs(posed.cost[k, i, j] * value[k, i]))
    return g_knots, g_inner, cost, typical


class _Work(NamedTuple):
    """Arrays of the Newton system, and residuals and steps of slacks and multipliers, shape (2, Q).

    `excess` is slack times multiplier less its target.
    """

    factors: Floats
    last: Floats
    weight: Floats
    rest: Floats
    excess: Floats
    d_slack: Floats
    d_z: Floats


@kernel
def _allocate(posed: Posed) -> _Work:
    count, _, width = posed.cost.shape
    n, size = posed.fixed.shape[1], posed.rows.shape[0]
    return _Work(
        np.zeros((count, width - n, width)), np.zeros((n, n)), np.zeros(size),
        np.zeros((2, size)), np.zeros((2, size)), np.zeros((2, size)), np.zeros((2, size)),
    )  # fmt: skip


@kernel
def _factorise(posed: Posed, now: Iterate, work: _Work) -> None:
    """Factorise the Newton system of the iterate with its row weights."""
    weight = work.weight
    for q in range(weight.size):
        weight[q] = np.sqrt(now.z[0, q] / now.slack[0, q] + now.z[1, q] / now.slack[1, q])
    factorise(posed.cost, posed.rows, posed.start, weight, posed.fixed, work.factors, work.last)


@kernel
def _direction(
    posed: Posed, now: Iterate, work: _Work, g_knots: Floats, g_inner: Floats, limit: float
) -> tuple[Floats, Floats, float]:
    """Fill the steps of slacks and multipliers that remove the residuals and the excess.

    Return the changes of the coordinates and the step length, at most 1, that uses at most the share
    `limit` of any slack or multiplier.
    """
    rest, excess, size = work.rest, work.excess, work.weight.size
    pull = np.zeros(size)
    for q in range(size):
        for side in range(2):
            if posed.edge[side, q] > -np.inf:
                push = excess[side, q] + now.z[side, q] * rest[side, q]
                pull[q] -= (1.0 - 2.0 * side) * push / now.slack[side, q]
    b_knots, b_inner = times(-1.0, g_knots), times(-1.0, g_inner)
    bound_gradient(posed.rows, posed.start, pull, b_knots, b_inner)
    hold_still(posed.fixed, b_knots)
    x_knots, x_inner = newton_step(
        posed.cost, posed.rows, posed.start, work.weight, posed.fixed, work.factors, work.last,
        b_knots, b_inner,
    )  # fmt: skip
    step = row_values(posed.rows, posed.start, x_knots, x_inner)
    alpha = 1.0
    for q in range(size):
        for side in range(2):
            if posed.edge[side, q] > -np.inf:
                slack, z = now.slack[side, q], now.z[side, q]
                a = (1.0 - 2.0 * side) * step[q] + rest[side, q]
                b = -(excess[side, q] + z * a) / slack
                if a < 0.0:
                    alpha = min(alpha, -limit * slack / a)
                if b < 0.0:
                    alpha = min(alpha, -limit * z / b)
                work.d_slack[side, q], work.d_z[side, q] = a, b
    return x_knots, x_inner, alpha


@kernel
def _advance(now: Iterate, alpha: float, x_knots: Floats, x_inner: Floats, work: _Work) -> None:
    advance(now.knots, alpha, x_knots)
    advance(now.inner, alpha, x_inner)
    advance(now.slack, alpha, work.d_slack)
    advance(now.z, alpha, work.d_z)


@kernel(interpretable=True, in_place=True)
def interior_point(
    posed: Posed, now: Iterate, gap: float, tolerance: float, most: int, nothing: float,
    flag: NDArray[np.int8],
) -> tuple[int, int, float]:  # fmt: skip
    """Run Mehrotra's predictor-corrector method from the given iterate, which is updated in place.

    Gaps are relative to the objective, or to `nothing` if that is larger. Return status, iterations
    and the largest primal residual.
    """
    work = _allocate(posed)
    rest, excess, d_slack, d_z = work.rest, work.excess, work.d_slack, work.d_z
    pairs, size = 0, posed.rows.shape[0]
    for q in range(size):
        pairs += int(posed.edge[0, q] > -np.inf) + int(posed.edge[1, q] > -np.inf)
    primal, best, idle, done = 0.0, np.inf, 0, 0
    for iteration in range(most):
        done = iteration
        if flag[0] != 0:
            return STOPPED, done, primal
        g_knots, g_inner, objective, _ = _residuals(posed, now, rest)
        dual = max(largest_of(g_knots), largest_of(g_inner))
        primal, largest = largest_of(rest), max(1.0, largest_of(now.z))
        comp = 0.0
        for q in range(size):
            for side in range(2):
                # The predictor neither centres nor has a second-order term.
                excess[side, q] = now.slack[side, q] * now.z[side, q]
                comp += excess[side, q]
        if largest > 1e100:  # a ray of an infeasible problem, or no free coordinate
            break
        unit = max(objective, nothing)
        if comp <= gap * unit and primal <= tolerance and dual <= tolerance * largest:
            return CONVERGED, done, primal
        merit = max(comp / unit, primal, dual / largest)
        idle += 1
        if merit < 0.9 * best:
            best, idle = merit, 0
        if idle > 15:
            break
        _factorise(posed, now, work)
        _, _, alpha = _direction(posed, now, work, g_knots, g_inner, 1.0)
        ahead = 0.0
        for q in range(size):
            for side in range(2):
                slack = now.slack[side, q] + alpha * d_slack[side, q]
                ahead += slack * (now.z[side, q] + alpha * d_z[side, q])
        share = ahead / max(comp, 1e-300)
        sigma = share * share * share
        for q in range(size):
            for side in range(2):
                if posed.edge[side, q] > -np.inf:
                    excess[side, q] += d_slack[side, q] * d_z[side, q] - sigma * comp / pairs
        x_knots, x_inner, alpha = _direction(posed, now, work, g_knots, g_inner, 0.995)
        _advance(now, alpha, x_knots, x_inner, work)
        done = iteration + 1
    return STALLED, done, primal


@kernel
def centre(
    posed: Posed, now: Iterate, room: Floats, mu: float, accuracy: float, most: int,
    flag: NDArray[np.int8],
) -> tuple[int, int]:  # fmt: skip
    """Minimise ``|cost @ y|² / 2 - mu Σ log slack`` by primal-dual Newton steps, in place.

    The barrier parameter `mu` is constant, so that the value is a smooth function of the durations
    and a few steps lead to the solution for similar durations. `room` contains the largest
    violations of the bounds, shape (2, Q), in the normalised rows, and `accuracy` is the largest
    relative error of slack times multiplier and of the gradient. Without convergence after `most`
    steps, the bounds are treated as infeasible. Return status and number of steps.
    """
    work = _allocate(posed)
    rest, excess, size = work.rest, work.excess, posed.rows.shape[0]
    best, idle, before = np.inf, 0, np.inf
    for iteration in range(most):
        if flag[0] != 0:
            return STOPPED, iteration
        g_knots, g_inner, _, typical = _residuals(posed, now, rest)
        primal, off = 0.0, 0.0
        for q in range(size):
            for side in range(2):
                if posed.edge[side, q] > -np.inf:
                    excess[side, q] = now.slack[side, q] * now.z[side, q] - mu
                    primal = max(primal, abs(rest[side, q]) / room[side, q])
                    off = max(off, abs(excess[side, q]) / mu)
        if primal <= 1.0 and off <= accuracy:
            # Gradients are compared with the size of their summands.
            ratio = max(largest_of(g_knots), largest_of(g_inner))
            ratio /= max(typical, largest_of(now.z), 1e-300)
            # Rounding may prevent the requested accuracy. Accept a ratio that no longer decreases.
            if ratio <= accuracy or (ratio <= 1e-5 and ratio > 0.5 * before):
                return CONVERGED, iteration
            before = ratio
        if primal > 1.0:
            # Without a feasible path, the violation stops decreasing.
            idle += 1
            if primal < 0.7 * best:
                best, idle = primal, 0
            if idle > 12:
                break
        _factorise(posed, now, work)
        x_knots, x_inner, alpha = _direction(posed, now, work, g_knots, g_inner, 0.99)
        _advance(now, alpha, x_knots, x_inner, work)
    return STALLED, most
