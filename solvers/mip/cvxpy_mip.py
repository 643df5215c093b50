"""CVXPY's own modelling layer: HiGHS or SCIP on mixed-integer programs, more on quadratic ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp

from ...errors import UnsupportedOption
from ...models.model import Model
from ...models.programs.base import RowProgram
from ...models.programs.conic import ConicProgram
from ...models.programs.linear import MixedIntegerProgram, QuadraticProgram
from ..attempts import Clock, Ended, Ending, ending_if_stopped, solver_tolerance
from ..backend import Answer, Feature, Option, Request
from ..conic.base import ConicRun
from ..cvxpy_library import Solved, chosen, found, solve_by_cvxpy
from ..qp.base import POLISH, UNPOLISHED, answered
from ..qp.cvxpy_qp import attempt as attempt_quadratic
from .base import ProgramBackend, with_cutoff_row, with_offset_column
from .highs import ending, search

__all__ = ["CvxpyMip"]


class CvxpyMip(ProgramBackend):
    """CVXPY: the program is posed as a ``cvxpy.Problem`` and canonicalised by CVXPY.

    That is a way of its own from the program to the solver, worth a cross-check of the others. Its
    features are those with HiGHS; what another solver cannot take from CVXPY raises.
    """

    name = "cvxpy"
    accepts = (MixedIntegerProgram, QuadraticProgram, ConicProgram)
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
    # CVXPY probes its solvers as it is imported and so loads highspy: see Highs.
    conflict_group = "highs"
    natives = ("highspy._core",)
    options: ClassVar[Mapping[str, Option]] = {
        "solver": Option(
            None,
            "CVXPY's name of any solver that it finds and that takes the program; HIGHS for "
            "mixed-integer programs and CLARABEL for quadratic ones by default.",
            str,
        ),
        "polish": POLISH,
    }
    summary = "CVXPY: HiGHS, SCIP, Clarabel, OSQP … behind a modelling layer of its own"

    @staticmethod
    def found() -> dict[str, tuple[str, ...]]:
        """Return the values of ``solver`` to be had here, by kind of program; CVXPY is imported."""
        return {kind: found(kind) for kind in ("mixed-integer", "quadratic")}

    def comparison_options(self, kind: type[Model[Any]]) -> Mapping[str, Any]:
        return {} if issubclass(kind, MixedIntegerProgram) else UNPOLISHED

    def run(self, problem: RowProgram, request: Request) -> Answer:
        """Solve `problem`, of either kind, as `request` asks."""
        self.require()
        if isinstance(problem, ConicProgram) and not problem.cones:
            problem = problem.quadratic
        solver = chosen(problem, request.options.get("solver"))
        request = replace(request, options={**request.options, "solver": solver})
        if isinstance(problem, ConicProgram):
            return answered(self, problem, request, attempt_quadratic, ConicRun)
        if isinstance(problem, QuadraticProgram):
            return answered(self, problem, request, attempt_quadratic)
        assert isinstance(problem, MixedIntegerProgram)
        return super().run(problem, request)

    def attempt(self, program: MixedIntegerProgram, request: Request, clock: Clock) -> Ending:
        """Solve through CVXPY."""
        solver = str(request.options["solver"])
        if solver == "HIGHS" and not program.continuous:
            return _called_back(program, request, clock)
        if request.target is not None:
            raise UnsupportedOption(
                f"backend 'cvxpy': solver={solver!r} reports no incumbents, and so stops at no target"
            )
        posed = with_offset_column(with_cutoff_row(program, request.cutoff))
        # CVXPY's interface to SCIP fails on rows without entries, which are known to hold by now.
        rows = np.flatnonzero(np.diff(posed.matrix.indptr))
        posed = posed.only_rows(rows)
        names = _NAMES.get(solver, {})
        options = _told(solver, names, program, request)
        try:
            if solver == "HIGHS" and request.threads is not None:
                _fresh_scheduler()
            solved = solve_by_cvxpy(
                posed, solver, options, names.get("time", ("",))[0], clock, request.verbose
            )
        finally:
            if solver == "HIGHS" and request.threads is not None:
                _fresh_scheduler()
        found = _ending(solver, solved, program)
        # CVXPY's own tests doubt the duals it reads from SCIP, which lacks those of one-column rows.
        if found.ended is Ended.PROVEN and program.continuous and solver != "SCIP":
            duals = np.zeros(program.row_count)
            duals[rows] = solved.row_duals()
            found = replace(found, duals=duals)
        return found


def _called_back(program: MixedIntegerProgram, request: Request, clock: Clock) -> Ending:
    """Solve what CVXPY makes of `program` with HiGHS, which is called here.

    Where CVXPY calls it, it takes no stop, and what it has found is lost with its process.
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
    own = slice(first, first + program.size)

    def report(objective: float, point: Any) -> None:
        request.control.incumbent(objective, point[own])

    with request.control.stage(None, report, request.control.prove) as control:
        asked = replace(request, control=control)
        found = ending(search(posed, asked, clock), posed, asked)
    return replace(
        found,
        point=None if found.point is None else found.point[own],
        statistics={"solver": "HIGHS", **found.statistics},
    )


def _fresh_scheduler() -> None:
    """Let HiGHS start threads anew: its scheduler keeps the number it was first given."""
    import highspy

    highspy.Highs.resetGlobalScheduler(True)


def _told(
    solver: str,
    names: Mapping[str, tuple[str, ...]],
    program: MixedIntegerProgram,
    request: Request,
) -> dict[str, Any]:
    """Return the common request in the solver's own words, or raise where it has none.

    What decides no plan, the gap and the tolerance, is left as it is for a solver without `names`.
    """
    asked = {
        "gap": None if program.continuous else request.gap,
        "absolute gap": None if program.continuous else 0.0,
        "seed": None if request.seed is None else request.seed % (2**31),
        "threads": request.threads,
        "tolerance": solver_tolerance(request.tolerance, 1e-9),
    }
    options: dict[str, Any] = {}
    for what, value in asked.items():
        if value is None:
            continue
        if what not in names and what in ("seed", "threads"):
            raise UnsupportedOption(f"backend 'cvxpy': solver={solver!r} takes no {what}")
        options.update(dict.fromkeys(names.get(what, ()), value))
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


def _ending(solver: str, solved: Solved, program: MixedIntegerProgram) -> Ending:
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
        # Optimal within a gap of the solver's own, which nobody passes on.
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
