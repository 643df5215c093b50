"""Conformance cases: a larger nonlinear program, and one that takes time for limits and stops."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .cases import Case, Expectation
from .limits import timed_cases
from .nonlinear_posing import ENDS, nonlinear

__all__ = ["chain_case", "nonlinear_limit_cases"]

#: Columns of the chained Rosenbrock function; a search follows its bends one after the other.
SIZE = 200
#: Time steps of the pendulum.
STEPS = 160


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
        return [
            a[1:] - a[:-1] - h * v[:-1],
            v[1:] - v[:-1] - h * (u[:-1] - casadi.sin(a[:-1])),
        ]

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
