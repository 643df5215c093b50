"""Certificates from the multipliers of the interior point: lower bound or infeasibility.

Both are computed from the rows and the multipliers alone, independent of the iterations.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .chain_kernels import (
    bound_gradient,
    multiply,
    row_values,
    solve_factors,
    transposed,
)
from .interior_state import State

__all__ = ["find_contradiction", "prove_bound"]

Floats = NDArray[np.float64]

#: Domain of an infeasibility proof: the multiple of its current size that a coordinate may reach.
REACH = 1e4
#: Rounding error of a short sum, relative to its terms.
EIGHT_ULPS = 8 * np.finfo(float).eps


def prove_bound(state: State) -> tuple[float, float, float]:
    """Return objective, lower bound and dual residual, in the model's units.

    For any λ, ``|Cy|²/2 >= λ'Cy - |λ|²/2``. With multipliers z of the bounds, the right-hand side is
    independent of y except for a residual ``C'λ - G'z``, whose effect is bounded for all allowed y.
    λ = Cy leaves a residual as large as the rounding error of y times C'C. Therefore λ and z are
    refined separately: they are small even if y is a position far from the origin.
    """
    low, high = np.isfinite(state.lower), np.isfinite(state.upper)
    z_below, z_above = state.z_below.copy(), state.z_above.copy()
    d_below = np.where(low, z_below / state.below, 0.0)
    d_above = np.where(high, z_above / state.above, 0.0)
    factors, last = state.factorised(np.sqrt(d_below + d_above), state.cost)
    value = multiply(state.cost, state.knots, state.inner)
    dual = value.copy()
    for turn in range(4):
        knots, inner = np.zeros_like(state.knots), np.zeros_like(state.inner)
        transposed(state.cost, dual, knots, inner)
        bound_gradient(state.rows, state.start, z_above - z_below, knots, inner)
        knots[state.fixed] = 0.0
        if turn == 3:
            break
        x_knots, x_inner = -knots, -inner
        solve_factors(factors, last, state.fixed, x_knots, x_inner)
        dual += multiply(state.cost, x_knots, x_inner)
        step = row_values(state.rows, state.start, x_knots, x_inner)
        z_below = np.maximum(z_below - d_below * step, 0.0)
        z_above = np.maximum(z_above + d_above * step, 0.0)
    reach_knots, reach_inner = _reach(state)
    gain = float(np.sum(np.abs(knots) * reach_knots) + np.sum(np.abs(inner) * reach_inner))
    at = row_values(state.rows, state.start, state.knots, state.inner)
    slack = float(np.sum(z_below[low] * (at - state.lower)[low]))
    slack += float(np.sum(z_above[high] * (state.upper - at)[high]))
    slack += _rounding(state, z_below, z_above)
    half = 0.5 * float(np.sum(value**2))
    away = 0.5 * float(np.sum((value - dual) ** 2))
    unit = np.float64(2.0) / state.scale**2
    residual = max(float(np.abs(knots).max()), float(np.abs(inner).max(initial=0.0)))
    return half * unit, (half - away - slack - gain) * unit, residual


def _rounding(state: State, z_below: Floats, z_above: Floats) -> float:
    """Return a bound on the rounding error of a sum of multipliers times slacks."""
    size = row_values(np.abs(state.rows), state.start, np.abs(state.knots), np.abs(state.inner))
    size_below = size + np.where(np.isfinite(state.lower), np.abs(state.lower), 0.0)
    size_above = size + np.where(np.isfinite(state.upper), np.abs(state.upper), 0.0)
    return float(EIGHT_ULPS * (np.sum(z_below * size_below) + np.sum(z_above * size_above)))


def _reach(state: State) -> tuple[Floats, Floats]:
    """Return the largest distance of each coordinate from the optimum.

    It follows from the corridor and the limits at the knot, and is ``max(1, |y|)`` without bounds.
    """
    model, chain, r = state.chain.model, state.chain, state.chain.model.order
    knots = np.maximum(1.0, np.abs(state.knots))
    for bound in model.bounds:
        if bound.derivative >= r:
            continue
        wide = (bound.upper - bound.lower)[:, list(chain.axes)]
        wide = np.concatenate([wide, wide[-1:]])
        wide[1:-1] = np.minimum(wide[1:-1], wide[:-2])
        wide *= (chain.knot_times**bound.derivative)[:, None]
        own = knots[:, bound.derivative :: r]
        knots[:, bound.derivative :: r] = np.where(np.isfinite(wide), wide, own)
    return knots, np.maximum(1.0, np.abs(state.inner))


def _refine_ray(state: State, below: Floats, above: Floats) -> tuple[Floats, Floats]:
    """Reduce ``G'z`` to 0 by changing the ray in place, and return the remainder.

    The multipliers of the barrier problem only converge to a ray. The remainder is eliminated by the
    smallest change of the multipliers, weighted by multiplier over slack.
    """
    d_below, d_above = below / state.below, above / state.above
    largest = max(float((d_below + d_above).max()), 1e-300)
    d_below, d_above = d_below / largest, d_above / largest
    typical = max(float(np.linalg.norm(state.cost, axis=2).max()), 1e-300)
    factors, last = state.factorised(np.sqrt(d_below + d_above), state.cost * (1e-8 / typical))
    for turn in range(4):
        knots, inner = np.zeros_like(state.knots), np.zeros_like(state.inner)
        bound_gradient(state.rows, state.start, above - below, knots, inner)
        knots[state.fixed] = 0.0
        if turn < 3:
            x_knots, x_inner = -knots, -inner
            solve_factors(factors, last, state.fixed, x_knots, x_inner)
            step = row_values(state.rows, state.start, x_knots, x_inner)
            np.maximum(below - d_below * step, 0.0, out=below)
            np.maximum(above + d_above * step, 0.0, out=above)
    return knots, inner


def find_contradiction(state: State) -> NDArray[np.int64] | None:
    """Return the segments whose bounds prove infeasibility, or None without a proof.

    If the problem is infeasible, the multipliers grow along a ray that proves it (Farkas): the
    weighted sum of the violations is positive, and no coordinate can reduce it. The proof is valid
    for all coordinates within :data:`REACH` times their current size.
    """
    low, high = np.isfinite(state.lower), np.isfinite(state.upper)
    largest = max(float(state.z_below.max(initial=0.0)), float(state.z_above.max(initial=0.0)))
    if not largest > 1.0 or not np.isfinite(largest):
        return None
    below, above = state.z_below / largest, state.z_above / largest
    knots, inner = _refine_ray(state, below, above)
    at = row_values(state.rows, state.start, state.knots, state.inner)
    noise = _rounding(state, below, above)
    violation = float(np.sum(below[low] * (state.lower - at)[low]))
    violation += float(np.sum(above[high] * (at - state.upper)[high]))
    gain = float(
        np.sum(np.abs(knots) * np.maximum(1.0, np.abs(state.knots)))
        + np.sum(np.abs(inner) * np.maximum(1.0, np.abs(state.inner)))
    )
    if not violation > REACH * (gain + noise):
        return None
    found: NDArray[np.int64] = np.unique(state.held.segment[(below + above) > 1e-3])
    return found
