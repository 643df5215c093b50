"""Conformance cases: linear programs with known value, primal and dual."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from ...models.programs.linear import MixedIntegerProgram
from ..backend import Feature, Termination
from .cases import Case, Expectation

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
    """Return a program from dense data; bounds and kinds given once count for all."""
    costs = np.asarray(cost, float)
    rows = np.asarray(matrix, float).reshape(-1, costs.size) if costs.size else np.asarray(matrix)

    def full(value: ArrayLike, size: int, kind: type = float) -> NDArray[Any]:
        return np.broadcast_to(np.asarray(value, kind), (size,)).copy()

    return MixedIntegerProgram(
        cost=costs,
        matrix=sp.csr_array(rows),
        row_lower=full(row_lower, rows.shape[0]),
        row_upper=full(row_upper, rows.shape[0]),
        column_lower=full(lower, costs.size),
        column_upper=full(upper, costs.size),
        integral=full(integral, costs.size, bool),
        offset=offset,
    )


def linear_cases() -> tuple[Case, ...]:
    """Return the cases; each that has an optimum comes a second time, for its duals."""
    primal = _solvable()
    dual = [
        Case(f"{case.name}, duals", case.program, case.expectation, frozenset({Feature.DUALS}))
        for case in primal
    ]
    return (*primal, *dual, *_unsolvable())


def _optimal(
    objective: float,
    point: tuple[float, ...] | None = None,
    duals: tuple[float, ...] | None = None,
) -> Expectation:
    return Expectation((Termination.OPTIMAL,), objective, point=point, duals=duals)


def _solvable() -> list[Case]:
    return [
        Case(
            "linear: unique primal and dual",
            program([-3, -5], [[1, 0], [0, 2], [3, 2]], row_upper=[4, 12, 18]),
            _optimal(-36, (2, 6), (0, -1.5, -1)),
        ),
        Case(
            "linear: lower rows bind",
            program([2, 3], [[1, 1], [1, 3]], row_lower=[4, 6]),
            _optimal(9, (3, 1), (1.5, 0.5)),
        ),
        Case(
            "linear: degenerate vertex",
            program([-1, -1], [[1, 0], [0, 1], [1, 1], [2, 1]], row_upper=[1, 1, 2, 3]),
            _optimal(-2, (1, 1)),
        ),
        Case(
            "linear: many optimal points",
            program([-1, -1], [[1, 1]], row_upper=[5], upper=[4, 4]),
            _optimal(-5, None, (-1,)),
        ),
        Case(
            "linear: free columns and ranges",
            program([1, 2], [[1, 1], [1, -1]], [-1, 0], [3, 4], lower=-INF),
            _optimal(-3.5, (1.5, -2.5), (1.5, -0.5)),
        ),
        Case(
            "linear: equality system, free columns",
            program([1, 1], [[2, 1], [1, -1]], [5, 1], [5, 1], lower=-INF),
            _optimal(3, (2, 1), (2 / 3, -1 / 3)),
        ),
        Case(
            "linear: redundant equalities",
            program([1, 2], [[1, 1], [2, 2]], [3, 6], [3, 6]),
            _optimal(3, (3, 0)),
        ),
        Case(
            "linear: fixed column",
            program([1, 1], [[1, 1]], row_lower=[5], lower=[3, 0], upper=[3, INF]),
            _optimal(5, (3, 2), (1,)),
        ),
        Case(
            "linear: empty and free rows",
            program([1, 1], [[0, 0], [1, 1], [1, 2], [0, 0]], [-1, -INF, 4, 0], [1, INF, INF, 0]),
            _optimal(2, (0, 2)),
        ),
        Case(
            "linear: column outside all rows",
            program([1, -1, 0], [[1, 0, 0]], row_lower=[2], upper=[INF, 7, INF]),
            _optimal(-5),
        ),
        Case(
            "linear: no rows, offset",
            program([1, -1], np.zeros((0, 2)), lower=[-1, 0], upper=[2, 4], offset=10),
            _optimal(5, (-1, 4), ()),
        ),
        Case(
            "linear: upper bounds below zero",
            program([-1, 2], [[1, 1]], row_lower=[-12], lower=-INF, upper=[-3, -2]),
            _optimal(-15, (-3, -9), (2,)),
        ),
        Case(
            "linear: empty objective",
            program([0, 0], [[1, 1]], [1], [2], offset=7),
            _optimal(7),
        ),
        Case(
            "linear: large offset",
            program([1, 1], [[1, 2]], row_lower=[4], offset=-1e6),
            _optimal(-999998, (0, 2), (0.5,)),
        ),
        Case(
            "linear: badly scaled",
            program([1, 1e4], [[1e-3, 1e3], [1.0, 0.0]], [1, -INF], [INF, 500]),
            _optimal(10, (0, 1e-3)),
        ),
        Case(
            "linear: no columns",
            program([], np.zeros((1, 0)), -1, 1, offset=3),
            _optimal(3, ()),
        ),
    ]


def _unsolvable() -> list[Case]:
    infeasible = Expectation((Termination.INFEASIBLE,))
    unbounded = Expectation((Termination.UNBOUNDED,))
    return [
        Case(
            "linear: infeasible", program([1, 1], [[1, 1], [1, 1]], [-INF, 2], [1, INF]), infeasible
        ),
        Case(
            "linear: infeasible equalities",
            program([0, 0], [[1, 1], [1, 1]], [1, 2], [1, 2], lower=-INF),
            infeasible,
        ),
        Case(
            "linear: infeasible, its relaxation unbounded",
            program([-1, 0, 0], [[0, 1, 1], [0, 1, 1]], [-INF, 2], [1, INF]),
            infeasible,
        ),
        Case(
            "linear: crossed bounds",
            program([1, 1], [[1, 1]], row_lower=[1], lower=[0, 3], upper=[5, 2]),
            infeasible,
        ),
        Case(
            "linear: empty row that cannot hold",
            program([1, 1], [[0, 0], [1, 1]], [1, 0], [2, 9]),
            infeasible,
        ),
        Case("linear: unbounded", program([-1, 0], [[1, -1]], row_upper=[1]), unbounded),
        Case(
            "linear: unbounded, free column",
            program([1], [[1]], row_upper=[5], lower=-INF),
            unbounded,
        ),
    ]
