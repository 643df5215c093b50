"""Quadratic programs through the modelling layer of CVXPY.

Called by the backend ``cvxpy`` (:class:`crosstrack.solvers.mip.cvxpy_mip.CvxpyMip`).
"""

from __future__ import annotations

import numpy as np

from ...errors import UnsupportedFormulation, UnsupportedOption
from ...models.programs.linear import QuadraticProgram
from ..contract.backend import Request
from ..programs.attempts import Clock, Ended, Ending
from ..programs.cvxpy_library import solve_by_cvxpy
from .settings import told

__all__ = ["attempt"]

#: Solvers without random numbers, for which any seed is accepted.
_DRAW_NOTHING = frozenset({"CLARABEL", "DAQP", "ECOS", "OSQP", "PIQP", "PROXQP", "SCS"})
#: Statuses of CVXPY that are nearly proven; the claims are recomputed here.
_NEARLY = {"infeasible_inaccurate": Ended.INFEASIBLE, "unbounded_inaccurate": Ended.UNBOUNDED}


def attempt(program: QuadraticProgram, request: Request, clock: Clock) -> Ending:
    """Solve a quadratic program through CVXPY.

    UnsupportedOption and UnsupportedFormulation: the selected solver does not support an option or the program.
    """
    solver = str(request.options["solver"])
    time_name, options = told(solver.lower(), request)
    if solver == "OSQP":
        options["polishing"] = True
    if request.seed is not None and solver not in _DRAW_NOTHING:
        if solver != "HIGHS":
            raise UnsupportedOption(f"backend 'cvxpy': solver={solver!r} takes no seed")
        options["random_seed"] = request.seed % (2**31)
    if request.threads is not None and request.threads > 1:
        raise UnsupportedOption(
            f"backend 'cvxpy': solver={solver!r} takes no threads beyond one for quadratic programs"
        )
    bounds = np.concatenate([program.column_lower, program.column_upper])
    if solver == "SCS" and not program.row_count and not np.isfinite(bounds).any():
        raise UnsupportedFormulation(
            "backend 'cvxpy': solver='SCS' needs a row or a bound; the program has neither"
        )
    solved = solve_by_cvxpy(program, solver, options, time_name, clock, request.verbose)
    status = str(solved.problem.status)
    ended, limit = solved.end()
    if status in _NEARLY and not solved.error:
        ended, limit = _NEARLY[status], None
    point = solved.point(ended)
    counts: dict[str, float | int | str] = {"solver": solver}
    iterations = getattr(solved.problem.solver_stats, "num_iters", None)
    if iterations is not None:
        counts["iterations"] = int(iterations)
    return Ending(
        ended,
        point,
        duals=None if point is None else solved.row_duals(),
        limit=limit,
        statistics=counts,
        message=f"CVXPY with {solver}: {solved.error or status}" if ended is Ended.FAILED else "",
    )
