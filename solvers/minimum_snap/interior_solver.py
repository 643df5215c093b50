"""Structured interior point on one chain, which adds instants while the barrier decreases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .chain import Chain
from .chain_kernels import bound_gradient, multiply, row_values, solve_factors, transposed
from .contacts import certify_chain
from .interior_kernels import CONVERGED, STOPPED, Iterate
from .interior_state import Settings, State, factorised, sides

__all__ = ["ChainResult", "Settings", "solve_chain"]

Floats = NDArray[np.float64]

#: Relative complementarities at which missing instants are added, before the final one.
LEVELS = (1e2, 1e1, 1e0, 1e-1, 1e-2, 1e-3)
#: Largest violation between the instants for a certified path.
BETWEEN = 1e-10
#: Domain of an infeasibility proof: the multiple of its current size that a coordinate may reach.
REACH = 1e4
#: Rounding error of a short sum, relative to its terms.
EIGHT_ULPS = 8 * np.finfo(float).eps
#: Factors of the barrier parameter at each restart after a stall.
BOOSTS = (1e4, 1e6, 1e8)


@dataclass(frozen=True)
class ChainResult:
    """Result of the interior point for one chain."""

    #: ``"solved"``, ``"infeasible"``, ``"stopped"`` or ``"stalled"``.
    status: str
    #: Coefficients in ascending powers of s, shape (segments, degree + 1, axes).
    powers: Floats
    #: Objective of the iterate, and the lower bound that its multipliers prove.
    objective: float
    bound: float
    #: Largest residuals: of the rows, and of the gradient relative to the largest multiplier.
    primal: float
    dual: float
    #: Numbers of iterations, of rounds and of instants.
    iterations: int
    rounds: int
    instants: int
    #: Segments whose bounds prove infeasibility.
    conflict: NDArray[np.int64]
    #: Last Newton step of a certified path, as a share of the extent; infinite without a
    #: certificate.
    correction: float = np.inf


def solve_chain(chain: Chain, settings: Settings, flag: NDArray[np.int8]) -> ChainResult:
    """Solve one chain with a decreasing barrier, and add missing instants at each level.

    An iterate near convergence is a poor start after adding rows, because its slacks are too small.
    Therefore the iterates of all levels are stored. After rows are added, the solver restarts from
    the level whose barrier is as large as the violation. If that stalls, it restarts from a larger
    barrier, and finally from the initial iterate.
    """
    state = State(chain, settings, flag)
    gaps = [*LEVELS, settings.gap]
    kept: list[Iterate] = [state.now.copied()]  # kept[i] is where the descent to gaps[i] begins
    level, iterations, rounds = 0, 0, 0
    status, primal, retreat, restarts = "stalled", 0.0, 0, 0
    enlarged = False
    while rounds < settings.rounds:
        code, count, primal = state.descend(gaps[level])
        iterations += count
        last = level == len(gaps) - 1
        if code == STOPPED:
            status = "stopped"
            break
        if code != CONVERGED and not (last and state.is_settled(primal)):
            # Only added rows make a start too narrow. Without them, this is the initial iterate.
            spent = rounds == 0 or retreat == 0
            if find_contradiction(state) is not None or (spent and restarts == len(BOOSTS)):
                break
            if spent:
                state.begin(BOOSTS[restarts])
                restarts, level, kept, enlarged = restarts + 1, 0, [state.now.copied()], True
                continue
            retreat = level = max(min(retreat, level) - 2, 0)
            del kept[level + 1 :]
            state.now = kept[level].copied()
            continue
        threshold = max(settings.between, min(1e-2 * gaps[level], 1e-2), 4.0 * primal)
        fresh, worst = state.find_violations(threshold)
        if fresh is None:
            if last:
                status = "solved"
                break
            if not enlarged and state.enlarge():
                enlarged, kept = True, [state.now.copied()] * len(kept)
            level += 1
            kept.append(state.now.copied())
            continue
        rounds += 1
        kept = state.add(fresh, [*kept, state.now.copied()])
        if last:
            # Smaller violations allow a start at a smaller barrier.
            wanted = 1 + int(np.searchsorted(-np.array(LEVELS), -10.0 * worst))
            retreat = level = min(wanted, len(LEVELS) - 1)
            del kept[level + 1 :]
        else:
            level += 1
            retreat = level
        state.now = kept[level].copied()
    conflict = np.empty(0, np.int64)
    objective, bound, dual = prove_bound(state)
    if status == "stalled":
        # The caller assesses optimality by the bound. Otherwise test for infeasibility.
        small = max(1e-6 * abs(objective), state.nothing)
        if abs(objective - bound) <= small and primal <= 1e-7:
            status = "solved"
        else:
            result = find_contradiction(state)
            if result is not None:
                status, conflict = "infeasible", result
    powers, correction = state.powers(), np.inf
    if status == "solved" and settings.certify:
        path = certify_chain(state, min(settings.between, BETWEEN))
        if path is not None:
            powers, objective, correction = path.powers, path.objective, path.correction
            bound = max(bound, objective - path.gap)
    return ChainResult(
        status, powers, objective, bound, primal, dual, iterations, rounds,
        int(state.held.s.size), conflict, correction,
    )  # fmt: skip


# -- certificates, from the rows and the multipliers alone -----------------------------------------


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
