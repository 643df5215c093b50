"""Structured interior point on one chain, which adds instants while the barrier decreases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .certificates import find_contradiction, prove_bound
from .chain import Chain
from .contacts import certify_chain
from .interior_kernels import CONVERGED, STOPPED, Iterate
from .interior_state import Settings, State

__all__ = ["ChainResult", "Settings", "solve_chain"]

Floats = NDArray[np.float64]

#: Relative complementarities at which missing instants are added, before the final one.
LEVELS = (1e2, 1e1, 1e0, 1e-1, 1e-2, 1e-3)
#: Largest violation between the instants for a certified path.
BETWEEN = 1e-10
#: Factors of the barrier parameter at each restart after a stall.
BOOSTS = (1e4, 1e6, 1e8)


@dataclass(frozen=True)
class ChainResult:
    """Result of the interior point for one chain.

    Parameters
    ----------
    status : str
        ``"solved"``, ``"infeasible"``, ``"stopped"`` or ``"stalled"``.
    powers : ndarray, shape (segments, degree + 1, axes)
        Coefficients in ascending powers of s.
    objective, bound : float
        Objective of the iterate, and the lower bound that its multipliers prove.
    primal, dual : float
        Largest residuals: of the rows, and of the gradient relative to the largest multiplier.
    iterations, rounds, instants : int
        Numbers of iterations, of rounds and of instants.
    conflict : ndarray of int
        Segments whose bounds prove infeasibility.
    correction : float
        Last Newton step of a certified path, as a share of the extent; infinite without a certificate.
    """

    status: str
    powers: Floats
    objective: float
    bound: float
    primal: float
    dual: float
    iterations: int
    rounds: int
    instants: int
    conflict: NDArray[np.int64]
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
            found = find_contradiction(state)
            if found is not None:
                status, conflict = "infeasible", found
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
