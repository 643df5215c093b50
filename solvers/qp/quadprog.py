"""quadprog: the dual method of Goldfarb and Idnani for strictly convex dense programs."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ...errors import UnsupportedFormulation
from ...models.programs.linear import QuadraticProgram
from ..attempts import Clock, Ended, Outcome
from ..backend import Option, Request
from .base import POLISH, QuadraticBackend, QuadraticOutcome, dense_memory
from .forms import ConicForm, independent_rows

__all__ = ["Quadprog"]

#: Gigabytes of dense data above which it is refused.
MEMORY = 2.0
#: Smallest eigenvalue, relative to the largest, with which the Cholesky factors are of use.
DEFINITE = 1e-13


class Quadprog(QuadraticBackend):
    """quadprog (Goldfarb and Idnani 1983) through qpsolvers.

    The method starts at the unconstrained minimum, so the Hessian must be positive definite: a linear
    program, or one with a flat direction, is refused in words.
    """

    name = "quadprog"
    requires = ("qpsolvers", "quadprog")
    distribution = "quadprog"
    options: ClassVar[Mapping[str, Option]] = {"polish": POLISH}
    summary = "quadprog: Goldfarb and Idnani's dual method, dense, strictly convex programs only"

    def refuses(self, problem: Any) -> str:
        """Return why `problem` is too large for dense arrays or plainly not definite, else ``""``."""
        rows = problem.row_count + 2 * problem.size
        needed = dense_memory(problem, rows)
        if needed > MEMORY:
            return (
                f"backend {self.name!r} is dense: {problem.row_count} rows and {problem.size} "
                f"columns would take {needed:.1f} GB, and it stops at {MEMORY:g} GB"
            )
        # Fixed columns are taken out before the solver sees the Hessian.
        free = problem.column_lower != problem.column_upper
        flat = np.flatnonzero(free & (problem.hessian.diagonal() == 0))
        if flat.size:
            return (
                f"backend {self.name!r} needs a positive definite Hessian: {flat.size} of "
                f"{problem.size} columns have none, {problem.column_name(int(flat[0]))} first"
            )
        return ""

    def attempt(self, program: QuadraticProgram, request: Request, clock: Clock) -> Outcome:
        """Solve with quadprog."""
        import qpsolvers

        hessian = program.hessian.toarray()
        values = np.linalg.eigvalsh(hessian)
        if values[0] <= DEFINITE * values[-1]:
            raise UnsupportedFormulation(
                f"backend {self.name!r} needs a positive definite Hessian: its eigenvalues range "
                f"from {values[0]:.3g} to {values[-1]:.3g}"
            )
        # Bounds go in as rows, where they are finite: qpsolvers hands quadprog infinite ones.
        posed, rows = independent_rows(program)
        form = ConicForm.of(posed)
        matrix, right, zeros = form.matrix.toarray(), form.right, form.zeros
        more = right.size > zeros
        problem = qpsolvers.Problem(
            P=hessian,
            q=program.cost,
            G=matrix[zeros:] if more else None,
            h=right[zeros:] if more else None,
            A=matrix[:zeros] if zeros else None,
            b=right[:zeros] if zeros else None,
        )
        clock.lap("build")
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            found = qpsolvers.solve_problem(problem, solver="quadprog")
        clock.lap("solve")
        message = "; ".join(str(one.message) for one in heard)
        if not found.found or found.x is None:
            return QuadraticOutcome(Ended.FAILED if message else Ended.INFEASIBLE, message=message)
        parts = [part for part in (found.y, found.z) if part is not None and len(part)]
        conic = np.concatenate(parts) if parts else np.zeros(0)
        duals = np.zeros(program.row_count)
        duals[rows] = form.duals(conic, rows.size)
        extras = found.extras or {}
        iterations = int(np.asarray(extras.get("iterations", [0])).ravel()[0])
        return QuadraticOutcome(
            Ended.PROVEN,
            np.array(found.x, float),
            None,
            duals,
            statistics={"iterations": iterations},
        )
