"""Export of cones to CVXPY, and their multipliers from its solution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .cones import ConeBlock, ConeKind, symmetric, triangle

if TYPE_CHECKING:
    import cvxpy

__all__ = ["cvxpy_cone_duals", "cvxpy_cones"]

Vector = NDArray[np.float64]


def cvxpy_cones(
    problem: cvxpy.Problem,
    x: cvxpy.Variable,
    matrix: sp.csr_array,
    offset: Vector,
    cones: Sequence[ConeBlock],
) -> cvxpy.Problem:
    """Return `problem` with ``matrix @ x + offset`` in `cones` appended to its constraints."""
    import cvxpy

    cp: Any = cvxpy  # its functions have no types
    added: list[Any] = []
    for block in cones:
        vector = matrix[block.slice] @ x + offset[block.slice]
        rows = cp.reshape(vector, (block.count, block.dimension), order="C")
        if block.kind == ConeKind.SECOND_ORDER:
            added.append(cp.SOC(rows[:, 0], rows[:, 1:], axis=1))
        elif block.kind == ConeKind.EXPONENTIAL:
            added.append(cp.ExpCone(rows[:, 0], rows[:, 1], rows[:, 2]))
        else:
            # One column per entry of the triangle: the symmetric matrix of that entry.
            unit = symmetric(np.eye(block.dimension))
            n = unit.shape[1]
            spread = sp.csr_array(unit.reshape(block.dimension, n * n))
            matrices = (spread.T @ rows[row] for row in range(block.count))
            added += [cp.PSD(cp.reshape(entries, (n, n), order="C")) for entries in matrices]
    joined: cvxpy.Problem = cp.Problem(problem.objective, [*problem.constraints, *added])
    return joined


def cvxpy_cone_duals(problem: cvxpy.Problem, cones: Sequence[ConeBlock]) -> Vector:
    """Return the multipliers of the cone rows from the last constraints of :func:`cvxpy_cones`.

    Multipliers that CVXPY does not return are 0.
    """
    counts = [b.count if b.kind == ConeKind.SEMIDEFINITE else 1 for b in cones]
    constraints: Any = iter(problem.constraints[len(problem.constraints) - sum(counts) :])
    result = [np.zeros(0)]
    for block, count in zip(cones, counts, strict=True):
        values = [next(constraints).dual_value for _ in range(count)]
        if any(value is None or any(part is None for part in value) for value in values):
            result.append(np.zeros(block.size))
        elif block.kind == ConeKind.SEMIDEFINITE:
            result.append(triangle(np.array(values, float)).ravel())
        elif block.kind == ConeKind.SECOND_ORDER:
            head, tail = (np.asarray(part, float) for part in values[0])
            stacked = [head.reshape(-1, 1), tail.reshape(block.count, block.dimension - 1)]
            result.append(np.hstack(stacked).ravel())
        else:
            result.append(np.column_stack([np.ravel(part) for part in values[0]]).ravel())
    return np.concatenate(result)
