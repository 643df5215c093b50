"""Conformance cases: a conic program that takes a while, for limits, stops and warm starts."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.cones import ConeBlock, ConeKind
from ...models.programs.conic import ConicProgram
from ..backend import Termination
from .cases import Case, Expectation, optimum
from .limits import timed_cases

__all__ = ["conic_limit_cases"]

#: Columns, cones, and rows of a cone: dense, so that most solvers need more than a fraction of a
#: second.
SIZE, COUNT, DIMENSION = 160, 40, 16
#: The same of what every solver shall finish.
SMALL = 24, 6, 8


def conic_limit_cases() -> tuple[Case, ...]:
    """Return the cases."""
    program, start = _dense(SIZE, COUNT, DIMENSION)
    small, solution = _dense(*SMALL)
    best = program.objective(start)
    cut = Expectation((Termination.FEASIBLE, Termination.NO_SOLUTION), best_known=best, floor=best)
    begun = replace(cut, termination=(Termination.OPTIMAL, *cut.termination), through=True)
    return (
        *timed_cases("conic, ", program, begun, cut, start, seconds=0.2, stop_after=0.1),
        Case("conic: dense", small, optimum(small.objective(solution))),
    )


@functools.cache
def _dense(size: int, count: int, dimension: int) -> tuple[ConicProgram, NDArray[np.float64]]:
    """Return a dense program with its optimum; its data are sines, which no library can change.

    Every other cone binds at the optimum, with multipliers that cancel the rows: ``(r, y)`` and
    ``(r, -y)`` with ``r = |y|``.
    """
    row, column = np.arange(count * dimension)[:, None], np.arange(size)[None, :]
    matrix = np.sin(2.0 + (row * 611953 + column * 1299709) % 10009)
    point = np.round(np.sin(3.0 + np.arange(size) * 31 % 1009), 3)
    tail = np.sin(4.0 + row.reshape(count, dimension)[:, 1:] * 37 % 1013)
    radius = np.linalg.norm(tail, axis=1, keepdims=True)
    binds = (np.arange(count) % 2 == 0)[:, None]
    slack = np.hstack([np.where(binds, radius, radius + 1.0), tail])
    duals = np.where(binds, np.hstack([radius, -tail]), 0.0).ravel()
    program = ConicProgram(
        cost=matrix.T @ duals,
        cone_matrix=sp.csr_array(matrix),
        cone_offset=slack.ravel() - matrix @ point,
        cones=(
            ConeBlock(
                "cones", "", 0, count * dimension, kind=ConeKind.SECOND_ORDER, dimension=dimension
            ),
        ),
        column_lower=np.full(size, -2.0),
        column_upper=np.full(size, 2.0),
    )
    return program, point
