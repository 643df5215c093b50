"""The structured interior point on one chain: instants are added while the barrier falls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .certificates import contradiction, proven
from .chain import Chain
from .interior_kernels import CONVERGED, STOPPED
from .interior_state import Iterate, Settings, State

__all__ = ["ChainResult", "Settings", "solve_chain"]

Floats = NDArray[np.float64]

#: Relative complementarities at which the instants are reviewed, before the last.
LEVELS = (1e2, 1e1, 1e0, 1e-1, 1e-2, 1e-3)


@dataclass(frozen=True)
class ChainResult:
    """What the interior point found for one chain.

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
        Counts.
    conflict : ndarray of int
        Segments whose bounds prove that there is no solution.
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


def solve_chain(chain: Chain, settings: Settings, flag: NDArray[np.int8]) -> ChainResult:
    """Solve one chain: the barrier falls in levels, and at each the instants are reviewed.

    An iterate close to the end is a bad start for more rows: its slacks are too small to give way.
    So the iterates of all levels are kept, rows that come late begin at one whose barrier is as
    wide as their violation, and where that stalls, at a wider one.
    """
    state = State(chain, settings, flag)
    gaps = [*LEVELS, settings.gap]
    kept: list[Iterate] = [state.kept()]  # kept[i] is where the descent to gaps[i] begins
    level, iterations, rounds = 0, 0, 0
    status, primal, retreat = "stalled", 0.0, 0
    while rounds < settings.rounds:
        code, count, _, _, primal, _ = state.descend(gaps[level])
        iterations += count
        last = level == len(gaps) - 1
        if code == STOPPED:
            status = "stopped"
            break
        if code != CONVERGED and not (last and state.good(primal)):
            # Only rows that came late make a start too narrow: without them it is the problem.
            if rounds == 0 or retreat == 0 or contradiction(state) is not None:
                break
            retreat = level = max(min(retreat, level) - 2, 0)
            del kept[level + 1 :]
            state.back_to(kept[level])
            continue
        threshold = max(settings.between, min(1e-2 * gaps[level], 1e-2), 4.0 * primal)
        fresh, worst = state.missing(threshold)
        if fresh is None:
            if last:
                status = "solved"
                break
            level += 1
            kept.append(state.kept())
            continue
        rounds += 1
        kept = state.add(fresh, [*kept, state.kept()])
        if last:
            # As deep as the violation is small.
            wanted = 1 + int(np.searchsorted(-np.array(LEVELS), -10.0 * worst))
            retreat = level = min(wanted, len(LEVELS) - 1)
            del kept[level + 1 :]
        else:
            level += 1
            retreat = level
        state.back_to(kept[level])
    conflict = np.empty(0, np.int64)
    objective, bound, dual = proven(state)
    if status == "stalled":
        # Good enough is for the caller to judge by the bound; else see whether nothing can be.
        small = max(1e-6 * abs(objective), state.nothing)
        if abs(objective - bound) <= small and primal <= 1e-7:
            status = "solved"
        else:
            found = contradiction(state)
            if found is not None:
                status, conflict = "infeasible", found
    return ChainResult(
        status, state.powers(), objective, bound, primal, dual, iterations, rounds,
        int(state.held.s.size), conflict,
    )  # fmt: skip
