"""Certificates from the multipliers of the interior point: lower bound or infeasibility.

Both are computed from the rows and the multipliers alone, independent of the iterations.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .chain_kernels import bound_gradient, multiply, row_values, solve_factors, transposed
from .interior_state import State, factorised, sides

__all__ = ["find_contradiction", "prove_bound"]

Floats = NDArray[np.float64]

#: Domain of an infeasibility proof: the multiple of its current size that a coordinate may reach.
REACH = 1e4
#: Rounding error of a short sum, relative to its terms.
EIGHT_ULPS = 8 * np.finfo(float).eps


def _gradient(state: State, z: Floats, dual: Floats | None = None) -> tuple[Floats, Floats]:
    """Return ``C'dual - G'z`` by the free coordinates of knots and interiors."""
    posed = state.posed
    knots, inner = np.zeros_like(state.now.knots), np.zeros_like(state.now.inner)
    if dual is not None:
        transposed(posed.cost, dual, knots, inner)
    bound_gradient(posed.rows, posed.start, z[1] - z[0], knots, inner)
    knots[posed.fixed] = 0.0
    return knots, inner


def _slack_cost(state: State, z: Floats) -> float:
    """Return Σ z times the distance inside the bounds, which is negative for violations."""
    bounded = np.isfinite(state.posed.edge)
    return float(np.sum(z[bounded] * sides(state.posed, state.now)[bounded]))


def prove_bound(state: State) -> tuple[float, float, float]:
    """Return objective, lower bound and dual residual, in the model's units.

    For any λ, ``|Cy|²/2 >= λ'Cy - |λ|²/2``. With multipliers z of the bounds, the right-hand side is
    independent of y except for a residual ``C'λ - G'z``, whose effect is bounded for all allowed y.
    λ = Cy leaves a residual as large as the rounding error of y times C'C. Therefore λ and z are
    refined separately: they are small even if y is a position far from the origin.
    """
    posed, now = state.posed, state.now
    z, rate = now.z, now.z / now.slack
    factors, last = factorised(posed, np.sqrt(rate.sum(axis=0)), posed.cost)
    value = multiply(posed.cost, now.knots, now.inner)
    dual = value.copy()
    for _ in range(3):
        knots, inner = (-part for part in _gradient(state, z, dual))
        solve_factors(factors, last, posed.fixed, knots, inner)
        dual += multiply(posed.cost, knots, inner)
        step = row_values(posed.rows, posed.start, knots, inner)
        z = np.maximum(z - rate * np.stack([step, -step]), 0.0)
    knots, inner = (np.abs(part) for part in _gradient(state, z, dual))
    reach = np.maximum(1.0, np.abs(now.inner))
    gain = float(np.sum(knots * _reach(state)) + np.sum(inner * reach))
    slack = _slack_cost(state, z) + _rounding(state, z)
    away = 0.5 * float(np.sum((value - dual) ** 2))
    unit = np.float64(2.0) / state.scale**2
    residual = max(float(knots.max()), float(inner.max(initial=0.0)))
    return state.cost * unit, (state.cost - away - slack - gain) * unit, residual


def _rounding(state: State, z: Floats) -> float:
    """Return a bound on the rounding error of a sum of multipliers times slacks."""
    posed, now = state.posed, state.now
    size = row_values(np.abs(posed.rows), posed.start, np.abs(now.knots), np.abs(now.inner))
    edge = np.where(np.isfinite(posed.edge), np.abs(posed.edge), 0.0)
    return float(EIGHT_ULPS * np.sum(z * (size + edge)))


def _reach(state: State) -> Floats:
    """Return the largest distance of each coordinate of the knots from the optimum.

    It follows from the corridor and the limits at the knot, and is ``max(1, |y|)`` without bounds.
    """
    model, chain, r = state.chain.model, state.chain, state.chain.model.order
    knots = np.maximum(1.0, np.abs(state.now.knots))
    for bound in model.bounds:
        if bound.derivative >= r:
            continue
        wide = (bound.upper - bound.lower)[:, list(chain.axes)]
        wide = np.concatenate([wide, wide[-1:]])
        wide[1:-1] = np.minimum(wide[1:-1], wide[:-2])
        wide *= chain.units(state.durations)[:, bound.derivative :: r]
        own = knots[:, bound.derivative :: r]
        knots[:, bound.derivative :: r] = np.where(np.isfinite(wide), wide, own)
    return knots


def _refined_ray(state: State) -> Floats:
    """Return the multipliers, with ``G'z`` reduced to 0 and a largest entry of about 1.

    The multipliers of the barrier problem only converge to a ray. The remainder is eliminated by the
    smallest change of the multipliers, weighted by multiplier over slack.
    """
    posed, now = state.posed, state.now
    z: Floats = now.z / now.z.max()
    rate = z / now.slack
    rate /= max(float(rate.sum(axis=0).max()), 1e-300)
    typical = max(float(np.linalg.norm(posed.cost, axis=2).max()), 1e-300)
    factors, last = factorised(posed, np.sqrt(rate.sum(axis=0)), posed.cost * (1e-8 / typical))
    for _ in range(3):
        knots, inner = (-part for part in _gradient(state, z))
        solve_factors(factors, last, posed.fixed, knots, inner)
        step = row_values(posed.rows, posed.start, knots, inner)
        z = np.maximum(z - rate * np.stack([step, -step]), 0.0)
    return z


def find_contradiction(state: State) -> NDArray[np.int64] | None:
    """Return the segments whose bounds prove infeasibility, or None without a proof.

    If the problem is infeasible, the multipliers grow along a ray that proves it (Farkas): the
    weighted sum of the violations is positive, and no coordinate can reduce it. The proof is valid
    for all coordinates within :data:`REACH` times their current size.
    """
    now = state.now
    largest = float(now.z.max(initial=0.0))
    if not largest > 1.0 or not np.isfinite(largest):
        return None
    z = _refined_ray(state)
    gain = sum(
        float(np.sum(np.abs(part) * np.maximum(1.0, np.abs(at))))
        for part, at in zip(_gradient(state, z), (now.knots, now.inner), strict=True)
    )
    if not -_slack_cost(state, z) > REACH * (gain + _rounding(state, z)):
        return None
    rows = state.held.row[z.sum(axis=0) > 1e-3]
    segments: NDArray[np.int64] = np.unique(state.chain.limits.segment[rows])
    return segments
