"""HiGHS on quadratic programs: its active-set method, or its simplex where the Hessian is zero.

The backend ``highs`` (:class:`crosstrack.solvers.mip.highs.Highs`) comes here with one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import InvalidData
from ...models.programs.linear import QuadraticProgram
from ..attempts import Clock, Ended, Ending, solver_tolerance
from ..backend import Request
from ..highs_library import meanings, run_highs

__all__ = ["attempt"]

#: Columns of the null space of what binds, above which HiGHS gives up; its own default is 4000.
NULLSPACE = 10_000


def attempt(program: QuadraticProgram, request: Request, clock: Clock) -> Ending:
    """Solve with HiGHS."""
    tolerance = solver_tolerance(request.tolerance * 1e-2, 1e-10, 1e-7)
    options = {
        "primal_feasibility_tolerance": tolerance,
        "dual_feasibility_tolerance": tolerance,
        "presolve": request.options["presolve"],
        "qp_nullspace_limit": NULLSPACE,
        # HiGHS adds this to the diagonal; what it shifts is measured, and polished away.
        "qp_regularization_value": 1e-7,
        # It was seen to cycle on semidefinite Hessians; the polish may know what it does not.
        "qp_iteration_limit": 5000 + 50 * (program.size + program.row_count),
    }
    posed = program
    if not program.row_count:
        # Without rows HiGHS forgets the Hessian, and calls the program unbounded or worse.
        posed = replace(
            program,
            matrix=sp.csr_array(([1.0], ([0], [0])), shape=(1, program.size)),
            row_lower=np.full(1, -np.inf),
            row_upper=np.full(1, np.inf),
        )
    # Nothing can stop it but the time limit: its quadratic solver has no callback, cannot go on
    # from where a limit ended it, and a thread left behind aborts the process when that exits.
    integral = np.zeros(program.size, bool)
    return _ending(
        run_highs(posed, integral, options, request, clock, _curve(program)), program, request
    )


def _curve(program: QuadraticProgram) -> Any:
    """Return what hands HiGHS the Hessian."""
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
            raise InvalidData(f"backend 'highs': HiGHS refuses the Hessian ({program.describe()})")

    return prepare


def _ending(highs: Any, program: QuadraticProgram, request: Request) -> Ending:
    status, info, solution = highs.getModelStatus(), highs.getInfo(), highs.getSolution()
    rows = program.row_count
    found = Ending.read("HiGHS", status, meanings(request), highs.modelStatusToString(status))
    # What HiGHS calls a "solve error" may be an optimum that misses its tolerance: it is measured.
    told = found.ended is Ended.FAILED
    point = duals = None
    if found.ended is Ended.UNBOUNDED:
        ray = highs.getPrimalRay()
        point = np.array(ray[2], float) if ray[1] else None
    elif (solution.value_valid or told) and len(solution.col_value) == program.size:
        point = np.array(solution.col_value, float)
    if found.ended is Ended.INFEASIBLE:
        ray = highs.getDualRay()
        duals = np.array(ray[2], float)[:rows] if ray[1] else None
    elif (solution.dual_valid or told) and len(solution.row_dual) >= rows:
        duals = np.array(solution.row_dual, float)[:rows]
    counts = {
        "iterations": max(int(info.qp_iteration_count), 0),
        "simplex iterations": max(int(info.simplex_iteration_count), 0),
    }
    return replace(found, point=point, duals=duals, statistics=counts)
