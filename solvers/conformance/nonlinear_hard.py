"""Conformance cases: nonlinear programs that are degenerate, infeasible or unbounded."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..backend import Termination
from .cases import Case, Expectation
from .nonlinear_posing import ENDS, known, nonlinear

__all__ = ["hard_cases", "unsolvable_cases"]

INF = np.inf


def hard_cases() -> list[Case]:
    """Return the cases where multipliers are not unique, or do not exist."""

    def round_(x: Any) -> Any:
        return x[0] ** 2 + x[1] ** 2

    return [
        Case(
            "nonlinear: an equation twice",
            nonlinear(
                lambda x: (x[0] + x[1] + x[2] ** 2, [round_(x), 2 * round_(x)]),
                [-1.5, -0.5, 1],
                row_lower=[2, 4],
                row_upper=[2, 4],
            ),
            known(-2.0, (-1, -1, 0)),
        ),
        Case(
            "nonlinear: three rows bind at a corner of the plane",
            nonlinear(
                lambda x: (x[0] + 2 * x[1], [x[0], x[1], x[0] + x[1] + x[0] * x[1]]),
                [2, 1],
                row_lower=0,
            ),
            known(0.0, (0, 0)),
        ),
        Case(
            "nonlinear: a row that binds without force",
            nonlinear(
                lambda x: (100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2, [round_(x)]),
                [-1, 0],
                row_upper=2,
            ),
            known(0.0, (1, 1), slack=1e-5),
        ),
        Case(
            # At either optimum the row's gradient is that of a bound; the row has no inside.
            "nonlinear: one of two columns is zero",
            nonlinear(
                lambda x: ((x[0] - 1) ** 2 + (x[1] - 1) ** 2, [x[0] * x[1]]),
                [2, 0.5],
                row_upper=0,
                lower=0,
            ),
            Expectation((*ENDS, Termination.FEASIBLE), 1.0, slack=1e-2, any_limit=True),
        ),
        Case(
            # Kuhn and Tucker's cusp: at the optimum (1, 0) no multipliers exist. Where 1e-6 are
            # allowed the cusp reaches to 1.01.
            "nonlinear: a cusp without multipliers",
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
    ]


def unsolvable_cases() -> list[Case]:
    """Return the cases without a plan, and those without an optimum."""
    infeasible = Expectation(
        (
            Termination.LOCALLY_INFEASIBLE,
            Termination.INFEASIBLE,
            Termination.NO_SOLUTION,
            Termination.FAILED,
        ),
        any_limit=True,
    )
    unbounded = Expectation(
        (
            Termination.UNBOUNDED,
            Termination.NO_SOLUTION,
            Termination.FEASIBLE,
            Termination.FAILED,
        ),
        any_limit=True,
    )

    def disk(x: Any) -> tuple[Any, list[Any]]:
        return x[0], [x[0] ** 2 + x[1] ** 2, x[0] + x[1]]

    return [
        Case(
            "nonlinear: infeasible, no point in the disk",
            nonlinear(disk, [0.5, 0.5], row_lower=[-INF, 3], row_upper=[1, INF]),
            infeasible,
        ),
        Case(
            "nonlinear: infeasible equations",
            nonlinear(
                lambda x: (x[0] ** 2 + x[1], [x[0] ** 2 + x[1] ** 2, x[0] * x[1]]),
                [1, 2],
                row_lower=[1, 2],
                row_upper=[1, 2],
            ),
            infeasible,
        ),
        Case(
            "nonlinear: infeasible within the bounds",
            nonlinear(
                lambda x: (x[1], [x[0] ** 2 + x[1]]),
                [0.5, 0.5],
                row_lower=5,
                lower=0,
                upper=[2, 0.5],
            ),
            infeasible,
        ),
        Case(
            "nonlinear: fixed columns break a row",
            nonlinear(lambda x: (x[0], [x[0] * x[1]]), [1, 1], row_lower=3, lower=1, upper=1),
            infeasible,
        ),
        Case(
            "nonlinear: unbounded along a line",
            nonlinear(lambda x: (x[0], [x[0] + x[1]]), [0, 1], row_lower=1, row_upper=1),
            unbounded,
        ),
        Case(
            "nonlinear: unbounded, concave",
            nonlinear(lambda x: (-(x[0] ** 2) + x[1] ** 2, []), [1, 1]),
            unbounded,
        ),
    ]
