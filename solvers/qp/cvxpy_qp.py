"""Quadratic programs through CVXPY's own modelling layer.

The backend ``cvxpy`` (:class:`crosstrack.solvers.mip.cvxpy_mip.CvxpyMip`) comes here with one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...errors import UnsupportedFormulation, UnsupportedOption
from ...models.programs.linear import QuadraticProgram
from ..attempts import Clock, Ended, Ending, solver_tolerance
from ..backend import Request
from ..cvxpy_library import solve_by_cvxpy

__all__ = ["attempt"]

#: How each solver is told: its time limit, and its tolerances. CVXPY hands on what it is given;
#: one that is not among these runs as it is by default.
_NAMES: dict[str, tuple[str, tuple[str, ...]]] = {
    "CLARABEL": ("time_limit", ("tol_feas", "tol_gap_abs", "tol_gap_rel")),
    "OSQP": ("time_limit", ("eps_abs", "eps_rel")),
    "HIGHS": ("time_limit", ("primal_feasibility_tolerance", "dual_feasibility_tolerance")),
    "SCS": ("time_limit_secs", ("eps_abs", "eps_rel")),
    "PIQP": ("", ("eps_abs", "eps_rel")),
    "DAQP": ("", ("primal_tol", "dual_tol")),
    "ECOS": ("", ("abstol", "reltol", "feastol")),
}
#: First-order methods need more iterations than their defaults allow.
_MORE = {"OSQP": {"max_iter": 200_000, "polishing": True}, "SCS": {"max_iters": 200_000}}
#: CVXPY's words for what a solver nearly proves: ours to prove.
_NEARLY = {"infeasible_inaccurate": Ended.INFEASIBLE, "unbounded_inaccurate": Ended.UNBOUNDED}


def attempt(program: QuadraticProgram, request: Request, clock: Clock) -> Ending:
    """Solve through CVXPY."""
    solver = str(request.options["solver"])
    time_name, tolerances = _NAMES.get(solver, ("", ()))
    options: dict[str, Any] = {
        **dict.fromkeys(tolerances, solver_tolerance(request.tolerance * 1e-2, 1e-10, 1e-8)),
        **_MORE.get(solver, {}),
    }
    if request.seed is not None:
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
    solved = solve_by_cvxpy(program, solver, options, time_name, clock)
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
