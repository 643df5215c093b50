"""SLSQP, from SciPy: dense sequential quadratic programming for small programs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Limit, Option, Request
from ..programs.attempts import Ended, Ending, Meaning
from .base import most_iterations
from .scipy_nlp import Posed, ScipyNlp

__all__ = ["Slsqp"]

Vector = NDArray[np.float64]

#: Largest dense Jacobian in gigabytes.
MEMORY = 1.0


class Slsqp(ScipyNlp):
    """Backend for SciPy's ``minimize(method="SLSQP")``; multipliers are estimated from its point."""

    name = "slsqp"
    prompt = False
    options: ClassVar[Mapping[str, Option]] = {
        "max_iter": most_iterations(500),
    }
    summary = "SciPy's SLSQP: dense, for small programs"

    def refuses(self, problem: NonlinearProgram) -> str:
        """Return the reason why the program is too large, empty if it is not."""
        size = 8.0 * problem.size * (problem.size + problem.row_count) / 1e9
        if size <= MEMORY:
            return ""
        return (
            f"backend 'slsqp' is dense: {problem.row_count} rows and {problem.size} columns would "
            f"take {size:.1f} GB, and it stops at {MEMORY:g} GB"
        )

    def search(
        self, posed: Posed, bounds: Mapping[str, Vector], request: Request, start: Vector
    ) -> Ending:
        """Run SLSQP with the rows split into equations and inequalities."""
        from scipy.optimize import minimize

        low, high = bounds["lbg"], bounds["ubg"]
        equal = np.flatnonzero(low == high)
        above = np.flatnonzero(np.isfinite(low) & (low != high))
        below = np.flatnonzero(np.isfinite(high) & (low != high))
        constraints: list[dict[str, Any]] = []
        if equal.size:
            constraints.append(
                {
                    "type": "eq",
                    "fun": lambda z: posed.rows(z)[equal] - low[equal],
                    "jac": lambda z: posed.jacobian(z)[equal].toarray(),
                }
            )
        if above.size or below.size:

            def slack(z: Vector) -> Vector:
                rows = posed.rows(z)
                return np.concatenate([rows[above] - low[above], high[below] - rows[below]])

            def slopes(z: Vector) -> Vector:
                jacobian = posed.jacobian(z)
                whole: Vector = np.vstack([jacobian[above].toarray(), -jacobian[below].toarray()])
                return whole

            constraints.append({"type": "ineq", "fun": slack, "jac": slopes})
        result = minimize(
            posed.objective,
            start,
            jac=posed.gradient,
            method="SLSQP",
            bounds=np.column_stack([bounds["lbx"], bounds["ubx"]]),
            constraints=constraints,
            callback=posed.seen,
            options={
                "maxiter": request.options["max_iter"],
                "disp": request.verbose,
                "iprint": 2,
                # Applies to the objective, whose error is about the square of the point's error.
                "ftol": max(min(1e-11, request.tolerance * 1e-5), 1e-15),
            },
        )
        meanings: dict[int, Meaning] = {
            0: Ended.PROVEN,
            4: Ended.INFEASIBLE,
            9: (Ended.STOPPED, Limit.ITERATIONS),
        }
        ending = Ending.read(
            "slsqp",
            int(result.status),
            meanings,
            point=np.array(result.x, float),
            statistics={"iterations": int(result.nit)},
        )
        proven = ending.ended is Ended.PROVEN
        return replace(ending, message="" if proven else f"slsqp: {result.message}")
