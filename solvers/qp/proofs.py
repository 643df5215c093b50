"""Proofs that a program has no solution: Farkas rays and directions of recession, recomputed.

A solver's claim that a program is infeasible or unbounded may be wrong, as may a point for an
infeasible program. The ray of the solver is tried first. If it is missing or wrong, a linear program
(the elastic phase 1, and the steepest direction of recession) yields one. In both cases the proof is
recomputed from the arrays of the program.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.base import row_maxima
from ...models.programs.linear import QuadraticProgram

__all__ = [
    "Findings",
    "contradiction",
    "examined",
    "least",
    "linear",
    "phase_one",
    "recedes",
    "receding",
    "steepest",
    "unit",
    "without_bound",
]

Vector = NDArray[np.float64]

#: Relative remainder of a sum whose terms must cancel.
CANCELLED = 1e-9


@dataclass(frozen=True, eq=False)
class Findings:
    """Proofs about a program without a known optimum.

    `source` is the origin of the ray, `point` a feasible point that was found, and `violation` the smallest sum of
    violations, each in units of its row, if phase 1 was solved. `examined` is True if all methods were tried.
    """

    infeasible: bool = False
    unbounded: bool = False
    source: str = ""
    point: Vector | None = None
    violation: float | None = None
    examined: bool = False


def unit(vector: Vector) -> Vector:
    """Return `vector` scaled to a largest entry of 1, with 0 for entries that are not finite."""
    v = np.where(np.isfinite(vector), vector, 0.0)
    scaled: Vector = v / max(np.abs(v).max(initial=0.0), 1e-300)
    return scaled


def least(matrix: sp.csr_array, right: Vector) -> Vector:
    """Return the shortest least-squares solution of ``matrix @ x = right``."""
    from scipy.sparse.linalg import lsqr

    solution: Vector = lsqr(matrix, right, atol=1e-15, btol=1e-15, conlim=0.0)[0]
    return solution


def without_bound(program: QuadraticProgram, pull: Vector) -> NDArray[np.bool_]:
    """Return a mask of the columns without a bound in the direction of `pull`."""
    return np.where(
        pull > 0, ~np.isfinite(program.column_upper), ~np.isfinite(program.column_lower)
    )


def receding(bound: Vector, without: float) -> Vector:
    """Return bounds of directions: 0 for a finite bound of points, and `without` for an infinite one."""
    return np.where(np.isfinite(bound), 0.0, without)


def contradiction(program: QuadraticProgram, ray: Vector) -> bool:
    """Return True if the row multipliers `ray` prove that no point satisfies all rows.

    The weighted rows then demand more than any point within the column bounds can give. On columns
    without the necessary bound, the weights must cancel up to rounding.
    """
    y = program.signed(unit(ray))
    pull, terms = program.matrix.T @ y, abs(program.matrix).T @ np.abs(y)
    unbounded = without_bound(program, pull)
    if (np.abs(pull) > CANCELLED * terms)[unbounded].any():
        return False
    pull[unbounded] = 0.0
    side = np.where(pull > 0, program.column_upper, program.column_lower)
    available = pull * np.where(pull != 0, side, 0.0)
    demanded = np.where(y > 0, program.row_lower, program.row_upper)
    demanded = y * np.where(y != 0, demanded, 0.0)
    excess = float(demanded.sum() - available.sum())
    return excess > CANCELLED * float(np.abs(demanded).sum() + np.abs(available).sum())


def recedes(program: QuadraticProgram, direction: Vector) -> bool:
    """Return True if the objective decreases without bound along `direction` from any feasible point."""
    d = unit(direction)
    size = np.abs(d)
    falls = program.cost @ d < -CANCELLED * float(np.abs(program.cost) @ size)
    flat = (np.abs(program.hessian @ d) <= CANCELLED * (abs(program.hessian) @ size)).all()
    move, noise = program.matrix @ d, CANCELLED * (abs(program.matrix) @ size)
    rows = (move >= -noise) | ~np.isfinite(program.row_lower)
    rows &= (move <= noise) | ~np.isfinite(program.row_upper)
    columns = (d >= 0) | ~np.isfinite(program.column_lower)
    columns &= (d <= 0) | ~np.isfinite(program.column_upper)
    return bool(falls and flat and rows.all() and columns.all())


def examined(
    program: QuadraticProgram,
    *,
    ray: Vector | None = None,
    direction: Vector | None = None,
    point: Vector | None = None,
    left: Callable[[], float | None] = lambda: None,
) -> Findings:
    """Prove what can be proven about a program for which a solver found no optimum.

    `ray` and `direction` are certificates of the solver, and `point` is a feasible point, if they are known.
    `left` returns the seconds left, None without a limit.
    """
    if point is None and ray is not None:
        for candidate in (ray, _cancelled(program, ray)):
            if contradiction(program, candidate):
                return Findings(infeasible=True, source="the solver's ray")
    violation = None
    if point is None:
        point, farkas_ray, violation = phase_one(program, left())
        if farkas_ray is not None and contradiction(program, farkas_ray):
            return Findings(infeasible=True, source="a phase 1 of our own", violation=violation)
    if direction is not None:
        for candidate in (direction, _tidy(program, direction)):
            if point is not None and recedes(program, candidate):
                return Findings(unbounded=True, source="the solver's direction", point=point)
    seconds = left()
    if point is None or (seconds is not None and seconds <= 0):
        return Findings(point=point, violation=violation, examined=point is None)
    direction = steepest(program, seconds)
    if direction is not None and recedes(program, direction):
        return Findings(unbounded=True, source="a recession program of our own", point=point)
    return Findings(point=point, violation=violation, examined=True)


def _cancelled(program: QuadraticProgram, ray: Vector) -> Vector:
    """Return `ray` moved, on its support, such that it cancels on columns without bounds."""
    y = program.signed(unit(ray))
    y = np.where(np.abs(y) > 1e-6, y, 0.0)
    support = np.flatnonzero(y)
    pull = program.matrix.T @ y
    unbounded = without_bound(program, pull)
    if support.size and unbounded.any():
        y[support] -= least(
            program.matrix[support][:, np.flatnonzero(unbounded)].T, pull[unbounded]
        )
    return y


def _tidy(program: QuadraticProgram, direction: Vector) -> Vector:
    """Return `direction` without its small entries, clipped to the cone of the column bounds."""
    d = unit(direction)
    d = np.where(np.abs(d) > 1e-6, d, 0.0)
    return np.clip(
        d, receding(program.column_lower, -np.inf), receding(program.column_upper, np.inf)
    )


@np.errstate(all="ignore")  # scaled entries may overflow
def phase_one(
    program: QuadraticProgram, seconds: float | None
) -> tuple[Vector | None, Vector | None, float | None]:
    """Return a feasible point or a ray, and the smallest sum of violations in units of the rows.

    An additional column per row holds its value, within the row's bounds. The multipliers of the
    equality rows are then those of the program's rows.
    """
    rows, size = program.row_count, program.size
    largest = row_maxima(program.matrix)
    scale = 1.0 / np.where(largest > 0, largest, 1.0)
    scaled = sp.csr_array(sp.diags_array(scale) @ program.matrix) if rows else program.matrix
    unit = sp.eye_array(rows, format="csr")
    cost = np.concatenate([np.zeros(size + rows), np.ones(2 * rows)])
    lower = np.concatenate([program.column_lower, program.row_lower * scale, np.zeros(2 * rows)])
    upper = np.concatenate(
        [program.column_upper, program.row_upper * scale, np.full(2 * rows, np.inf)]
    )
    solved = linear(
        cost, sp.hstack([scaled, -unit, unit, -unit]), np.zeros(rows), lower, upper, seconds
    )
    if solved is None:
        return None, None, None
    x, y, value = solved
    point: Vector = np.clip(x[:size], program.column_lower, program.column_upper)
    feasible = program.verify(point, tolerance=1e-7).ok
    return (point if feasible else None), (None if feasible else y * scale), value


@np.errstate(all="ignore")  # scaled entries may overflow
def steepest(program: QuadraticProgram, seconds: float | None) -> Vector | None:
    """Return the direction without curvature, within a box, in which the objective decreases fastest."""
    curved = np.flatnonzero(np.diff(program.hessian.indptr))
    stacked = sp.vstack([program.hessian[curved], program.matrix], format="csr")
    largest = row_maxima(stacked)
    scaled = sp.diags_array(1.0 / np.where(largest > 0, largest, 1.0)) @ stacked
    total, size = stacked.shape[0], program.size
    nothing = np.zeros(curved.size)
    peak = np.abs(program.cost).max(initial=0.0)
    if not peak > 0:
        return None
    solved = linear(
        np.concatenate([program.cost / peak, np.zeros(total)]),
        sp.hstack([scaled, -sp.eye_array(total)]),
        np.zeros(total),
        np.concatenate(
            [receding(program.column_lower, -1.0), nothing, receding(program.row_lower, -np.inf)]
        ),
        np.concatenate(
            [receding(program.column_upper, 1.0), nothing, receding(program.row_upper, np.inf)]
        ),
        seconds,
    )
    return None if solved is None else solved[0][:size]


def linear(
    cost: Vector,
    matrix: sp.csr_array,
    right: Vector,
    lower: Vector,
    upper: Vector,
    seconds: float | None,
) -> tuple[Vector, Vector, float] | None:
    """Solve a linear program with SciPy's HiGHS simplex, whose vertices are exact up to rounding."""
    from scipy.optimize import linprog

    options: dict[str, float | bool] = {
        "primal_feasibility_tolerance": 1e-10,
        "dual_feasibility_tolerance": 1e-10,
    }
    if seconds is not None:
        options["time_limit"] = max(seconds, 1e-3)
    matrix = sp.csc_array(matrix)
    finite = all(np.isfinite(array).all() for array in (cost, matrix.data, right))
    if not finite or np.isnan(lower).any() or np.isnan(upper).any():
        return None  # scaled entries overflowed
    if not cost.size:
        return np.zeros(0), np.zeros(right.size), 0.0
    result = linprog(
        cost,
        A_eq=matrix if right.size else None,
        b_eq=right if right.size else None,
        bounds=np.column_stack([lower, upper]),
        method="highs-ds",
        options=options,
    )
    if result.status != 0:
        return None
    duals = result.eqlin.marginals if right.size else np.zeros(0)
    return np.asarray(result.x, float), np.asarray(duals, float), float(result.fun)
