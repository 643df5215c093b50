"""What a point of a nonlinear program is worth: computed again from the program, not believed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.programs.blocks import Block
from ...models.programs.nonlinear import NonlinearProgram

__all__ = ["Quality", "estimated_duals", "explained_duals", "measured", "worst_blocks"]

Vector = NDArray[np.float64]

#: How near a bound counts as at it, relative to the bound and to the typical size.
REACH = 1e-6
#: Product of multiplier and slack, relative to the objective, that an interior point leaves.
COMPLEMENTARITY = 1e-6
#: Weight that makes the least squares for multipliers solvable where rows depend on one another.
DAMPING = 1e-10
#: How often wrongly signed multipliers are taken out of the least squares.
ROUNDS = 8


@dataclass(frozen=True, eq=False)
class Quality:
    """A point with what the program says of it.

    Parameters
    ----------
    point : ndarray, shape (n,)
        Within the column bounds.
    objective : float
        Its objective.
    feasible : bool
        Whether it satisfies rows and columns within the tolerance.
    infeasibility : float
        Largest violation of a row, in units of its typical size.
    duals : ndarray, shape (m,)
        Row multipliers of the right sign that binding rows explain.
    stationarity : float
        Largest reduced cost that no bound explains, relative to 1 and to the objective's gradient.
    """

    point: Vector
    objective: float
    feasible: bool
    infeasibility: float
    duals: Vector
    stationarity: float


def measured(
    program: NonlinearProgram,
    point: Vector | None,
    duals: Vector | None,
    tolerance: float,
    enough: float,
) -> Quality | None:
    """Return the quality of `point`, moved into the column bounds; None where it is no point.

    Multipliers are estimated by least squares where none are given, or where those given leave a
    stationarity above `enough`.
    """
    if point is None:
        return None
    x = np.clip(np.asarray(point, float), program.column_lower, program.column_upper)
    try:
        found = program.verify(x, tolerance=tolerance)
        violation = float(program.violations(x).max(initial=0.0))
    except (InvalidData, RuntimeError):
        return None
    objective = found.objective
    feasible = found.ok and objective is not None
    none = np.zeros(program.row_count)
    if not feasible or objective is None:
        value = np.nan if objective is None else objective
        return Quality(x, value, False, violation, none, np.inf)
    best, least = none, np.inf
    given = duals is not None and duals.shape == none.shape and bool(np.isfinite(duals).all())
    if given and duals is not None:
        best = explained_duals(program, x, duals, objective)
        least = _stationarity(program, x, best, objective)
    if not least <= enough:
        guess = estimated_duals(program, x)
        left = np.inf if guess is None else _stationarity(program, x, guess, objective)
        if guess is not None and (left < least or not np.isfinite(least)):
            best, least = guess, left
    return Quality(x, objective, True, violation, best, least)


def _stationarity(
    program: NonlinearProgram, point: Vector, duals: Vector, objective: float
) -> float:
    """Return the program's own measure, made relative, with what an interior point leaves explained.

    Such a point keeps a distance from the bounds that bind, and the product with the reduced cost is
    all that can be asked of it. Rounding counts against the point: of rows that depend on one another,
    multipliers of 1e14 that cancel were seen to explain whatever they were asked to.
    """
    gradient = program.gradient(point) * program.column_scale / program.objective_scale
    reduced = program.reduced_costs(point, duals)
    if not (np.isfinite(gradient).all() and np.isfinite(reduced).all()):
        return float("inf")
    slack = np.where(reduced > 0, point - program.column_lower, program.column_upper - point)
    with np.errstate(invalid="ignore"):
        loose = ~(np.abs(reduced) * slack <= _idle(program, objective))
    left = np.abs(reduced) * program.column_scale / program.objective_scale
    whole = min(program.stationarity(point, duals), float(left[loose].max(initial=0.0)))
    rounded = np.abs(program.jacobian(point)).T @ np.abs(duals) * np.finfo(float).eps
    rounded *= program.column_scale / program.objective_scale
    whole += float(rounded.max(initial=0.0))
    return whole / max(1.0, float(np.abs(gradient).max(initial=0.0)))


def _idle(program: NonlinearProgram, objective: float) -> float:
    return COMPLEMENTARITY * max(program.objective_scale, abs(objective))


def _near(program: NonlinearProgram, rows: Vector) -> tuple[Vector, Vector, Vector]:
    """Return the slack of each row above and below, and what counts as none."""
    reach = REACH * np.maximum(program.row_scale, np.abs(rows))
    return rows - program.row_lower, program.row_upper - rows, reach


def explained_duals(
    program: NonlinearProgram, point: Vector, duals: Vector, objective: float
) -> Vector:
    """Return `duals` without those that no binding row explains, by sign or by slack."""
    above, below, reach = _near(program, program.values(point)[1])
    slack = np.where(duals > 0, above, below)
    with np.errstate(invalid="ignore"):
        small = np.abs(duals) * slack <= _idle(program, objective)
    kept: Vector = np.where((slack <= reach) | small, duals, 0.0)
    return kept


def estimated_duals(program: NonlinearProgram, point: Vector) -> Vector | None:
    """Return the multipliers that leave the least sum of squared reduced costs, None where none do.

    Rows that do not bind have none, and what comes out with the wrong sign is taken out.
    """
    scale, weight = program.column_scale, program.objective_scale
    gradient = program.gradient(point) * scale / weight
    jacobian = sp.csc_array(
        sp.diags_array(1.0 / program.row_scale) @ program.jacobian(point) @ sp.diags_array(scale)
    )
    if not (np.isfinite(gradient).all() and np.isfinite(jacobian.data).all()):
        return None
    above, below, reach = _near(program, program.values(point)[1])
    low, high = above <= reach, below <= reach
    span = REACH * np.maximum(np.abs(point), scale)
    at_lower, at_upper = point - program.column_lower <= span, program.column_upper - point <= span
    rows, free = low | high, ~(at_lower | at_upper)
    duals = np.zeros(program.row_count)
    for _ in range(ROUNDS):
        duals[:] = 0.0
        if rows.any():
            part = jacobian[np.flatnonzero(rows)][:, np.flatnonzero(free)]
            solved = _least_squares(part, gradient[free])
            if solved is None:
                return None
            duals[rows] = solved
        wrong = rows & ~(low & high) & np.where(duals > 0, ~low, ~high) & (duals != 0)
        reduced = gradient - jacobian.T @ duals
        loose = ~free & ~(at_lower & at_upper) & np.where(reduced > 0, ~at_lower, ~at_upper)
        loose &= np.abs(reduced) > 1e-9
        if not (wrong.any() or loose.any()):
            break
        rows, free = rows & ~wrong, free | loose
    duals[wrong] = 0.0
    result: Vector = duals * weight / program.row_scale
    return result


def _least_squares(matrix: sp.csc_array, right: Vector) -> Vector | None:
    """Return y of the least ``|right - matrix.T @ y|``, by the sparse augmented system."""
    from scipy.sparse.linalg import splu

    rows, columns = matrix.shape
    system = sp.block_array(
        [[sp.eye_array(columns), matrix.T], [matrix, -DAMPING * sp.eye_array(rows)]], format="csc"
    )
    try:
        solved = splu(system).solve(np.concatenate([right, np.zeros(rows)]))
    except RuntimeError:  # singular after all
        return None
    found: Vector = solved[columns:]
    return found if np.isfinite(found).all() else None


def worst_blocks(program: NonlinearProgram, point: Vector, count: int = 4) -> str:
    """Return the row blocks most violated at `point`, in the paper's words.

    Sorted by the violation in units of the typical size; the number is the violation itself:
    ``"eq. 9, torque limit, 3.2 at node 4 of interval 2"``.
    """
    scaled = program.violations(point)
    found = []
    for block in program.rows or (Block("row", "", 0, program.row_count),):
        if block.size:
            entry = int(scaled[block.slice].argmax())
            worst = float(scaled[block.start + entry])
            if worst > 0:
                off = worst * float(program.row_scale[block.start + entry])
                words = [f"{off:.3g}", block.unit, block.place(entry)]
                found.append((worst, f"{block.title}, {' '.join(w for w in words if w)}"))
    found.sort(key=lambda one: -one[0])
    return "; ".join(text for _, text in found[:count])
