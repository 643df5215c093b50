"""Quality of a point of a nonlinear program: feasibility, multipliers, and curvature."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.programs.blocks import Block
from ...models.programs.nonlinear import NonlinearProgram

__all__ = [
    "Quality",
    "descent_by_curvature",
    "estimated_duals",
    "explained_duals",
    "measure",
    "worst_blocks",
]

Vector = NDArray[np.float64]

#: Distance from a bound below which it binds, relative to the bound and the typical size.
REACH = 1e-6
#: Product of multiplier and slack, relative to the objective, that interior-point methods leave.
COMPLEMENTARITY = 1e-6
#: Weight that makes the least-squares problem solvable if rows are linearly dependent.
DAMPING = 1e-10
#: Largest number of rounds that remove multipliers of the wrong sign.
ROUNDS = 8
#: Relative distance from a bound below which it binds, even weakly.
WEAKLY = 1e-5
#: Number of Lanczos steps. The smallest Ritz value is never below the smallest eigenvalue, so that a
#: negative one proves a direction of descent after any number of steps.
STEPS = 60
#: Smallest magnitude of a negative curvature, relative to the largest entry of the Hessian.
NEGATIVE = 1e-4
#: Length of a new direction, relative to the curvatures, below which the space is exhausted.
EXHAUSTED = 1e-7
#: Weight that makes the projection solvable if rows are linearly dependent.
DAMPED = 1e-11


@dataclass(frozen=True, eq=False)
class Quality:
    """Measured quality of a point.

    `point` is within the column bounds. `feasible` states whether rows and columns hold within the
    tolerance, and `infeasibility` is the largest violation of a row, in units of its typical size. `duals`
    are the row multipliers of binding rows, with the correct signs. `stationarity` is the largest reduced cost
    that no bound explains, relative to 1 and to the gradient of the objective.
    """

    point: Vector
    objective: float
    feasible: bool
    infeasibility: float
    duals: Vector
    stationarity: float


def measure(
    program: NonlinearProgram,
    point: Vector | None,
    duals: Vector | None,
    tolerance: float,
    enough: float,
) -> Quality | None:
    """Return the quality of `point`, clipped to the column bounds; None if it cannot be evaluated.

    Multipliers that are missing, or leave a stationarity larger than `enough`, are replaced by a
    least-squares estimate.
    """
    if point is None:
        return None
    x = np.clip(np.asarray(point, float), program.column_lower, program.column_upper)
    try:
        verification = program.verify(x, tolerance=tolerance)
        violation = float(program.violations(x).max(initial=0.0))
    except (InvalidData, RuntimeError):
        return None
    objective = verification.objective
    feasible = verification.ok and objective is not None
    no_duals = np.zeros(program.row_count)
    if not feasible or objective is None:
        value = np.nan if objective is None else objective
        return Quality(x, value, False, violation, no_duals, np.inf)
    best, smallest = no_duals, np.inf
    given = duals is not None and duals.shape == no_duals.shape and bool(np.isfinite(duals).all())
    if given and duals is not None:
        best = explained_duals(program, x, duals, objective)
        smallest = _stationarity(program, x, best, objective)
    estimate = None if smallest <= enough else estimated_duals(program, x)
    if estimate is not None:
        stationarity = _stationarity(program, x, estimate, objective)
        if stationarity < smallest or not np.isfinite(smallest):
            best, smallest = estimate, stationarity
    return Quality(x, objective, True, violation, best, smallest)


def _stationarity(
    program: NonlinearProgram, point: Vector, duals: Vector, objective: float
) -> float:
    """Return the relative stationarity, without the reduced costs that an interior point leaves.

    Such a point keeps a distance from binding bounds, so only its product with the reduced cost must
    be small. Rounding errors of the multipliers are added: with linearly dependent rows, cancelling
    multipliers of 1e14 explained any gradient.
    """
    gradient, jacobian = program.linearised(point)
    reduced = gradient - jacobian.T @ duals
    gradient = gradient * program.column_scale / program.objective_scale
    if not (np.isfinite(gradient).all() and np.isfinite(reduced).all()):
        return float("inf")
    slack = np.where(reduced > 0, point - program.column_lower, program.column_upper - point)
    with np.errstate(invalid="ignore"):
        unexplained = ~(np.abs(reduced) * slack <= _idle(program, objective))
    remaining = np.abs(reduced) * program.column_scale / program.objective_scale
    largest = min(
        program.stationarity(point, duals, reduced), float(remaining[unexplained].max(initial=0.0))
    )
    rounded = np.abs(jacobian).T @ np.abs(duals) * np.finfo(float).eps
    rounded *= program.column_scale / program.objective_scale
    largest += float(rounded.max(initial=0.0))
    return largest / max(1.0, float(np.abs(gradient).max(initial=0.0)))


def _idle(program: NonlinearProgram, objective: float) -> float:
    return COMPLEMENTARITY * max(program.objective_scale, abs(objective))


def _near(program: NonlinearProgram, rows: Vector) -> tuple[Vector, Vector, Vector]:
    """Return the slack of each row to its lower and upper bound, and the largest slack of a binding row."""
    reach = REACH * np.maximum(program.row_scale, np.abs(rows))
    return rows - program.row_lower, program.row_upper - rows, reach


def explained_duals(
    program: NonlinearProgram, point: Vector, duals: Vector, objective: float
) -> Vector:
    """Return `duals` with 0 for multipliers that no binding row explains, by sign or by slack."""
    above, below, reach = _near(program, program.values(point)[1])
    slack = np.where(duals > 0, above, below)
    with np.errstate(invalid="ignore"):
        small = np.abs(duals) * slack <= _idle(program, objective)
    result: Vector = np.where((slack <= reach) | small, duals, 0.0)
    return result


def estimated_duals(program: NonlinearProgram, point: Vector) -> Vector | None:
    """Return the multipliers with the smallest sum of squared reduced costs; None if there are none.

    Multipliers of rows that do not bind are 0, and those of the wrong sign are removed.
    """
    scale, weight = program.column_scale, program.objective_scale
    gradient, jacobian = program.linearised(point)
    gradient = gradient * scale / weight
    jacobian = sp.csc_array(
        sp.diags_array(1.0 / program.row_scale) @ jacobian @ sp.diags_array(scale)
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


def _augmented_factors(rows: sp.csc_array, damping: float) -> Any:
    """Return the factors of ``[[I, rows.T], [rows, -damping I]]``; None if it is singular all the same."""
    from scipy.sparse.linalg import splu

    damped = -damping * sp.eye_array(rows.shape[0])
    blocks = [[sp.eye_array(rows.shape[1]), rows.T], [rows, damped]]
    try:
        return splu(sp.block_array(blocks, format="csc"), permc_spec="MMD_AT_PLUS_A")
    except RuntimeError:
        return None


def _least_squares(matrix: sp.csc_array, right: Vector) -> Vector | None:
    """Return the y that minimises ``|right - matrix.T @ y|``, by the sparse augmented system."""
    rows, columns = matrix.shape
    factors = _augmented_factors(matrix, DAMPING)
    if factors is None:
        return None
    solution: Vector = factors.solve(np.concatenate([right, np.zeros(rows)]))[columns:]
    return solution if np.isfinite(solution).all() else None


def descent_by_curvature(program: NonlinearProgram, point: Vector, duals: Vector) -> Vector | None:
    """Return a direction along which the objective decreases on both sides; None if none is found.

    The Hessian of the Lagrangian is projected onto the directions that binding rows and bounds permit, and its
    smallest eigenvalue approximated by Lanczos' method with full orthogonalisation (Golub and Van Loan, "Matrix
    Computations", section 10.1). The direction is scaled to a largest entry of 1 in column sizes.
    """
    scale = program.column_scale
    slack = np.minimum(point - program.column_lower, program.column_upper - point)
    free = np.flatnonzero(slack > WEAKLY * np.maximum(scale, np.abs(point)))
    rows = program.values(point)[1]
    slack = np.minimum(rows - program.row_lower, program.row_upper - rows)
    binding = np.flatnonzero(slack <= WEAKLY * np.maximum(program.row_scale, np.abs(rows)))
    upper = sp.csc_array(program.second_order(point, 1.0, -duals).sparse())
    weights = scale[free] / program.objective_scale
    whole = sp.csc_array(upper + sp.triu(upper, 1).T)[free][:, free]
    curved = sp.diags_array(weights) @ whole @ sp.diags_array(scale[free])
    table = sp.diags_array(1.0 / program.row_scale[binding]) @ program.jacobian(point)[binding]
    table = sp.csc_array(table)[:, free] @ sp.diags_array(scale[free])
    size = free.size
    if not size or not (np.isfinite(curved.data).all() and np.isfinite(table.data).all()):
        return None
    factors = _augmented_factors(table, DAMPED)
    if factors is None:
        return None
    below = np.zeros(binding.size)

    def project(v: Vector) -> Vector:
        projected: Vector = factors.solve(np.append(v, below))[:size]
        return projected

    vector, curvature = _least_curvature(lambda v: curved @ v, project, size)
    if vector is None or not curvature < -NEGATIVE * np.abs(curved.data).max(initial=0.0):
        return None
    direction = np.zeros(program.size)
    direction[free] = vector * scale[free]
    result: Vector = direction / np.abs(direction / scale).max()
    return result


def _least_curvature(
    apply: Callable[[Vector], Vector], project: Callable[[Vector], Vector], size: int
) -> tuple[Vector | None, float]:
    """Return a vector of smallest curvature in the range of `project`, and its curvature."""
    basis = np.empty((min(STEPS, size), size))
    v = project(np.random.default_rng(0).normal(size=size))
    diagonal: list[float] = []
    off_diagonal: list[float] = []
    for k in range(len(basis)):
        length = float(np.linalg.norm(v))
        if not length > EXHAUSTED * (max(map(abs, diagonal)) if k else np.sqrt(size)):
            break
        off_diagonal.append(length)
        basis[k] = v / length
        v = apply(basis[k])
        diagonal.append(float(v @ basis[k]))
        for _ in range(2):
            # The projection is repeated, because division by a small length amplifies rounding errors.
            v = project(v - basis[: k + 1].T @ (basis[: k + 1] @ v))
    if not diagonal:
        return None, 0.0
    vectors = scipy.linalg.eigh_tridiagonal(diagonal, off_diagonal[1:])[1]
    vector = project(basis[: len(diagonal)].T @ vectors[:, 0])
    # The curvature of the computed vector, not the Ritz value.
    return vector, float(vector @ apply(vector)) / float(vector @ vector)


def worst_blocks(program: NonlinearProgram, point: Vector, count: int = 4) -> str:
    """Return the `count` row blocks with the largest violations, as text with the paper's terms.

    They are sorted by the violation in units of the typical size. The number is the violation itself,
    such as ``"eq. 9, torque limit, 3.2 at node 4 of interval 2"``.
    """
    scaled = program.violations(point)
    entries = []
    for block in program.rows or (Block("row", "", 0, program.row_count),):
        if block.size:
            entry = int(scaled[block.slice].argmax())
            worst = float(scaled[block.start + entry])
            if worst > 0:
                off = worst * float(program.row_scale[block.start + entry])
                words = [f"{off:.3g}", block.unit, block.place(entry)]
                entries.append((worst, f"{block.title}, {' '.join(w for w in words if w)}"))
    entries.sort(key=lambda entry: -entry[0])
    return "; ".join(text for _, text in entries[:count])
