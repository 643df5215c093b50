"""HiGHS on quadratic programs: its active-set method, or its simplex where the Hessian is zero.

The backend ``highs`` (:class:`crosstrack.solvers.mip.highs.Highs`) comes here with one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import InvalidData, UnsupportedOption
from ...models.programs.linear import QuadraticProgram
from ..attempts import Clock, Ended, Outcome, limited, solver_tolerance
from ..backend import Limit, Option, Request
from ..mip.highs import pass_rows
from .base import QuadraticOutcome

__all__ = ["attempt", "refusal"]

#: Columns of the null space of what binds, above which HiGHS gives up; its own default is 4000.
NULLSPACE = 10_000


def refusal(options: Mapping[str, Option], request: Request) -> str:
    """Return which option asked for says nothing to a quadratic program, else ``""``."""
    name = "mip_heuristic_effort"
    if request.options.get(name, options[name].default) != options[name].default:
        return f"backend 'highs': {name} is for mixed-integer programs, not for quadratic ones"
    return ""


def attempt(program: QuadraticProgram, request: Request, clock: Clock) -> Outcome:
    """Solve with HiGHS."""
    import highspy

    highs = highspy.Highs()
    tolerance = solver_tolerance(request.tolerance * 1e-2, 1e-10, 1e-7)
    options: dict[str, Any] = {
        "output_flag": False,
        "primal_feasibility_tolerance": tolerance,
        "dual_feasibility_tolerance": tolerance,
        "presolve": request.options.get("presolve", "choose"),
        "qp_nullspace_limit": NULLSPACE,
        # HiGHS adds this to the diagonal; what it shifts is measured, and polished away.
        "qp_regularization_value": 1e-7,
    }
    if request.seed is not None:
        options["random_seed"] = request.seed % (2**31)
    if request.threads is not None:
        highspy.Highs.resetGlobalScheduler(True)
        options["threads"] = request.threads
    for name, value in options.items():
        if highs.setOptionValue(name, value) == highspy.HighsStatus.kError:
            raise UnsupportedOption(f"backend 'highs': HiGHS refuses {name} = {value!r}")
    # It was seen to cycle on semidefinite Hessians; the polish may know what it does not.
    highs.setOptionValue("qp_iteration_limit", 5000 + 50 * (program.size + program.row_count))
    _pass(highspy, highs, program)
    clock.lap("build")
    left = clock.left()
    if left is not None:
        highs.setOptionValue("time_limit", left)
    # Nothing can stop it but that limit: its quadratic solver has no callback, cannot go on from
    # where a limit ended it, and a thread left behind aborts the process when that exits.
    try:
        highs.run()
    finally:
        if request.threads is not None:
            highspy.Highs.resetGlobalScheduler(True)
    clock.lap("solve")
    return _outcome(highspy, highs, program, request)


def _pass(highspy: Any, highs: Any, program: QuadraticProgram) -> None:
    if not program.row_count:
        # Without rows HiGHS forgets the Hessian, and calls the program unbounded or worse.
        program = replace(
            program,
            matrix=sp.csr_array(([1.0], ([0], [0])), shape=(1, program.size)),
            row_lower=np.full(1, -np.inf),
            row_upper=np.full(1, np.inf),
        )
    pass_rows(highspy, highs, program, np.zeros(program.size, bool))
    lower = sp.csc_array(sp.tril(program.hessian))
    if not lower.nnz:
        return
    passed = highs.passHessian(
        program.size,
        lower.nnz,
        int(highspy.HessianFormat.kTriangular),
        lower.indptr.astype(np.int32),
        lower.indices.astype(np.int32),
        lower.data,
    )
    if passed == highspy.HighsStatus.kError:
        raise InvalidData(f"backend 'highs': HiGHS refuses the Hessian ({program.describe()})")


def _outcome(highspy: Any, highs: Any, program: QuadraticProgram, request: Request) -> Outcome:
    state = highspy.HighsModelStatus
    status, info = highs.getModelStatus(), highs.getInfo()
    ended, limit = {
        state.kOptimal: (Ended.PROVEN, None),
        state.kInfeasible: (Ended.INFEASIBLE, None),
        state.kUnbounded: (Ended.UNBOUNDED, None),
        state.kUnboundedOrInfeasible: (Ended.UNCLEAR, None),
        state.kTimeLimit: (Ended.STOPPED, Limit.TIME),
        state.kIterationLimit: (Ended.STOPPED, Limit.ITERATIONS),
        state.kMemoryLimit: (Ended.STOPPED, Limit.MEMORY),
        state.kInterrupt: (Ended.STOPPED, limited(request.control)),
    }.get(status, (Ended.FAILED, None))
    solution, rows = highs.getSolution(), program.row_count
    # What HiGHS calls a "solve error" may be an optimum that misses its tolerance: it is measured.
    told = ended is Ended.FAILED
    point = duals = None
    if (solution.value_valid or told) and len(solution.col_value) == program.size:
        point = np.array(solution.col_value, float)
    if (solution.dual_valid or told) and len(solution.row_dual) >= rows:
        duals = np.array(solution.row_dual, float)[:rows]
    ray = direction = None
    if ended is Ended.INFEASIBLE:
        found = highs.getDualRay()
        ray = np.array(found[2], float)[:rows] if found[1] else None
    if ended is Ended.UNBOUNDED:
        found = highs.getPrimalRay()
        direction = np.array(found[2], float) if found[1] else None
    counts = {
        "iterations": max(int(info.qp_iteration_count), 0),
        "simplex iterations": max(int(info.simplex_iteration_count), 0),
    }
    return QuadraticOutcome(
        ended,
        point,
        None,
        duals,
        limit,
        counts,
        "" if ended is not Ended.FAILED else f"HiGHS: {highs.modelStatusToString(status)}",
        ray=ray,
        direction=direction,
    )
