"""Conformance cases: nonlinear programs that are degenerate, infeasible or unbounded."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..contract.backend import Termination
from .cases import Case, Expectation, Table, ended
from .nonlinear_posing import ENDS, known, nonlinear

__all__ = ["hard_cases", "unsolvable_cases"]

INF = np.inf


def hard_cases() -> Table:
    """Return the cases with multipliers that are not unique or do not exist."""

    def round_(x: Any) -> Any:
        return x[0] ** 2 + x[1] ** 2

    return {
        "an equation twice": (
            nonlinear(
                lambda x: (x[0] + x[1] + x[2] ** 2, [round_(x), 2 * round_(x)]),
                [-1.5, -0.5, 1],
                [2, 4],
                [2, 4],
            ),
            known(-2.0, (-1, -1, 0)),
        ),
        "three rows bind at a corner of the plane": (
            nonlinear(
                lambda x: (x[0] + 2 * x[1], [x[0], x[1], x[0] + x[1] + x[0] * x[1]]),
                [2, 1],
                row_lower=0,
            ),
            known(0.0, (0, 0)),
        ),
        "a row that binds without force": (
            nonlinear(
                lambda x: (100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2, [round_(x)]),
                [-1, 0],
                row_upper=2,
            ),
            known(0.0, (1, 1), slack=1e-5),
        ),
        # At both optima the gradient of the row is that of a bound; the row has no interior.
        "one of two columns is zero": (
            nonlinear(
                lambda x: ((x[0] - 1) ** 2 + (x[1] - 1) ** 2, [x[0] * x[1]]),
                [2, 0.5],
                row_upper=0,
                lower=0,
            ),
            Expectation((*ENDS, Termination.FEASIBLE), 1.0, slack=1e-2, any_limit=True),
        ),
        # Kuhn and Tucker's cusp: no multipliers exist at the optimum (1, 0). With a tolerance of
        # 1e-6, the cusp reaches to 1.01.
        "a cusp without multipliers": (
            nonlinear(
                lambda x: (-x[0], [(1 - x[0]) ** 3 - x[1]]), [0.2, 0.3], row_lower=0, lower=0
            ),
            Expectation(
                (*ENDS, Termination.FEASIBLE, Termination.NO_SOLUTION, Termination.FAILED),
                -1.0,
                slack=2e-2,
                any_limit=True,
            ),
        ),
    }


def unsolvable_cases() -> list[Case]:
    """Return the infeasible and the unbounded cases."""

    def disk(x: Any) -> tuple[Any, list[Any]]:
        return x[0], [x[0] ** 2 + x[1] ** 2, x[0] + x[1]]

    infeasible = {
        "infeasible, no point in the disk": nonlinear(
            disk, [0.5, 0.5], row_lower=[-INF, 3], row_upper=[1, INF]
        ),
        "infeasible equations": nonlinear(
            lambda x: (x[0] ** 2 + x[1], [x[0] ** 2 + x[1] ** 2, x[0] * x[1]]),
            [1, 2],
            [1, 2],
            [1, 2],
        ),
        "infeasible within the bounds": nonlinear(
            lambda x: (x[1], [x[0] ** 2 + x[1]]), [0.5, 0.5], row_lower=5, lower=0, upper=[2, 0.5]
        ),
        "fixed columns break a row": nonlinear(
            lambda x: (x[0], [x[0] * x[1]]), [1, 1], row_lower=3, lower=1, upper=1
        ),
    }
    unbounded = {
        "unbounded along a line": nonlinear(
            lambda x: (x[0], [x[0] + x[1]]), [0, 1], row_lower=1, row_upper=1
        ),
        "unbounded, concave": nonlinear(lambda x: (-(x[0] ** 2) + x[1] ** 2, []), [1, 1]),
    }
    unsolved = (Termination.NO_SOLUTION, Termination.FAILED)
    impossible = (Termination.LOCALLY_INFEASIBLE, Termination.INFEASIBLE, *unsolved)
    endless = (Termination.UNBOUNDED, Termination.FEASIBLE, *unsolved)
    return [
        *ended("nonlinear: ", infeasible, *impossible, any_limit=True),
        *ended("nonlinear: ", unbounded, *endless, any_limit=True),
    ]
