"""Solvers of the package qpsolvers, through its common interface."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp

from ...errors import UnsupportedFormulation, UnsupportedOption
from ...models.programs.linear import QuadraticProgram
from ..contract.backend import Feature, Option, Request
from ..programs.attempts import Clock, Ended, Ending
from .base import COMMON, QuadraticBackend
from .forms import ConicForm
from .settings import POLISH, told, too_large

__all__ = ["EXCLUDED", "Qpsolvers"]

#: Solvers of qpsolvers that are not offered, with the reason.
EXCLUDED: Mapping[str, str] = {
    "gurobi": "qpsolvers lets it print its licence on the standard output",
}


class Qpsolvers(QuadraticBackend):
    """Backend for the solvers of qpsolvers (Caron et al.).

    qpsolvers reports whether a solver found an optimum, but no other ending, so infeasibility is proven
    here. Most of its solvers also have backends of their own, which use more of their features.
    """

    name = "qpsolvers"
    features = COMMON | {Feature.LOG}
    requires = ("qpsolvers",)
    # qpsolvers imports every installed solver, including highspy; see Highs.
    conflict_group = "highs"
    natives = ("highspy._core",)
    options: ClassVar[Mapping[str, Option]] = {
        "polish": POLISH,
        "solver": Option("clarabel", "Name of a solver in qpsolvers.", str),
    }
    deterministic = True
    summary = "qpsolvers: Clarabel, HiGHS, OSQP, ProxQP and other installed solvers, by option"

    @staticmethod
    def found() -> tuple[str, ...]:
        """Return the available values of ``solver``. qpsolvers and its solvers are imported."""
        import qpsolvers

        return tuple(name for name in qpsolvers.available_solvers if name not in EXCLUDED)

    def attempt(self, program: QuadraticProgram, request: Request, clock: Clock) -> Ending:
        """Solve the program through qpsolvers."""
        import qpsolvers

        solver = str(request.options["solver"])
        if solver not in self.found():
            why = EXCLUDED.get(solver, "qpsolvers does not find it")
            raise UnsupportedOption(
                f"backend 'qpsolvers': solver={solver!r} is not available: {why}; "
                f"available: {', '.join(self.found())}"
            )
        form = ConicForm.of(program)
        dense = solver not in qpsolvers.sparse_solvers
        reason = too_large(f"backend 'qpsolvers': solver={solver!r}", program, form.right.size)
        if dense and reason:
            raise UnsupportedFormulation(reason)
        time_name, options = told(solver, request)
        problem = _posed(qpsolvers, program, form, dense)
        clock.lap("build")
        left = clock.left()
        if left is not None and time_name:
            options[time_name] = max(left, 1e-3)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                result = qpsolvers.solve_problem(
                    problem, solver=solver, verbose=request.verbose, **options
                )
            except qpsolvers.exceptions.ProblemError as error:
                if "unbounded" in str(error):
                    return Ending(Ended.UNBOUNDED)
                raise UnsupportedFormulation(
                    f"backend 'qpsolvers': solver={solver!r}: {error}"
                ) from error
            except (qpsolvers.exceptions.SolverError, ValueError, RuntimeError) as error:
                return Ending(Ended.FAILED, message=f"qpsolvers with {solver}: {error}")
            finally:
                clock.lap("solve")
        words = "; ".join([*(str(warning.message) for warning in caught), "no optimum was found"])
        posed = form.right.size > 0  # otherwise the row was added
        known = [np.ravel(part) for part in (result.y, result.z) if posed and part is not None]
        duals = np.concatenate([np.zeros(0), *known])
        return Ending(
            Ended.PROVEN if result.found else Ended.FAILED,
            None if result.x is None else np.array(result.x, float),
            duals=form.duals(duals, program.row_count) if duals.size == form.right.size else None,
            statistics={"solver": solver},
            message="" if result.found else f"qpsolvers with {solver}: {words}",
        )


def _posed(qpsolvers: Any, program: QuadraticProgram, form: ConicForm, dense: bool) -> Any:
    """Return the ``qpsolvers.Problem`` with bounds as rows, because some solvers fail on infinite ones."""
    matrix, hessian = form.matrix.tocsr(), program.hessian.tocsc()

    def rows(part: slice) -> tuple[Any, Any]:
        if not form.right[part].size:
            return None, None
        return matrix[part].toarray() if dense else matrix[part].tocsc(), form.right[part]

    equal, above = rows(slice(0, form.zeros)), rows(slice(form.zeros, None))
    if not form.right.size:
        # Without rows, qpsolvers calls SciPy's LSQR instead of the solver.
        nothing = np.zeros((1, program.size))
        above = (nothing if dense else sp.csc_array(nothing), np.zeros(1))
    return qpsolvers.Problem(
        hessian.toarray() if dense else hessian, program.cost.copy(), *above, *equal
    )
