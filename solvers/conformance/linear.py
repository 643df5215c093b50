"""Conformance cases: linear programs with known optimum, point and multipliers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from ...models.programs.linear import MixedIntegerProgram
from .cases import Case, Table, bounds, optimum, tabled, unsolvable

__all__ = ["linear_cases", "program"]

INF = np.inf


def program(
    cost: Sequence[float],
    matrix: ArrayLike,
    row_lower: ArrayLike = -INF,
    row_upper: ArrayLike = INF,
    *,
    lower: ArrayLike = 0.0,
    upper: ArrayLike = INF,
    integral: ArrayLike = False,
    offset: float = 0.0,
) -> MixedIntegerProgram:
    """Return a program from dense data, with scalar bounds and kinds broadcast."""
    costs = np.asarray(cost, float)
    rows = np.asarray(matrix, float).reshape(-1, costs.size) if costs.size else np.asarray(matrix)

    return MixedIntegerProgram(
        cost=costs,
        matrix=sp.csr_array(rows),
        **bounds(rows.shape[0], rows.shape[1], row_lower, row_upper, lower, upper),
        integral=np.broadcast_to(np.asarray(integral, bool), costs.shape),
        offset=offset,
    )


def linear_cases() -> tuple[Case, ...]:
    """Return the cases. The multipliers of solvable programs are judged as well."""
    return (*tabled("linear: ", _solvable(), duals=True), *_unsolvable())


def _solvable() -> Table:
    return {
        "unique primal and dual": (
            program([-3, -5], [[1, 0], [0, 2], [3, 2]], row_upper=[4, 12, 18]),
            optimum(-36, (2, 6), (0, -1.5, -1)),
        ),
        "lower rows bind": (
            program([2, 3], [[1, 1], [1, 3]], row_lower=[4, 6]),
            optimum(9, (3, 1), (1.5, 0.5)),
        ),
        "degenerate vertex": (
            program([-1, -1], [[1, 0], [0, 1], [1, 1], [2, 1]], row_upper=[1, 1, 2, 3]),
            optimum(-2, (1, 1)),
        ),
        "many optimal points": (
            program([-1, -1], [[1, 1]], row_upper=[5], upper=[4, 4]),
            optimum(-5, None, (-1,)),
        ),
        "free columns and ranges": (
            program([1, 2], [[1, 1], [1, -1]], [-1, 0], [3, 4], lower=-INF),
            optimum(-3.5, (1.5, -2.5), (1.5, -0.5)),
        ),
        "equality system, free columns": (
            program([1, 1], [[2, 1], [1, -1]], [5, 1], [5, 1], lower=-INF),
            optimum(3, (2, 1), (2 / 3, -1 / 3)),
        ),
        "redundant equalities": (
            program([1, 2], [[1, 1], [2, 2]], [3, 6], [3, 6]),
            optimum(3, (3, 0)),
        ),
        "fixed column": (
            program([1, 1], [[1, 1]], row_lower=[5], lower=[3, 0], upper=[3, INF]),
            optimum(5, (3, 2), (1,)),
        ),
        "empty and free rows": (
            program([1, 1], [[0, 0], [1, 1], [1, 2], [0, 0]], [-1, -INF, 4, 0], [1, INF, INF, 0]),
            optimum(2, (0, 2)),
        ),
        "column outside all rows": (
            program([1, -1, 0], [[1, 0, 0]], row_lower=[2], upper=[INF, 7, INF]),
            optimum(-5),
        ),
        "no rows, offset": (
            program([1, -1], np.zeros((0, 2)), lower=[-1, 0], upper=[2, 4], offset=10),
            optimum(5, (-1, 4), ()),
        ),
        "upper bounds below zero": (
            program([-1, 2], [[1, 1]], row_lower=[-12], lower=-INF, upper=[-3, -2]),
            optimum(-15, (-3, -9), (2,)),
        ),
        "empty objective": (program([0, 0], [[1, 1]], [1], [2], offset=7), optimum(7)),
        "large offset": (
            program([1, 1], [[1, 2]], row_lower=[4], offset=-1e6),
            optimum(-999998, (0, 2), (0.5,)),
        ),
        "badly scaled": (
            program([1, 1e4], [[1e-3, 1e3], [1.0, 0.0]], [1, -INF], [INF, 500]),
            optimum(10, (0, 1e-3)),
        ),
        "no columns": (program([], np.zeros((1, 0)), -1, 1, offset=3), optimum(3, ())),
    }


def _unsolvable() -> list[Case]:
    infeasible = {
        "infeasible": program([1, 1], [[1, 1], [1, 1]], [-INF, 2], [1, INF]),
        "infeasible equalities": program([0, 0], [[1, 1], [1, 1]], [1, 2], [1, 2], lower=-INF),
        "infeasible, its relaxation unbounded": program(
            [-1, 0, 0], [[0, 1, 1], [0, 1, 1]], [-INF, 2], [1, INF]
        ),
        "crossed bounds": program([1, 1], [[1, 1]], row_lower=[1], lower=[0, 3], upper=[5, 2]),
        "empty row that cannot hold": program([1, 1], [[0, 0], [1, 1]], [1, 0], [2, 9]),
    }
    unbounded = {
        "unbounded": program([-1, 0], [[1, -1]], row_upper=[1]),
        "unbounded, free column": program([1], [[1]], row_upper=[5], lower=-INF),
    }
    return unsolvable("linear: ", infeasible, unbounded)
