"""quadprog: the dual method of Goldfarb and Idnani for strictly convex dense programs."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...errors import UnsupportedFormulation
from ...models.programs.linear import QuadraticProgram
from ..contract.backend import Request
from ..programs.attempts import Clock, Ended, Ending
from .base import QuadraticBackend
from .forms import ConicForm, independent_rows
from .settings import too_large

__all__ = ["Quadprog"]

#: Smallest eigenvalue, relative to the largest, for which the Cholesky factors are accurate.
DEFINITE = 1e-13


class Quadprog(QuadraticBackend):
    """Backend for quadprog (Goldfarb and Idnani 1983) with dense arrays.

    The method starts at the unconstrained minimum, so the Hessian must be positive definite. Linear
    programs, and programs with a flat direction, are rejected.
    """

    name = "quadprog"
    requires = ("quadprog",)
    extra = "qp"
    deterministic = True
    summary = "quadprog: Goldfarb and Idnani's dual method, dense, strictly convex programs only"

    def refuses(self, problem: Any) -> str:
        """Return the reason why `problem` is too large or clearly not definite, empty if it is neither."""
        reason = too_large(f"backend {self.name!r}", problem, problem.row_count + 2 * problem.size)
        if reason:
            return reason
        # Fixed columns are removed before the solver receives the Hessian.
        free = problem.column_lower != problem.column_upper
        flat = np.flatnonzero(free & (problem.hessian.diagonal() == 0))
        if flat.size:
            return (
                f"backend {self.name!r} needs a positive definite Hessian: {flat.size} of "
                f"{problem.size} columns have none, {problem.column_name(int(flat[0]))} first"
            )
        return ""

    def attempt(self, program: QuadraticProgram, request: Request, clock: Clock) -> Ending:
        """Solve the program with quadprog."""
        import quadprog  # type: ignore[import-not-found]

        hessian = program.hessian.toarray()
        values = np.linalg.eigvalsh(hessian)
        if values[0] <= DEFINITE * values[-1]:
            raise UnsupportedFormulation(
                f"backend {self.name!r} needs a positive definite Hessian: its eigenvalues range "
                f"from {values[0]:.3g} to {values[-1]:.3g}"
            )
        posed, rows = independent_rows(program)
        form = ConicForm.of(posed)
        clock.lap("build")
        arguments = [hessian, -program.cost]
        if form.right.size:
            arguments += [-form.matrix.toarray().T, -form.right, form.zeros]
        try:
            x, _, _, iterations, multipliers, _ = quadprog.solve_qp(*arguments)
        except ValueError as error:
            ended = Ended.INFEASIBLE if "no solution" in str(error) else Ended.FAILED
            return Ending(ended, message=f"quadprog: {error}")
        finally:
            clock.lap("solve")
        duals = np.zeros(program.row_count)
        duals[rows] = form.duals(multipliers, rows.size)
        counts = {"iterations": int(iterations[0])}
        return Ending(Ended.PROVEN, np.array(x, float), duals=duals, statistics=counts)
