"""Conformance cases: convex quadratic programs with known optimum, point and multipliers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from ...models.programs.linear import QuadraticProgram
from ..contract.backend import Termination
from .cases import Case, Expectation, Table, asked_for, bounds, optimum, tabled, unsolvable
from .convex import horizon, portfolio

__all__ = ["quadratic", "quadratic_cases"]

INF = np.inf


def quadratic(
    hessian: ArrayLike,
    cost: Sequence[float],
    matrix: ArrayLike = (),
    row_lower: ArrayLike = -INF,
    row_upper: ArrayLike = INF,
    *,
    lower: ArrayLike = -INF,
    upper: ArrayLike = INF,
    offset: float = 0.0,
) -> QuadraticProgram:
    """Return a program from dense data, with scalar bounds broadcast; a vector `hessian` is its diagonal."""
    costs = np.asarray(cost, float)
    size = costs.size
    curved = np.asarray(hessian, float)
    if curved.ndim == 1:
        curved = np.diag(curved) if size else np.zeros((0, 0))
    given = np.asarray(matrix, float)
    rows = given.reshape(-1, size) if size else given.reshape(given.shape[0], 0)

    return QuadraticProgram(
        hessian=sp.csr_array(curved),
        cost=costs,
        matrix=sp.csr_array(rows),
        **bounds(rows.shape[0], rows.shape[1], row_lower, row_upper, lower, upper),
        offset=offset,
    )


def quadratic_cases() -> tuple[Case, ...]:
    """Return the cases. The multipliers of solvable programs are judged as well."""
    primal = {**_small(), **_delicate(), **_larger()}
    return (*tabled("quadratic: ", primal, duals=True), *_unsolvable(), *_asked_for())


def _small() -> Table:
    return {
        "strictly convex, no constraint": (
            quadratic([[2, 1], [1, 2]], [-4, -5]),
            optimum(-7, (1, 2), ()),
        ),
        "equal rows only": (
            quadratic([1, 1, 1], [0, 0, 0], [[1, 2, 3]], 14, 14),
            optimum(7, (1, 2, 3), (1,)),
        ),
        "box": (
            quadratic([2, 2, 2], [-2, -8, 4], lower=0, upper=[5, 3, 5]),
            optimum(-16, (1, 3, 0), ()),
        ),
        "rows from below": (
            quadratic([2, 2], [0, 0], [[1, 1], [1, 0]], [2, 0.5]),
            optimum(2, (1, 1), (2, 0)),
        ),
        "two-sided rows": (
            quadratic([1, 1], [-6, 0], [[1, 1], [1, -1]], [-1, -2], [4, 2]),
            optimum(-13, (3, 1), (-1, -2)),
        ),
        # (x + y)^2 / 2 - x: flat along (1, -1); the cost decreases until the bound.
        "semidefinite Hessian": (
            quadratic([[1, 1], [1, 1]], [-1, 0], upper=[2, INF]),
            optimum(-2, (2, -2), ()),
        ),
        "free columns, one without curvature": (
            quadratic([1, 1, 0], [0, 0, 1], [[1, 0, 1], [0, 1, 1]], [2, 4]),
            optimum(3.5, (0, 1, 3), (0, 1)),
        ),
        "linear program": (
            quadratic([0, 0], [-3, -5], [[1, 0], [0, 2], [3, 2]], row_upper=[4, 12, 18], lower=0),
            optimum(-36, (2, 6), (0, -1.5, -1)),
        ),
        "no rows, one column linear": (
            quadratic([2, 0], [-2, 1], lower=[-INF, -3], upper=[INF, 4]),
            optimum(-4, (1, -3), ()),
        ),
        "offset": (quadratic([2], [-6], lower=0, offset=1e3), optimum(991, (3,))),
        "large negative offset": (quadratic([2], [-2], offset=-1e6), optimum(-1000001, (1,))),
        "optimum zero": (quadratic([2, 2], [-2, 0], offset=1), optimum(0, (1, 0))),
        "no columns": (
            quadratic(np.zeros((0, 0)), [], np.zeros((1, 0)), -1, 1, offset=3),
            optimum(3, ()),
        ),
    }


def _delicate() -> Table:
    return {
        "duplicated rows": (
            quadratic([2, 2], [0, 0], [[1, 1], [1, 1], [2, 2]], [2, 2, 4]),
            optimum(2, (1, 1)),
        ),
        "dependent equalities": (
            quadratic(
                [1, 1], [0, 0], [[1, 1], [2, 2], [1, -1], [1, 1]], [2, 4, 0, 2], [2, 4, 0, 2]
            ),
            optimum(1, (1, 1)),
        ),
        "degenerate vertex": (
            quadratic([2, 2], [-4, -4], [[1, 0], [0, 1], [1, 1]], row_upper=[1, 1, 2]),
            optimum(-6, (1, 1)),
        ),
        "a row that binds without force": (quadratic([2], [-2], [[1]], row_upper=1), optimum(-1)),
        "many optimal points": (
            quadratic([[1, 1], [1, 1]], [-2, -2], lower=0, upper=5),
            optimum(-2),
        ),
        "badly scaled": (
            quadratic([1e-4, 1e4], [-7e-3, -2010], [[1e-3, 1e3]], row_upper=1.05),
            optimum(-2.23, (50, 1e-3), (-2,)),
        ),
        "badly scaled, other way": (
            quadratic([1e4, 1e-4], [0, 0], [[1e4, 0], [0, 1e-4]], [1e4, 1e-4]),
            optimum(5000.00005),
        ),
        "fixed column": (
            quadratic([2, 2], [0, -2], [[1, 1]], 5, lower=[3, -INF], upper=[3, INF]),
            optimum(9, (3, 2), (2,)),
        ),
        "every column fixed": (
            quadratic([1, 1], [0, 0], [[1, 1]], row_upper=4, lower=[1, 2], upper=[1, 2]),
            optimum(2.5, (1, 2), (0,)),
        ),
        "empty and free rows": (
            quadratic([2, 2], [0, 0], [[0, 0], [1, 1], [1, -1]], [-1, 2, -INF], [1, INF, INF]),
            optimum(2, (1, 1), (0, 2, 0)),
        ),
    }


def _larger() -> Table:
    return {
        f"{name}, {program.size} columns": (
            program,
            optimum(program.objective(point), tuple(point), tuple(duals)),
        )
        for name, (program, point, duals) in {
            "portfolio": portfolio(),
            "receding horizon": horizon(),
        }.items()
    }


def _unsolvable() -> list[Case]:
    round_ = [2.0, 2.0]
    infeasible = {
        "infeasible rows": quadratic(round_, [-2, -5], [[1, 1], [1, 1]], [3, -INF], [INF, 1]),
        "infeasible by a thousandth": quadratic(
            round_, [-2, -5], [[1, 1], [1, 1]], [1.001, -INF], [INF, 1], lower=-9, upper=9
        ),
        "infeasible within the bounds": quadratic(
            round_, [0, 0], [[1, 1]], row_upper=2, lower=[3, 0]
        ),
        "infeasible equalities": quadratic(round_, [0, 0], [[1, 1], [2, 2]], [1, 3], [1, 3]),
        "infeasible, its objective unbounded": quadratic(
            [2, 0], [0, -1], [[1, 0], [1, 0]], [1, -INF], [INF, 0]
        ),
        "crossed bounds": quadratic(round_, [1, 1], [[1, 1]], 1, lower=[0, 3], upper=[5, 2]),
        "crossed rows": quadratic(round_, [1, 1], [[1, 1]], 3, 2),
        "empty row that cannot hold": quadratic(round_, [1, 1], [[0, 0], [1, 1]], [1, 0], [2, 9]),
        "fixed columns break a row": quadratic(round_, [1, 1], [[1, 1]], 3, lower=1, upper=1),
    }
    unbounded = {
        "unbounded along a flat direction": quadratic([[1, 1], [1, 1]], [-1, 0]),
        "unbounded within rows": quadratic([2, 0], [0, -1], [[1, -1]], row_upper=1, lower=0),
        "unbounded linear program": quadratic([0], [1], [[1]], -INF, 5),
    }
    return unsolvable("quadratic: ", infeasible, unbounded)


def _asked_for() -> list[Case]:
    rows = quadratic([3, 7], [0, 0], [[1, 1]], 1)
    point = (0.7, 0.3)
    requests: dict[str, dict[str, Any]] = {
        ": a small gap": {"gap": 1e-10},
        ": tight tolerance": {"tolerance": 1e-9},
        ": warm start at the optimum": {"warm_start": np.array(point)},
        ": warm start elsewhere": {"warm_start": np.array([5.0, -4.0])},
        ", cutoff: at the optimum": {"cutoff": 1.05},
    }
    below_optimum = {", cutoff: nothing below": {"cutoff": 1.0}}
    return [
        *asked_for("quadratic", rows, optimum(1.05, point), requests),
        *asked_for("quadratic", rows, Expectation((Termination.NO_SOLUTION,), 1.05), below_optimum),
    ]
