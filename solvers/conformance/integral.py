"""Conformance cases: quadratic and nonlinear programs with integral columns, solved by enumeration."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...models.programs.linear import QuadraticProgram
from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Termination
from .cases import Case, Expectation, Table, asked_for, ended, optimum, tabled, unsolvable
from .nonlinear_hard import known, nonlinear
from .quadratic import quadratic

__all__ = ["integer_nonlinear_cases", "integer_quadratic_cases"]

INF = np.inf


def _whole(*data: Any, integral: ArrayLike = True, **bounds: Any) -> QuadraticProgram:
    """Return a quadratic program with integral columns; all if `integral` is True."""
    program = quadratic(*data, **bounds)
    return replace(program, integral=np.broadcast_to(np.asarray(integral, bool), program.size))


def integer_quadratic_cases() -> tuple[Case, ...]:
    """Return the cases of quadratic programs."""
    return (*tabled("integer quadratic: ", _quadratic()), *_unsolvable(), *_asked_for())


def _lattice() -> QuadraticProgram:
    # Rounding the minimum of the relaxation, (1.6, -2.45), gives (2, -2) with the objective 9.0325.
    hessian = np.array([[26.0, 24.0], [24.0, 26.0]])
    centre = np.array([1.6, -2.45])
    offset = float(centre @ hessian @ centre / 2)
    return _whole(hessian, (-hessian @ centre).tolist(), lower=-4, upper=4, offset=offset)


def _quadratic() -> Table:
    return {
        "closest point of a lattice": (_lattice(), optimum(0.7325, (2, -3))),
        "infinite bounds": (
            _whole([[2, 1], [1, 3]], [-7, 4]),
            optimum(-23.5, (5, -3)),
        ),
        "rows exclude the rounded relaxation": (
            _whole([2, 2], [-5, -5], [[2, 2]], row_upper=[7], lower=0),
            optimum(-10),
        ),
        "semidefinite Hessian": (
            _whole([[1, 1], [1, 1]], [-1.5, -1], lower=-2, upper=[2, 2]),
            optimum(-1.5, (2, -1)),
        ),
        "zero Hessian": (
            _whole([0, 0], [-5, -4], [[6, 4], [1, 2]], row_upper=[24, 6], lower=0, upper=9),
            optimum(-20, (4, 0)),
        ),
        "fractional bounds": (
            _whole([2, 2], [-1, -9], lower=0.5, upper=[3.5, 3.5]),
            optimum(-18, (1, 3)),
        ),
        "fixed column": (
            _whole([2, 2], [0, -3], [[1, 1]], [4], lower=[3, -9], upper=[3, 9]),
            optimum(7),
        ),
        "equality row": (
            _whole([2, 2, 2], [0, 0, 0], [[3, 5, 7]], [19], [19], lower=-9, upper=9),
            optimum(5, (0, 1, 2)),
        ),
        "large negative offset": (
            _whole([2], [-3.2], lower=-9, upper=9, offset=-1e6),
            optimum(-1000002.4),
        ),
        "badly scaled": (
            _whole([1e-4, 1e4], [-6.4e-3, -24600], lower=0, upper=[100, 9]),
            optimum(-29200.2048),
        ),
        "mixed: a continuous column follows": (
            _whole([2, 2], [-3, 0], [[1, -2]], 0, 0, integral=[True, False], lower=-9, upper=9),
            optimum(-1.75, (1, 0.5)),
        ),
        # At most two of four assets with the return 1 at least.
        "mixed: portfolio of two assets": (
            _whole(
                np.diag([2.0, 3.0, 4.0, 2.5, 0, 0, 0, 0]),
                [0] * 8,
                np.vstack(
                    [
                        [1, 1, 1, 1, 0, 0, 0, 0],
                        [0, 0, 0, 0, 1, 1, 1, 1],
                        np.hstack([-np.eye(4), np.eye(4)]),
                    ]
                ),
                [1, -INF, 0, 0, 0, 0],
                [1, 2, INF, INF, INF, INF],
                integral=[False] * 4 + [True] * 4,
                lower=0,
                upper=1,
            ),
            optimum(5 / 9),
        ),
    }


def _unsolvable() -> list[Case]:
    infeasible = {
        "infeasible, its relaxation feasible": _whole(
            [2, 2], [1, 1], [[2, 4]], 7, 7, lower=-9, upper=9
        ),
        "no integer within the bounds": _whole([2, 2], [1, 1], lower=[0.3, 0], upper=[0.7, 4]),
        "infeasible, its relaxation unbounded": _whole(
            [0, 0, 2], [-1, 0, 0], [[0, 2, 2]], 1, 1, lower=[0, 0, 0], upper=[INF, 3, 3]
        ),
        "crossed rows": _whole([2, 2], [1, 1], [[1, 1]], 3, 2, lower=0, upper=9),
    }
    unbounded = {
        "unbounded along a flat direction": _whole([2, 0], [0, -1], [[1, -1]], row_upper=1, lower=0)
    }
    return unsolvable("integer quadratic: ", infeasible, unbounded)


def _asked_for() -> list[Case]:
    program, solved = _lattice(), optimum(0.7325, (2, -3))
    requests: dict[str, dict[str, Any]] = {
        "a small gap": {"gap": 1e-9},
        "tight tolerance": {"tolerance": 1e-8},
        "warm start at the optimum": {"warm_start": np.array([2.0, -3.0])},
        "warm start elsewhere": {"warm_start": np.array([-4.0, 4.0])},
        "cutoff at the optimum": {"cutoff": 0.7325},
    }
    below = {"nothing below the cutoff": {"cutoff": 0.7}}
    return [
        *asked_for("integer quadratic: ", program, solved, requests),
        *asked_for(
            "integer quadratic: ", program, Expectation((Termination.NO_SOLUTION,), 0.7325), below
        ),
    ]


def integer_nonlinear_cases() -> tuple[Case, ...]:
    """Return the cases of nonlinear programs, with convex relaxations."""
    infeasible = ended(
        "integer nonlinear: ", _infeasible(), Termination.LOCALLY_INFEASIBLE, Termination.INFEASIBLE
    )
    warm = {"warm start": {"warm_start": np.array([-2.0, 3.0])}}
    program, solved = _nonlinear()["exponential"]
    return (
        *tabled("integer nonlinear: ", _nonlinear()),
        *infeasible,
        *asked_for("integer nonlinear: ", program, solved, warm),
    )


def _steep(x: Any) -> Any:
    import casadi

    return casadi.exp(x[0]) - 3 * x[0] + casadi.exp(-x[1]) + 0.4 * x[1]


def _nonlinear() -> Table:
    both = np.array([True, True])
    first = np.array([True, False])
    return {
        "exponential": (
            nonlinear(
                lambda x: (_steep(x), [x[0] + x[1]]), [0, 0], lower=-3, upper=3, integral=both
            ),
            known(0.48616126963048745, (1, 1)),
        ),
        "disk": (
            nonlinear(
                lambda x: (-2 * x[0] - 3 * x[1], [x[0] ** 2 + x[1] ** 2]),
                [0, 0],
                row_upper=11,
                lower=-9,
                upper=9,
                integral=both,
            ),
            known(-11.0, (1, 3)),
        ),
        "fractional bounds": (
            nonlinear(
                lambda x: (x[1] ** 2 - x[0], []),
                [1, 0],
                lower=[0.5, -3],
                upper=[2.7, 3],
                integral=first,
            ),
            known(-2.0, (2, 0)),
        ),
        "mixed: a continuous column follows": (
            nonlinear(
                lambda x: (_steep(x) + (x[1] - 0.3 * x[0]) ** 2, [x[1] - x[0]]),
                [0, 0],
                -1,
                1,
                lower=-3,
                upper=3,
                integral=first,
            ),
            known(0.5576739357120035, (1, 0.4264208)),
        ),
        "large scales of columns": (
            nonlinear(
                lambda x: ((x[0] - 1.4) ** 2 + (x[1] - 26.0) ** 2, [x[0] + x[1]]),
                [0, 0],
                row_upper=26,
                lower=-30,
                upper=30,
                integral=first,
                column_scale=[10, 10],
            ),
            known(1.16, (1, 25)),
        ),
        "small objective": (
            nonlinear(
                lambda x: (1e-6 * ((x[0] - 2.4) ** 2 + (x[1] - 1.7) ** 2 + x[0] * x[1]), []),
                [0, 0],
                lower=-3,
                upper=3,
                integral=both,
            ),
            known(2.65e-6, (2, 1), slack=1e-9),
        ),
    }


def _infeasible() -> dict[str, NonlinearProgram]:
    both = np.array([True, True])
    return {
        "infeasible, its relaxation feasible": nonlinear(
            lambda x: (x[0] ** 2, [2 * x[0] + 4 * x[1]]),
            [0, 0],
            1,
            1,
            lower=-3,
            upper=3,
            integral=both,
        ),
        "no integer within the bounds": nonlinear(
            lambda x: (x[0] ** 2, [x[0] + x[1]]),
            [0.5, 0],
            -9,
            9,
            lower=[0.2, -3],
            upper=[0.8, 3],
            integral=both,
        ),
    }
