"""Whether a stationary point is a minimum: the curvature along what its constraints leave free."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.nonlinear import NonlinearProgram

__all__ = ["descent_by_curvature"]

Vector = NDArray[np.float64]

#: How near a bound, in terms of its size, counts as at it: what binds, however weakly, is held.
REACH = 1e-5
#: Steps of Lanczos' method. Its least value is never below the least eigenvalue: a negative one proves
#: a direction of descent, after however many steps.
STEPS = 60
#: Share of the largest entry of the Hessian from which negative curvature counts.
NEGATIVE = 1e-4
#: Length of a new direction, in terms of the curvatures, at which all directions have been tried.
EXHAUSTED = 1e-7
#: Weight that makes the projection solvable where rows depend on one another.
DAMPING = 1e-11


def descent_by_curvature(program: NonlinearProgram, point: Vector, duals: Vector) -> Vector | None:
    """Return a direction along which the objective falls to both sides, None where none is found.

    The Hessian of the Lagrangian is projected onto the directions that rows and bounds which bind at
    the point leave free, and its least eigenvalue approached by Lanczos' method with full
    orthogonalisation (Golub and Van Loan, "Matrix Computations", section 10.1).

    Parameters
    ----------
    program : NonlinearProgram
        The program.
    point : ndarray, shape (n,)
        A stationary point.
    duals : ndarray, shape (m,)
        Its row multipliers.

    Returns
    -------
    ndarray, shape (n,), or None
        In terms of the columns; its largest entry is 1 in terms of their sizes.
    """
    from scipy.sparse.linalg import splu

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
    blocks = [[sp.eye_array(size), table.T], [table, -DAMPING * sp.eye_array(binding.size)]]
    try:
        factors = splu(sp.block_array(blocks, format="csc"))
    except RuntimeError:  # singular after all
        return None
    below = np.zeros(binding.size)

    def project(v: Vector) -> Vector:
        found: Vector = factors.solve(np.append(v, below))[:size]
        return found

    found, bent = _least(lambda v: project(curved @ v), project, size)
    if found is None or not bent < -NEGATIVE * np.abs(curved.data).max(initial=0.0):
        return None
    direction = np.zeros(program.size)
    direction[free] = found * scale[free]
    result: Vector = direction / np.abs(direction / scale).max()
    return result


def _least(
    apply: Callable[[Vector], Vector], project: Callable[[Vector], Vector], size: int
) -> tuple[Vector | None, float]:
    """Return a vector of the least curvature in the range of `project`, and that; None without any."""
    basis = np.empty((min(STEPS, size), size))
    v = project(np.random.default_rng(0).normal(size=size))
    diagonal: list[float] = []
    beside: list[float] = []
    for k in range(len(basis)):
        length = float(np.linalg.norm(v))
        if not length > EXHAUSTED * (max(map(abs, diagonal)) if k else np.sqrt(size)):
            break
        beside.append(length)
        basis[k] = v / length
        v = apply(basis[k])
        diagonal.append(float(v @ basis[k]))
        for _ in range(2):
            # Divided by small lengths, what rounding leaves outside the range would grow.
            v = project(v - basis[: k + 1].T @ (basis[: k + 1] @ v))
    if not diagonal:
        return None, 0.0
    vectors = scipy.linalg.eigh_tridiagonal(diagonal, beside[1:])[1]
    found = project(basis[: len(diagonal)].T @ vectors[:, 0])
    # What rounding made of it counts, not what it should be.
    return found, float(found @ apply(found)) / float(found @ found)
