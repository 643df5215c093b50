"""Conformance cases: a quadratic program that takes a while, for limits, stops and warm starts."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.linear import QuadraticProgram
from ..backend import Termination
from .cases import Case, Expectation, optimum
from .limits import timed_cases
from .quadratic_larger import certified

__all__ = ["quadratic_limit_cases"]

#: Columns and rows: dense, so that a fraction of a second is not enough for most solvers.
SIZE, ROWS = 400, 200
#: The same of what every solver shall finish.
SMALL = 60, 30


def quadratic_limit_cases() -> tuple[Case, ...]:
    """Return the cases."""
    program, start = _dense(SIZE, ROWS)
    small, solution = _dense(*SMALL)
    best = program.objective(start)
    cut = Expectation((Termination.FEASIBLE, Termination.NO_SOLUTION), best_known=best, floor=best)
    begun = replace(cut, termination=(Termination.OPTIMAL, *cut.termination), through=True)
    return (
        *timed_cases("quadratic, ", program, begun, cut, start, seconds=0.2, stop_after=0.1),
        Case(
            "quadratic: dense",
            small,
            optimum(small.objective(solution)),
        ),
    )


@functools.cache
def _dense(size: int, rows: int) -> tuple[QuadraticProgram, NDArray[np.float64]]:
    """Return a dense program with its optimum; its data are sines, which no library can change."""
    k, row = np.arange(size), np.arange(rows)[:, None]
    root = np.sin(1.0 + (k[:, None] * 7919 + k[None, : size // 2] * 104729) % 10007)
    hessian = root @ root.T + np.eye(size)
    hessian = (hessian + hessian.T) / 2
    matrix = np.sin(2.0 + (row * 611953 + k[None, :] * 1299709) % 10009)
    point = np.round(np.sin(3.0 + k * 31 % 1009), 3)
    duals = np.where(row[:, 0] % 2 == 0, np.sin(5.0 + row[:, 0] * 37 % 1013), 0.0)
    reduced = np.where(k % 3 == 0, np.sin(4.0 + k * 41 % 1019), 0.0)
    program = certified(hessian, sp.csr_array(matrix), point, duals, reduced, room=0.5)
    return program, point
