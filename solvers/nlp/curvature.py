"""Second-order test of a stationary point: curvature along the directions that constraints permit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.nonlinear import NonlinearProgram

__all__ = ["augmented_factors", "descent_by_curvature"]

Vector = NDArray[np.float64]

#: Relative distance from a bound below which it binds, even weakly.
REACH = 1e-5
#: Number of Lanczos steps. The smallest Ritz value is never below the smallest eigenvalue, so that a
#: negative one proves a direction of descent after any number of steps.
STEPS = 60
#: Smallest magnitude of a negative curvature, relative to the largest entry of the Hessian.
NEGATIVE = 1e-4
#: Length of a new direction, relative to the curvatures, below which the space is exhausted.
EXHAUSTED = 1e-7
#: Weight that makes the projection solvable if rows are linearly dependent.
DAMPING = 1e-11


def augmented_factors(rows: sp.csc_array, damping: float) -> Any:
    """Return the factors of ``[[I, rows.T], [rows, -damping I]]``; None if it is singular all the same."""
    from scipy.sparse.linalg import splu

    damped = -damping * sp.eye_array(rows.shape[0])
    blocks = [[sp.eye_array(rows.shape[1]), rows.T], [rows, damped]]
    try:
        return splu(sp.block_array(blocks, format="csc"))
    except RuntimeError:
        return None


def descent_by_curvature(program: NonlinearProgram, point: Vector, duals: Vector) -> Vector | None:
    """Return a direction along which the objective decreases on both sides; None if none is found.

    The Hessian of the Lagrangian is projected onto the directions that the binding rows and bounds
    permit. Its smallest eigenvalue is approximated by Lanczos' method with full orthogonalisation
    (Golub and Van Loan, "Matrix Computations", section 10.1). The direction is scaled to a largest
    entry of 1 in column sizes.
    """
    scale = program.column_scale
    slack = np.minimum(point - program.column_lower, program.column_upper - point)
    free = np.flatnonzero(slack > REACH * np.maximum(scale, np.abs(point)))
    rows = program.values(point)[1]
    slack = np.minimum(rows - program.row_lower, program.row_upper - rows)
    binding = np.flatnonzero(slack <= REACH * np.maximum(program.row_scale, np.abs(rows)))
    upper = sp.csc_array(program.second_order(point, 1.0, -duals).sparse())
    weights = scale[free] / program.objective_scale
    whole = sp.csc_array(upper + sp.triu(upper, 1).T)[free][:, free]
    curved = sp.diags_array(weights) @ whole @ sp.diags_array(scale[free])
    table = sp.diags_array(1.0 / program.row_scale[binding]) @ program.jacobian(point)[binding]
    table = sp.csc_array(table)[:, free] @ sp.diags_array(scale[free])
    size = free.size
    if not size or not (np.isfinite(curved.data).all() and np.isfinite(table.data).all()):
        return None
    factors = augmented_factors(table, DAMPING)
    if factors is None:
        return None
    below = np.zeros(binding.size)

    def project(v: Vector) -> Vector:
        projected: Vector = factors.solve(np.append(v, below))[:size]
        return projected

    vector, curvature = _least_curvature(lambda v: project(curved @ v), project, size)
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
