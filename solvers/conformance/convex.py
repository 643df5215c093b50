"""Larger convex programs whose data are constructed from a known optimum."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.cones import ConeBlock, ConeKind
from ...models.programs.conic import ConicProgram
from ...models.programs.linear import QuadraticProgram
from ..contract.backend import Termination
from .cases import Case, optimum
from .limits import numbers, timed_cases

__all__ = ["certified", "conic_limit_cases", "horizon", "portfolio", "quadratic_limit_cases"]

INF = np.inf

Vector = NDArray[np.float64]
Posed = tuple[QuadraticProgram | ConicProgram, Vector]


def certified(
    hessian: Any, matrix: Any, point: Vector, duals: Vector, reduced: Vector, room: float = 1.0
) -> QuadraticProgram:
    """Return a program with a given optimal point, multipliers of rows and reduced costs.

    Bounds with a multiplier are at the point, the others at the distance `room` from it. The cost makes the gradient
    of the Lagrangian vanish.
    """
    value = matrix @ point

    def bounds(centre: Vector, pull: Vector) -> tuple[Vector, Vector]:
        return np.where(pull > 0, centre, centre - room), np.where(pull < 0, centre, centre + room)

    row_lower, row_upper = bounds(value, duals)
    column_lower, column_upper = bounds(point, reduced)
    return QuadraticProgram(
        hessian=sp.csr_array(hessian),
        cost=matrix.T @ duals + reduced - hessian @ point,
        matrix=sp.csr_array(matrix),
        row_lower=row_lower,
        row_upper=row_upper,
        column_lower=column_lower,
        column_upper=column_upper,
    )


def _drawn(count: int, seed: int) -> Vector:
    draw = numbers(seed)
    return np.array([next(draw) % 20001 / 10000 - 1 for _ in range(count)])


def portfolio() -> tuple[QuadraticProgram, Vector, Vector]:
    """Return a portfolio of 200 assets under ten risk factors with its optimum and multipliers.

    The shares sum to one, and those of each sector are limited.
    """
    size, factors, sectors = 200, 10, 8
    loads = _drawn(size * factors, 1).reshape(size, factors)
    hessian = loads @ loads.T + np.diag(0.05 + 0.05 * np.abs(_drawn(size, 2)))
    matrix = np.vstack(
        [np.ones(size), np.arange(size)[None, :] % sectors == np.arange(sectors)[:, None]]
    ).astype(float)
    chosen = np.arange(size) % 5 == 0
    point = np.where(chosen, 0.01 + 0.01 * np.abs(_drawn(size, 3)), 0.0)
    # Assets outside the portfolio cost more than they yield; two sectors are at their limits.
    reduced = np.where(chosen, 0.0, 0.1 + np.abs(_drawn(size, 4)))
    duals = np.zeros(1 + sectors)
    duals[0], duals[1], duals[5] = 0.7, -0.3, 0.4
    program = certified(hessian, sp.csr_array(matrix), point, duals, reduced)
    total = matrix[0] @ point
    lower, upper = program.row_lower.copy(), program.row_upper.copy()
    lower[0] = upper[0] = total
    return replace(program, row_lower=lower, row_upper=upper), point, duals


def horizon() -> tuple[QuadraticProgram, Vector, Vector]:
    """Return forty steps of a double integrator with its optimum and multipliers.

    Each step has two states and one control, with bounds on both.
    """
    steps, each = 40, 3
    step = 0.1
    size = steps * each
    matrix = sp.lil_array((2 * steps, size))
    for k in range(steps):
        for row, terms in enumerate(
            (((1, 0, 1.0), (0, 0, -1.0), (0, 1, -step)), ((1, 1, 1.0), (0, 1, -1.0), (0, 2, -step)))
        ):
            for later, entry, value in terms:
                # The columns of step k are its control and the next state.
                column = (k + later - 1) * each + entry if entry < 2 else k * each + 2
                if column >= 0:
                    matrix[2 * k + row, column] = value
    rows = sp.csr_array(matrix)
    hessian = sp.diags_array(np.tile([1.0, 0.1, 0.01], steps))
    control = np.clip(3 * _drawn(steps, 5), -1, 1)
    point = np.zeros(size)
    position, speed = 1.0, 0.0
    start = (position + step * speed, speed)
    for k in range(steps):
        position, speed = position + step * speed, speed + step * control[k]
        point[k * each : k * each + 3] = position, speed, control[k]
    duals = 0.1 * _drawn(2 * steps, 6)
    reduced = np.zeros(size)
    pull = 0.05 + 0.05 * np.abs(_drawn(steps, 7))
    reduced[2::each] = np.where(control >= 1, -pull, np.where(control <= -1, pull, 0.0))
    program = certified(hessian, rows, point, duals, reduced, room=0.5)
    value = rows @ point
    value[:2] = start
    lower, upper = np.full(size, -INF), np.full(size, INF)
    lower[2::each], upper[2::each] = -1.0, 1.0
    fixed = replace(
        program, row_lower=value, row_upper=value, column_lower=lower, column_upper=upper
    )
    return fixed, point, duals


def quadratic_limit_cases() -> tuple[Case, ...]:
    """Return the cases. Columns and rows are dense, so that most solvers need some time."""
    return _cases("quadratic", _quadratic(400, 200), _quadratic(60, 30))


def conic_limit_cases() -> tuple[Case, ...]:
    """Return the cases. Columns, cones and the rows of a cone are dense."""
    return _cases("conic", _conic(240, 60, 16), _conic(24, 6, 8))


def _cases(kind: str, large: Posed, small: Posed) -> tuple[Case, ...]:
    """Return the cases of a program that takes some time and of one that every solver must finish."""
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


def _quadratic(size: int, rows: int) -> tuple[QuadraticProgram, Vector]:
    """Return a dense program with its optimum. Its data are sines, independent of library versions."""
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


def _conic(size: int, count: int, dimension: int) -> tuple[ConicProgram, Vector]:
    """Return a dense program with its optimum. Its data are sines, independent of library versions.

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
