"""Quadratic programs through CVXPY's own modelling layer.

The backend ``cvxpy`` (:class:`crosstrack.solvers.mip.cvxpy_mip.CvxpyMip`) comes here with one.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from ...errors import UnsupportedFormulation, UnsupportedOption
from ...models.programs.export_conic import cvxpy_cone_duals
from ...models.programs.linear import QuadraticProgram
from ..attempts import Clock, Ended, Outcome, solver_tolerance
from ..backend import Limit, Request
from ..mip.cvxpy_mip import row_duals
from .base import QuadraticOutcome

__all__ = ["attempt"]

#: How each solver is told: its time limit, and its tolerances. CVXPY hands on what it is given.
_NAMES: dict[str, tuple[str, tuple[str, ...]]] = {
    "CLARABEL": ("time_limit", ("tol_feas", "tol_gap_abs", "tol_gap_rel")),
    "OSQP": ("time_limit", ("eps_abs", "eps_rel")),
    "HIGHS": ("time_limit", ("primal_feasibility_tolerance", "dual_feasibility_tolerance")),
    "SCS": ("time_limit_secs", ("eps_abs", "eps_rel")),
    "PIQP": ("", ("eps_abs", "eps_rel")),
}
#: First-order methods need more iterations than their defaults allow.
_MORE = {"OSQP": {"max_iter": 200_000, "polishing": True}, "SCS": {"max_iters": 200_000}}


def attempt(program: QuadraticProgram, request: Request, clock: Clock) -> Outcome:
    """Solve through CVXPY."""
    import cvxpy

    solver = str(request.options["solver"])
    time_name, tolerances = _NAMES[solver]
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
    problem, columns = program.to_cvxpy()
    if solver == "SCS" and not problem.constraints:
        raise UnsupportedFormulation(
            "backend 'cvxpy': solver='SCS' needs a row or a bound; the program has neither"
        )
    made: Any = problem
    made.get_problem_data(solver)
    clock.lap("build")
    left = clock.left()
    if left is not None and time_name:
        options[time_name] = max(left, 1e-3)
    error = ""
    try:
        with warnings.catch_warnings():
            # CVXPY warns that a limit makes a solution inaccurate; it is measured here.
            warnings.simplefilter("ignore")
            made.solve(solver=solver, verbose=False, **options)
    except cvxpy.SolverError as refused:
        error = str(refused)
    clock.lap("solve")
    late = left is not None and clock.left() == 0.0
    status = str(problem.status)
    ended, limit = {
        "optimal": (Ended.PROVEN, None),
        "optimal_inaccurate": (Ended.STOPPED, Limit.TIME if late else Limit.ITERATIONS),
        "infeasible": (Ended.INFEASIBLE, None),
        "infeasible_inaccurate": (Ended.INFEASIBLE, None),
        "unbounded": (Ended.UNBOUNDED, None),
        "unbounded_inaccurate": (Ended.UNBOUNDED, None),
        "infeasible_or_unbounded": (Ended.UNCLEAR, None),
        "user_limit": (Ended.STOPPED, Limit.TIME if late else Limit.ITERATIONS),
    }.get(status, (Ended.STOPPED, Limit.TIME) if late else (Ended.FAILED, None))
    if error and not late:
        ended, limit = Ended.FAILED, None
    point = None
    duals = None
    if columns.value is not None and ended in (Ended.PROVEN, Ended.STOPPED):
        point = np.array(columns.value, float)
        cones = cvxpy_cone_duals(problem, getattr(program, "cones", ()))
        duals = np.concatenate([row_duals(problem, program), cones])
    counts: dict[str, float | int | str] = {"solver": solver}
    iterations = getattr(problem.solver_stats, "num_iters", None)
    if iterations is not None:
        counts["iterations"] = int(iterations)
    return QuadraticOutcome(
        ended,
        point,
        None,
        duals,
        limit,
        counts,
        f"CVXPY with {solver}: {error or status}" if ended is Ended.FAILED else "",
    )
