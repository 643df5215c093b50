"""Conformance cases: nonlinear programs that are degenerate, infeasible, unbounded, large or slow.

The module also contains the tools to state such cases.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Termination
from .cases import Case, Expectation, Table, bounds, ended
from .limits import timed_cases

__all__ = [
    "ENDS",
    "chain_case",
    "hard_cases",
    "known",
    "nonlinear",
    "nonlinear_limit_cases",
    "unsolvable_cases",
]

INF = np.inf
#: Terminations of a search that finds a local optimum; a global solver proves it optimal.
ENDS = (Termination.LOCALLY_OPTIMAL, Termination.OPTIMAL)
#: Columns of the chained Rosenbrock function; a search follows its bends one after the other.
SIZE = 200
#: Time steps of the pendulum.
STEPS = 160


def nonlinear(
    pose: Callable[[Any], tuple[Any, Sequence[Any]]],
    guess: ArrayLike,
    row_lower: ArrayLike = -np.inf,
    row_upper: ArrayLike = np.inf,
    *,
    lower: ArrayLike = -np.inf,
    upper: ArrayLike = np.inf,
    **fields: Any,
) -> NonlinearProgram:
    """Return the program with the objective and rows that `pose` returns for CasADi symbols x.

    Scalar bounds apply to all rows or columns, `guess` is the initial point, and `fields` are further fields.
    """
    import casadi

    start = np.asarray(guess, float)
    x = casadi.SX.sym("x", start.size)
    objective, rows = pose(x)
    symbols = casadi.vertcat(*rows) if len(rows) else casadi.SX(0, 1)
    return NonlinearProgram(
        function=casadi.Function(
            "program", [x], [casadi.densify(objective), casadi.densify(symbols)], ["x"], ["f", "g"]
        ),
        **bounds(int(symbols.numel()), start.size, row_lower, row_upper, lower, upper),
        guess=start,
        **fields,
    )


def known(
    objective: float,
    point: tuple[float, ...] | None = None,
    duals: tuple[float, ...] | None = None,
    slack: float = 1e-6,
) -> Expectation:
    """Return the expectation for a known optimum that a local search must find.

    `point` and `duals` are given if they are unique, and `slack` is the relative slack of comparisons.
    """
    return Expectation(ENDS, objective, point=point, duals=duals, slack=slack)


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


def nonlinear_limit_cases() -> tuple[Case, ...]:
    """Return the cases for limits and stop requests."""
    valley = nonlinear(_valley, np.tile([-1.2, 1.0], SIZE // 2), lower=-10, upper=10)
    best = np.ones(SIZE)
    # All seeds lead to local optima; the best one has the objective 0.
    *cases, kept = timed_cases(
        "nonlinear, ",
        valley,
        best,
        ENDS,
        best_known=0.0,
        floor=0.0,
        seconds=0.1,
        stop_after=0.05,
        any_limit=True,
    )
    # Without time, the start is the only point.
    arguments = {"time_limit": 0.0, "warm_start": best}
    none = cases[1].expectation
    return (*cases, replace(kept, expectation=none, arguments=arguments))


def _valley(x: Any) -> tuple[Any, list[Any]]:
    """Return the chained Rosenbrock function."""
    import casadi

    return 100 * casadi.sumsqr(x[1:] - x[:-1] ** 2) + casadi.sumsqr(1 - x[:-1]), []


def chain_case() -> Case:
    """Return a pendulum of 480 columns, constructed from its solution.

    Each step has an angle, a speed and a torque, ``a' = a + h v`` and ``v' = v + h (u - sin a)``. The
    objective is the squared distance from a centre, chosen such that the given multipliers satisfy
    the first-order conditions. They are small, so that the solution is a strict local optimum.
    """
    import casadi

    k, h = np.arange(STEPS), 0.05
    torque = np.clip(0.8 * np.sin(k * h * 1.3) + 0.3 * np.cos(k * h * 2.9), -0.7, 0.7)
    angle, speed = np.zeros(STEPS), np.zeros(STEPS)
    for step in range(STEPS - 1):
        angle[step + 1] = angle[step] + h * speed[step]
        speed[step + 1] = speed[step] + h * (torque[step] - np.sin(angle[step]))
    point = np.concatenate([angle, speed, torque])
    duals = 0.2 * np.concatenate([np.sin(1 + 0.1 * k[1:]), np.cos(2 + 0.07 * k[1:])])
    reduced = np.zeros(point.size)
    reduced[2 * STEPS :] = np.where(torque >= 0.7, -0.3, np.where(torque <= -0.7, 0.3, 0.0))

    def rows(x: Any) -> list[Any]:
        a, v, u = x[:STEPS], x[STEPS : 2 * STEPS], x[2 * STEPS :]
        return [a[1:] - a[:-1] - h * v[:-1], v[1:] - v[:-1] - h * (u[:-1] - casadi.sin(a[:-1]))]

    lower = np.concatenate([np.full(2 * STEPS, -np.inf), np.full(STEPS, -0.7)])
    lower[[0, STEPS]] = 0.0
    upper = np.where(np.isfinite(lower), -lower, np.inf)
    fixed = nonlinear(lambda x: (casadi.SX(0), rows(x)), point)
    centre = point - fixed.jacobian(point).T @ duals - reduced
    program = nonlinear(
        lambda x: (0.5 * casadi.sumsqr(x - centre), rows(x)),
        np.zeros(point.size),
        0.0,
        0.0,
        lower=lower,
        upper=upper,
    )
    objective = 0.5 * float(((point - centre) ** 2).sum())
    return Case(
        f"nonlinear: pendulum, {point.size} columns",
        program,
        Expectation(ENDS, objective, point=tuple(point), duals=tuple(duals)),
    )
