"""CVXPY's own modelling layer: HiGHS or SCIP on mixed-integer programs, more on quadratic ones."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from ...errors import UnsupportedOption
from ...models.programs.base import RowProgram
from ...models.programs.conic import ConicProgram
from ...models.programs.linear import MixedIntegerProgram, QuadraticProgram
from ..backend import Answer, Feature, Limit, Option, Request
from .base import (
    Clock,
    Ended,
    Outcome,
    ProgramBackend,
    solver_tolerance,
    with_cutoff_row,
    with_offset_column,
)

__all__ = ["CvxpyMip", "row_duals"]

#: Solvers of mixed-integer programs, the default first.
MIXED_INTEGER = ("HIGHS", "SCIP")
#: Solvers of quadratic programs, the default first. ProxQP is left out: by way of CVXPY it was seen
#: to call a feasible linear program infeasible.
QUADRATIC = ("CLARABEL", "OSQP", "HIGHS", "SCS", "PIQP")
#: Solvers of conic programs, the default first.
CONIC = ("CLARABEL", "SCS")


class CvxpyMip(ProgramBackend):
    """CVXPY: the program is posed as a ``cvxpy.Problem`` and canonicalised by CVXPY.

    That is a way of its own from the program to the solver, worth a cross-check of the others. Its
    features are those with HiGHS; what another solver cannot take from CVXPY raises.
    """

    name = "cvxpy"
    accepts = RowProgram
    features = frozenset(
        {
            Feature.GAP,
            Feature.SEED,
            Feature.THREADS,
            Feature.CUTOFF,
            Feature.DUAL_BOUND,
            Feature.DUALS,
        }
    )
    requires = ("cvxpy",)
    distribution = "cvxpy"
    extra = "cvxpy"
    # CVXPY probes its solvers as it is imported and so loads highspy, after which OR-Tools cannot
    # be imported (see Highs). Its GLOP and PDLP interfaces are left out for that reason: CVXPY
    # lists them as installed, for the empty top package of ortools is all it probes. Gurobi
    # is left out because CVXPY lets it print its licence on the standard output, SciPy because
    # CVXPY reports its "infeasible or unbounded" as a failure.
    conflict_group = "highs"
    natives = ("highspy._core",)
    options: ClassVar[Mapping[str, Option]] = {
        "solver": Option(
            None,
            f"CVXPY's name of the solver; {MIXED_INTEGER[0]} for mixed-integer programs and "
            f"{QUADRATIC[0]} for quadratic ones by default.",
            str,
            tuple(dict.fromkeys((*MIXED_INTEGER, *QUADRATIC))),
        )
    }
    summary = "CVXPY: HiGHS, SCIP, Clarabel, OSQP … behind a modelling layer of its own"

    def run(self, problem: RowProgram, request: Request) -> Answer:
        """Solve `problem`, of either kind, as `request` asks."""
        if isinstance(problem, ConicProgram) and not problem.cones:
            problem = problem.quadratic
        quadratic = isinstance(problem, QuadraticProgram)
        able = QUADRATIC if quadratic else MIXED_INTEGER
        if isinstance(problem, ConicProgram):
            able = CONIC
        solver = request.options.get("solver") or able[0]
        if solver not in able:
            kind = problem.kind.removesuffix("-program")
            raise UnsupportedOption(
                f"backend 'cvxpy': solver={solver!r} takes no {kind} program; "
                f"those that do: {', '.join(able)}"
            )
        request = replace(request, options={**request.options, "solver": solver})
        if isinstance(problem, ConicProgram):
            from ..conic.base import conic_answer
            from ..qp import cvxpy_qp

            self.require()
            return conic_answer(problem, request, cvxpy_qp.attempt)
        if isinstance(problem, QuadraticProgram):
            from ..qp import cvxpy_qp
            from ..qp.base import answered

            self.require()
            return answered(problem, request, cvxpy_qp.attempt)
        assert isinstance(problem, MixedIntegerProgram)
        return super().run(problem, request)

    def attempt(self, program: MixedIntegerProgram, request: Request, clock: Clock) -> Outcome:
        """Solve through CVXPY."""
        import cvxpy

        solver = str(request.options["solver"])
        posed, rows = _without_empty_rows(
            with_offset_column(with_cutoff_row(program, request.cutoff))
        )
        problem, columns = posed.to_cvxpy()
        # Canonicalised here, so that the time limit counts it; solve() finds the result cached.
        problem.get_problem_data(solver)
        clock.lap("build")
        left = clock.left()
        given = _solver_options(solver, program, request, left)
        error = ""
        try:
            with warnings.catch_warnings():
                # CVXPY warns that a limit makes a solution inaccurate; the limit is reported here.
                warnings.simplefilter("ignore")
                problem.solve(solver=solver, verbose=False, **given)
        except cvxpy.SolverError as refused:
            error = str(refused)
        finally:
            if solver == "HIGHS" and request.threads is not None:
                _fresh_scheduler()
        clock.lap("solve")
        late = left is not None and clock.left() == 0.0
        outcome = _outcome(solver, problem, columns, program, late, error)
        # CVXPY's own tests doubt the duals it reads from SCIP, which lacks those of one-column rows.
        if outcome.ended is Ended.PROVEN and program.continuous and solver != "SCIP":
            duals = np.zeros(program.row_count)
            duals[rows] = row_duals(problem, posed)
            outcome = replace(outcome, duals=duals)
        return outcome


def _without_empty_rows(
    program: MixedIntegerProgram,
) -> tuple[MixedIntegerProgram, np.ndarray[Any, np.dtype[np.intp]]]:
    """Return `program` with the rows that have entries, and which they are.

    CVXPY's interface to SCIP fails on the others, which are known to hold by now.
    """
    rows = np.flatnonzero(np.diff(program.matrix.indptr))
    if rows.size == program.row_count:
        return program, rows
    kept = replace(
        program,
        matrix=program.matrix[rows],
        row_lower=program.row_lower[rows],
        row_upper=program.row_upper[rows],
        rows=(),
    )
    return kept, rows


def _fresh_scheduler() -> None:
    """Let HiGHS start threads anew: its scheduler keeps the number it was first given."""
    import highspy

    highspy.Highs.resetGlobalScheduler(True)


def _solver_options(
    solver: str, program: MixedIntegerProgram, request: Request, left: float | None
) -> dict[str, Any]:
    """Return the common request in the solver's own words, or raise where it has none."""
    asked = {
        "time": left,
        "gap": None if program.continuous else request.gap,
        "absolute gap": None if program.continuous else 0.0,
        "seed": None if request.seed is None else request.seed % (2**31),
        "threads": request.threads,
        "tolerance": solver_tolerance(request.tolerance, 1e-9),
    }
    names = _NAMES[solver]
    options: dict[str, Any] = {}
    for what, value in asked.items():
        if value is None:
            continue
        if what not in names:
            raise UnsupportedOption(f"backend 'cvxpy': solver={solver!r} takes no {what}")
        options.update(dict.fromkeys(names[what], value))
    if solver == "HIGHS" and request.threads is not None:
        _fresh_scheduler()
    if solver == "SCIP":
        return {"scip_params": {"misc/catchctrlc": False, **options}}
    return options


_NAMES: dict[str, dict[str, tuple[str, ...]]] = {
    "HIGHS": {
        "time": ("time_limit",),
        "gap": ("mip_rel_gap",),
        "absolute gap": ("mip_abs_gap",),
        "seed": ("random_seed",),
        "threads": ("threads",),
        "tolerance": (
            "primal_feasibility_tolerance",
            "dual_feasibility_tolerance",
            "mip_feasibility_tolerance",
        ),
    },
    "SCIP": {
        "time": ("limits/time",),
        "gap": ("limits/gap",),
        "absolute gap": ("limits/absgap",),
        "seed": ("randomization/randomseedshift",),
        "tolerance": ("numerics/feastol", "numerics/dualfeastol"),
    },
}


def _outcome(
    solver: str, problem: Any, columns: Any, program: MixedIntegerProgram, late: bool, error: str
) -> Outcome:
    status = problem.status
    extra = getattr(problem.solver_stats, "extra_stats", None)
    ended = {
        "optimal": Ended.PROVEN,
        "infeasible": Ended.INFEASIBLE,
        "unbounded": Ended.UNBOUNDED,
        "infeasible_or_unbounded": Ended.UNCLEAR,
        # The rest are CVXPY's words for a limit; a solver's failure raises, and leaves no error
        # but the clock to tell a limit before the first solution.
        "user_limit": Ended.STOPPED,
        "optimal_inaccurate": Ended.STOPPED,
    }.get(status, Ended.STOPPED if late else Ended.FAILED)
    if solver == "SCIP" and extra is not None and extra.get("scip_status") == "gaplimit":
        ended = Ended.PROVEN
    if error and not late:
        ended = Ended.FAILED
    point = None
    if columns.value is not None and ended in (Ended.PROVEN, Ended.STOPPED):
        point = np.array(columns.value[: program.size], float)
    limit = None
    if ended is Ended.STOPPED:
        limit = Limit.TIME if late else Limit.ITERATIONS
    return Outcome(
        ended,
        point,
        _bound(solver, problem, extra, program, ended),
        limit=limit,
        message=f"CVXPY with {solver}: {error or status}" if ended is Ended.FAILED else "",
    )


def _bound(
    solver: str, problem: Any, extra: Any, program: MixedIntegerProgram, ended: Ended
) -> float | None:
    """Return the solver's dual bound, which CVXPY leaves among the statistics."""
    if program.continuous:
        return float(problem.value) if ended is Ended.PROVEN else None
    if extra is None or ended not in (Ended.PROVEN, Ended.STOPPED):
        return None
    return float(extra.mip_dual_bound if solver == "HIGHS" else extra["model"].getDualbound())


def row_duals(problem: Any, program: RowProgram) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the row multipliers, from the constraints in the order of ``to_cvxpy``.

    CVXPY gives an inequality a dual that is never negative, and an equality the sign of its
    Lagrangian, ``f + y (a x - b)``.
    """
    duals = np.zeros(program.row_count)
    low, high = program.row_lower, program.row_upper
    equal = low == high
    constraints = iter(problem.constraints)
    for take, sign in (
        (equal, -1.0),
        (~equal & np.isfinite(low), 1.0),
        (~equal & np.isfinite(high), -1.0),
    ):
        if take.any():
            value = next(constraints).dual_value
            if value is not None:
                duals[take] += sign * np.asarray(value, float).reshape(-1)
    return duals
