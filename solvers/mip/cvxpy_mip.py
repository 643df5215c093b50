"""CVXPY's modelling layer: mixed-integer, quadratic and conic programs."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp

from ...errors import InvalidData, UnsupportedOption
from ...models.model import Model
from ...models.programs.base import RowProgram
from ...models.programs.conic import ConicProgram
from ...models.programs.linear import MixedIntegerProgram, QuadraticProgram
from ..conic.base import ConicRun
from ..contract.backend import Answer, Feature, Option, Request
from ..programs.attempts import Clock, Ended, Ending, ending_if_stopped, solver_tolerance
from ..programs.cvxpy_library import Solved, chosen, found, solve_by_cvxpy
from ..qp.base import UNPOLISHED, answered
from ..qp.cvxpy_qp import attempt as attempt_quadratic
from ..qp.settings import POLISH
from .base import IntegerProgram, ProgramBackend, with_cutoff_row, with_offset_column
from .highs import ending, search

__all__ = ["CvxpyMip"]


class CvxpyMip(ProgramBackend):
    """Backend for CVXPY: the program is posed as a ``cvxpy.Problem`` and canonicalised by CVXPY.

    Its translation is independent of the other backends, which is useful for a cross-check. The
    declared features are those with HiGHS; options that another solver does not support raise.
    """

    name = "cvxpy"
    accepts = (MixedIntegerProgram, QuadraticProgram, ConicProgram)
    integral_kinds = ("quadratic-program",)
    features = frozenset(
        {
            Feature.GAP,
            Feature.SEED,
            Feature.THREADS,
            Feature.CUTOFF,
            Feature.INCUMBENTS,
            Feature.DUAL_BOUND,
            Feature.DUALS,
            Feature.LOG,
        }
    )
    requires = ("cvxpy",)
    # CVXPY probes its solvers on import and so loads highspy; see Highs.
    conflict_group = "highs"
    natives = ("highspy._core",)
    options: ClassVar[Mapping[str, Option]] = {
        "solver": Option(
            None,
            "Name in CVXPY of an installed solver that supports the program. Default: HIGHS for "
            "mixed-integer programs, SCIP for integer quadratic ones, CLARABEL for other quadratic "
            "and conic ones.",
            str,
        ),
        "polish": POLISH,
    }
    summary = "CVXPY: HiGHS, SCIP, Clarabel, OSQP and others behind its modelling layer"

    @staticmethod
    def found() -> dict[str, tuple[str, ...]]:
        """Return the available values of ``solver`` by kind of program. CVXPY is imported."""
        return {kind: found(kind) for kind in ("mixed-integer", "quadratic")}

    def comparison_options(self, kind: type[Model[Any]]) -> Mapping[str, Any]:
        return {} if issubclass(kind, MixedIntegerProgram) else UNPOLISHED

    def run(self, problem: RowProgram, request: Request) -> Answer:
        """Solve a mixed-integer, quadratic or conic program, see :meth:`Backend.run`."""
        self.require()
        if isinstance(problem, ConicProgram) and not problem.cones:
            problem = problem.quadratic
        solver = chosen(problem, request.options.get("solver"))
        request = replace(request, options={**request.options, "solver": solver})
        if isinstance(problem, ConicProgram):
            return answered(self, problem, request, attempt_quadratic, ConicRun)
        if isinstance(problem, QuadraticProgram) and problem.continuous:
            return answered(self, problem, request, attempt_quadratic)
        assert isinstance(problem, IntegerProgram)
        return super().run(problem, request)

    def refuses(self, problem: RowProgram) -> str:
        """Return a reason for a quadratic program with integral columns if SCIP is missing or it is not convex."""
        if not isinstance(problem, QuadraticProgram) or problem.continuous:
            return ""
        if importlib.util.find_spec("pyscipopt") is None:
            return "backend 'cvxpy': integer quadratic programs need SCIP: pip install 'crosstrack[scip]'"
        try:
            problem.require_convex()
        except InvalidData:
            return (
                "backend 'cvxpy': integer quadratic programs must be convex; 'scip' accepts others"
            )
        return ""

    def attempt(self, program: IntegerProgram, request: Request, clock: Clock) -> Ending:
        """Solve the program through CVXPY."""
        solver = str(request.options["solver"])
        if (
            isinstance(program, MixedIntegerProgram)
            and solver == "HIGHS"
            and not program.continuous
        ):
            return _called_back(program, request, clock)
        if request.target is not None:
            raise UnsupportedOption(
                f"backend 'cvxpy': solver={solver!r} reports no incumbents, so it cannot stop at a target"
            )
        posed = program
        if isinstance(program, MixedIntegerProgram):
            posed = with_cutoff_row(program, request.cutoff)
        posed = with_offset_column(posed)
        # CVXPY's interface to SCIP fails on rows without entries, which are satisfied at this point.
        rows = np.flatnonzero(np.diff(posed.matrix.indptr))
        posed = posed.only_rows(rows)
        names = _NAMES.get(solver, {})
        options = _solver_options(solver, names, program, request)
        try:
            if solver == "HIGHS" and request.threads is not None:
                _fresh_scheduler()
            solved = solve_by_cvxpy(
                posed, solver, options, names.get("time", ("",))[0], clock, request.verbose
            )
        finally:
            if solver == "HIGHS" and request.threads is not None:
                _fresh_scheduler()
        result = _ending(solver, solved, program)
        # CVXPY's duals from SCIP are unreliable: they omit those of rows with one column.
        if result.ended is Ended.PROVEN and program.continuous and solver != "SCIP":
            duals = np.zeros(program.row_count)
            duals[rows] = solved.row_duals()
            result = replace(result, duals=duals)
        return result


def _called_back(program: MixedIntegerProgram, request: Request, clock: Clock) -> Ending:
    """Solve CVXPY's canonical form of `program` with HiGHS, which is called directly.

    Within CVXPY, HiGHS cannot be stopped, and its incumbents are lost with its process.
    """
    problem, columns = with_offset_column(program).to_cvxpy()
    late = ending_if_stopped(request, clock)
    if late is not None:
        return late
    data = problem.get_problem_data("HIGHS")[0]
    sides, size = data["b"], data["c"].size
    posed = MixedIntegerProgram(
        cost=data["c"],
        matrix=sp.csr_array(data["A"]),
        row_lower=np.where(np.arange(sides.size) < data["dims"].zero, sides, -np.inf),
        row_upper=sides,
        column_lower=np.full(size, -np.inf),
        column_upper=np.full(size, np.inf),
        integral=np.isin(np.arange(size), data["int_vars_idx"]),
    )
    first = data["param_prob"].var_id_to_col[columns.id]
    columns_of_program = slice(first, first + program.size)

    def report(objective: float, point: Any) -> None:
        request.control.incumbent(objective, point[columns_of_program])

    with request.control.stage(None, report, request.control.prove) as control:
        stage_request = replace(request, control=control)
        result = ending(search(posed, stage_request, clock), posed, stage_request)
    return replace(
        result,
        point=None if result.point is None else result.point[columns_of_program],
        statistics={"solver": "HIGHS", **result.statistics},
    )


def _fresh_scheduler() -> None:
    """Reset the scheduler of HiGHS, which otherwise keeps its first number of threads."""
    import highspy

    highspy.Highs.resetGlobalScheduler(True)


def _solver_options(
    solver: str,
    names: Mapping[str, tuple[str, ...]],
    program: IntegerProgram,
    request: Request,
) -> dict[str, Any]:
    """Return the common options under the solver's names, or raise if it does not support them.

    Gap and tolerance, which do not decide about the plan, are omitted for a solver without `names`.
    """
    values = {
        "gap": None if program.continuous else request.gap,
        "absolute gap": None if program.continuous else 0.0,
        "seed": None if request.seed is None else request.seed % (2**31),
        "threads": request.threads,
        "tolerance": solver_tolerance(request, 1e-9),
    }
    options: dict[str, Any] = {}
    for option, value in values.items():
        if value is None:
            continue
        if option not in names and option in ("seed", "threads"):
            raise UnsupportedOption(f"backend 'cvxpy': solver={solver!r} takes no {option}")
        options.update(dict.fromkeys(names.get(option, ()), value))
    return options


_NAMES: dict[str, dict[str, tuple[str, ...]]] = {
    "HIGHS": {
        "time": ("time_limit",),
        "seed": ("random_seed",),
        "threads": ("threads",),
        "tolerance": ("primal_feasibility_tolerance", "dual_feasibility_tolerance"),
    },
    "SCIP": {
        "time": ("limits/time",),
        "gap": ("limits/gap",),
        "absolute gap": ("limits/absgap",),
        "seed": ("randomization/randomseedshift",),
        "tolerance": ("numerics/feastol", "numerics/dualfeastol"),
    },
}


def _ending(solver: str, solved: Solved, program: IntegerProgram) -> Ending:
    ended, limit = solved.end()
    extra, failed = solved.extra, ended is Ended.FAILED
    counts: dict[str, float | int | str] = {"solver": solver}
    bound = None
    if solver == "SCIP" and extra is not None:
        bound, counts["nodes"] = (
            float(extra["model"].getDualbound()),
            int(extra["model"].getNTotalNodes()),
        )
        if extra.get("scip_status") == "gaplimit" and not failed:
            ended, limit = Ended.PROVEN, None
    if program.continuous:
        bound = float(solved.problem.value) if ended is Ended.PROVEN else None
    elif ended is Ended.PROVEN and bound is None:
        # Optimal within the solver's own gap, which CVXPY does not report.
        ended = Ended.STOPPED
    point = solved.point(ended)
    return Ending(
        ended,
        None if point is None else point[: program.size],
        bound if ended in (Ended.PROVEN, Ended.STOPPED) else None,
        limit=limit,
        statistics=counts,
        message=f"CVXPY with {solver}: {solved.error or solved.problem.status}" if failed else "",
    )
