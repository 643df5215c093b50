"""The cones of a program written for CVXPY, and the way back from CVXPY's multipliers."""

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
    """Return `problem` with ``matrix @ x + offset`` in `cones`, after its own constraints."""
    import cvxpy

    made: Any = cvxpy  # its functions are not typed
    added: list[Any] = []
    for block in cones:
        rows = made.reshape(
            matrix[block.slice] @ x + offset[block.slice],
            (block.count, block.dimension),
            order="C",
        )
        if block.kind == ConeKind.SECOND_ORDER:
            added.append(made.SOC(rows[:, 0], rows[:, 1:], axis=1))
        elif block.kind == ConeKind.EXPONENTIAL:
            added.append(made.ExpCone(rows[:, 0], rows[:, 1], rows[:, 2]))
        else:
            # One column for every entry of the triangle: the matrix that it stands for.
            unit = symmetric(np.eye(block.dimension))
            n = unit.shape[1]
            spread = sp.csr_array(unit.reshape(block.dimension, n * n))
            added += [
                made.PSD(made.reshape(spread.T @ rows[at], (n, n), order="C"))
                for at in range(block.count)
            ]
    joined: cvxpy.Problem = made.Problem(problem.objective, [*problem.constraints, *added])
    return joined


def cvxpy_cone_duals(problem: cvxpy.Problem, cones: Sequence[ConeBlock]) -> Vector:
    """Return the multipliers of the cone rows, from the last constraints of :func:`cvxpy_cones`.

    Multipliers that CVXPY does not give are 0.
    """
    counts = [b.count if b.kind == ConeKind.SEMIDEFINITE else 1 for b in cones]
    constraints: Any = iter(problem.constraints[len(problem.constraints) - sum(counts) :])
    found = [np.zeros(0)]
    for block, count in zip(cones, counts, strict=True):
        values = [next(constraints).dual_value for _ in range(count)]
        if any(value is None or any(part is None for part in value) for value in values):
            found.append(np.zeros(block.size))
        elif block.kind == ConeKind.SEMIDEFINITE:
            found.append(triangle(np.array(values, float)).ravel())
        elif block.kind == ConeKind.SECOND_ORDER:
            head, tail = (np.asarray(part, float) for part in values[0])
            stacked = [head.reshape(-1, 1), tail.reshape(block.count, block.dimension - 1)]
            found.append(np.hstack(stacked).ravel())
        else:
            found.append(np.column_stack([np.ravel(part) for part in values[0]]).ravel())
    return np.concatenate(found)
