"""HiGHS for quadratic programs: its active-set method, or its simplex method if the Hessian is zero.

Called by the backend ``highs`` (:class:`crosstrack.solvers.mip.highs.Highs`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import InvalidData
from ...models.programs.linear import QuadraticProgram
from ..contract.backend import Request
from ..programs.attempts import Clock, Ended, Ending, solver_tolerance
from ..programs.highs_library import meanings, run_highs

__all__ = ["attempt"]

#: Largest dimension of the null space of the active set, above which HiGHS fails. Its default: 4000.
NULLSPACE = 10_000


def attempt(program: QuadraticProgram, request: Request, clock: Clock) -> Ending:
    """Solve a quadratic program with HiGHS."""
    tolerance = solver_tolerance(request, 1e-10, 1e-7, share=1e-2)
    options = {
        "primal_feasibility_tolerance": tolerance,
        "dual_feasibility_tolerance": tolerance,
        "presolve": request.options["presolve"],
        "qp_nullspace_limit": NULLSPACE,
        # HiGHS adds this to the diagonal; the shift is measured and removed by polishing.
        "qp_regularization_value": 1e-7,
        # HiGHS cycled on semidefinite Hessians; polishing may still succeed.
        "qp_iteration_limit": 5000 + 50 * (program.size + program.row_count),
    }
    posed = program
    if not program.row_count:
        # Without rows, HiGHS ignores the Hessian and claims the program unbounded.
        posed = replace(
            program,
            matrix=sp.csr_array(([1.0], ([0], [0])), shape=(1, program.size)),
            row_lower=np.full(1, -np.inf),
            row_upper=np.full(1, np.inf),
        )
    # Only the time limit can stop it: the quadratic solver has no callback and cannot continue after
    # a limit, and an abandoned thread aborts the process at its exit.
    integral = np.zeros(program.size, bool)
    return _ending(
        run_highs(posed, integral, options, request, clock, _curve(program)), program, request
    )


def _curve(program: QuadraticProgram) -> Any:
    """Return a function that passes the Hessian to HiGHS."""
    import highspy

    lower = sp.csc_array(sp.tril(program.hessian))

    def prepare(highs: Any) -> None:
        if (
            lower.nnz
            and highs.passHessian(
                program.size,
                lower.nnz,
                int(highspy.HessianFormat.kTriangular),
                lower.indptr.astype(np.int32),
                lower.indices.astype(np.int32),
                lower.data,
            )
            == highspy.HighsStatus.kError
        ):
            raise InvalidData(f"backend 'highs': HiGHS refuses the Hessian ({program.outline()})")

    return prepare


def _ending(highs: Any, program: QuadraticProgram, request: Request) -> Ending:
    status, info, solution = highs.getModelStatus(), highs.getInfo(), highs.getSolution()
    rows = program.row_count
    ending = Ending.read("HiGHS", status, meanings(request), highs.modelStatusToString(status))
    # A "solve error" of HiGHS may be an optimum outside its tolerance, so the point is measured.
    has_failed = ending.ended is Ended.FAILED
    point = duals = None
    if ending.ended is Ended.UNBOUNDED:
        ray = highs.getPrimalRay()
        point = np.array(ray[2], float) if ray[1] else None
    elif (solution.value_valid or has_failed) and len(solution.col_value) == program.size:
        point = np.array(solution.col_value, float)
    if ending.ended is Ended.INFEASIBLE:
        ray = highs.getDualRay()
        duals = np.array(ray[2], float)[:rows] if ray[1] else None
    elif (solution.dual_valid or has_failed) and len(solution.row_dual) >= rows:
        duals = np.array(solution.row_dual, float)[:rows]
    counts = {
        "iterations": max(int(info.qp_iteration_count), 0),
        "simplex iterations": max(int(info.simplex_iteration_count), 0),
    }
    return replace(ending, point=point, duals=duals, statistics=counts)
