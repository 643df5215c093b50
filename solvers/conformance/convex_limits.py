"""Conformance cases: convex programs that take a while, for limits, stops and warm starts."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.cones import ConeBlock, ConeKind
from ...models.programs.conic import ConicProgram
from ...models.programs.linear import QuadraticProgram
from ..backend import Termination
from .cases import Case, optimum
from .limits import timed_cases
from .quadratic_larger import certified

__all__ = ["conic_limit_cases", "quadratic_limit_cases"]

Posed = tuple[QuadraticProgram | ConicProgram, NDArray[np.float64]]


def quadratic_limit_cases() -> tuple[Case, ...]:
    """Return the cases; columns and rows are dense, so that most solvers need more than a moment."""
    return _cases("quadratic", _quadratic(400, 200), _quadratic(60, 30))


def conic_limit_cases() -> tuple[Case, ...]:
    """Return the cases; columns, cones, and rows of a cone are dense as well."""
    return _cases("conic", _conic(160, 40, 16), _conic(24, 6, 8))


def _cases(kind: str, large: Posed, small: Posed) -> tuple[Case, ...]:
    """Return the cases of a program that takes a while and of one that every solver shall finish."""
    program, start = large
    best = program.objective(start)
    timed = timed_cases(
        f"{kind}, ",
        program,
        start,
        (Termination.OPTIMAL,),
        best_known=best,
        floor=best,
        seconds=0.2,
        stop_after=0.1,
    )
    finished, solution = small
    return (*timed, Case(f"{kind}: dense", finished, optimum(finished.objective(solution))))


def _quadratic(size: int, rows: int) -> tuple[QuadraticProgram, NDArray[np.float64]]:
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


def _conic(size: int, count: int, dimension: int) -> tuple[ConicProgram, NDArray[np.float64]]:
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
