"""HiGHS through highspy: the default backend for programs with linear rows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ...errors import InvalidData, UnsupportedOption
from ...models.model import Model
from ...models.programs.base import RowProgram
from ...models.programs.linear import MixedIntegerProgram, QuadraticProgram
from ..backend import Answer, Feature, Limit, Option, Request
from .base import (
    Clock,
    Ended,
    Incumbents,
    Outcome,
    ProgramBackend,
    allowed,
    limited,
    solver_tolerance,
)

__all__ = ["Highs", "pass_rows"]


class Highs(ProgramBackend):
    """HiGHS, called in this process with the program's own arrays."""

    name = "highs"
    accepts = RowProgram
    features = frozenset(
        {
            Feature.GAP,
            Feature.SEED,
            Feature.THREADS,
            Feature.WARM_START,
            Feature.CUTOFF,
            Feature.INCUMBENTS,
            Feature.DUAL_BOUND,
            Feature.DUALS,
            Feature.INTERRUPT,
        }
    )
    requires = ("highspy",)
    distribution = "highspy"
    # highspy and ortools each bring a libhighs.so.1, of different versions: whichever is loaded
    # first serves both, and the other one fails to import for want of a symbol.
    conflict_group = "highs"
    natives = ("highspy._core",)
    options: ClassVar[Mapping[str, Option]] = {
        "presolve": Option("choose", "Whether to presolve.", str, ("choose", "on", "off")),
        "mip_heuristic_effort": Option(
            0.05, "Share of the time spent on heuristics.", float, lower=0.0, upper=1.0
        ),
    }
    summary = "HiGHS: branch and cut, simplex, interior point, quadratic active set; the default"

    def interrupts(self, kind: type[Model[Any]]) -> bool:
        """Its solver for quadratic programs takes no stop."""
        return not issubclass(kind, QuadraticProgram)

    def run(self, problem: RowProgram, request: Request) -> Answer:
        """Solve `problem`, of either kind, as `request` asks."""
        if isinstance(problem, QuadraticProgram):
            from ..qp import highs as quadratic
            from ..qp.base import answered

            self.require()
            refusal = quadratic.refusal(self.options, request)
            if refusal:
                raise UnsupportedOption(refusal)
            return answered(problem, request, quadratic.attempt)
        assert isinstance(problem, MixedIntegerProgram)
        return super().run(problem, request)

    def attempt(self, program: MixedIntegerProgram, request: Request, clock: Clock) -> Outcome:
        """Solve with HiGHS."""
        import highspy

        highs = highspy.Highs()
        _configure(highspy, highs, program, request)
        pass_rows(highspy, highs, program, program.integral)
        if request.warm_start is not None:
            columns = np.arange(program.size, dtype=np.int32)
            highs.setSolution(program.size, columns, np.asarray(request.warm_start, float))
        _listen(highs, program, request)
        clock.lap("build")
        left = clock.left()
        if left is not None:
            highs.setOptionValue("time_limit", left)
        try:
            highs.run()
        finally:
            if request.threads is not None:
                # The scheduler is one for the process and keeps its number of threads.
                highspy.Highs.resetGlobalScheduler(True)
        clock.lap("solve")
        return _outcome(highspy, highs, program, request)


def _configure(highspy: Any, highs: Any, program: MixedIntegerProgram, request: Request) -> None:
    options: dict[str, Any] = {
        "output_flag": False,
        "mip_rel_gap": request.gap,
        "mip_abs_gap": 0.0,
        "primal_feasibility_tolerance": solver_tolerance(request.tolerance, 1e-10),
        "dual_feasibility_tolerance": solver_tolerance(request.tolerance, 1e-10),
        "mip_feasibility_tolerance": solver_tolerance(request.tolerance, 1e-10),
        **request.options,
    }
    if request.seed is not None:
        options["random_seed"] = request.seed % (2**31)
    if request.threads is not None:
        type(highs).resetGlobalScheduler(True)
        options["threads"] = request.threads
    if request.cutoff is not None and not program.continuous:
        options["objective_bound"] = allowed(request.cutoff)
    for name, value in options.items():
        if highs.setOptionValue(name, value) == highspy.HighsStatus.kError:
            raise UnsupportedOption(f"backend 'highs': HiGHS refuses {name} = {value!r}")


def pass_rows(highspy: Any, highs: Any, program: RowProgram, integral: Any) -> None:
    """Hand HiGHS the linear part of a program; ``InvalidData`` where it refuses."""
    matrix = program.matrix
    passed = highs.passModel(
        program.size,
        program.row_count,
        matrix.nnz,
        int(highspy.MatrixFormat.kRowwise),
        int(highspy.ObjSense.kMinimize),
        program.offset,
        program.cost,
        program.column_lower,
        program.column_upper,
        program.row_lower,
        program.row_upper,
        matrix.indptr.astype(np.int32),
        matrix.indices.astype(np.int32),
        matrix.data,
        integral.astype(np.int32),
    )
    if passed == highspy.HighsStatus.kError:
        # Solved all the same, it would be the empty model.
        raise InvalidData(f"backend 'highs': HiGHS refuses the program ({program.describe()})")


def _listen(highs: Any, program: MixedIntegerProgram, request: Request) -> None:
    control = request.control

    def stop(event: Any) -> None:
        if control.stopped:
            event.interrupt()

    incumbents = Incumbents(program, control)

    def incumbent(event: Any) -> None:
        incumbents.report(np.array(event.data_out.mip_solution, float))

    highs.cbSimplexInterrupt.subscribe(stop)
    highs.cbIpmInterrupt.subscribe(stop)
    highs.cbMipInterrupt.subscribe(stop)
    highs.cbMipImprovingSolution.subscribe(incumbent)


def _outcome(highspy: Any, highs: Any, program: MixedIntegerProgram, request: Request) -> Outcome:
    state = highspy.HighsModelStatus
    model_status = highs.getModelStatus()
    info = highs.getInfo()
    ended, limit = {
        state.kOptimal: (Ended.PROVEN, None),
        state.kInfeasible: (Ended.INFEASIBLE, None),
        state.kUnbounded: (Ended.UNBOUNDED, None),
        state.kUnboundedOrInfeasible: (Ended.UNCLEAR, None),
        state.kTimeLimit: (Ended.STOPPED, Limit.TIME),
        state.kIterationLimit: (Ended.STOPPED, Limit.ITERATIONS),
        state.kSolutionLimit: (Ended.STOPPED, Limit.ITERATIONS),
        state.kMemoryLimit: (Ended.STOPPED, Limit.MEMORY),
        state.kInterrupt: (Ended.STOPPED, limited(request.control)),
        state.kHighsInterrupt: (Ended.STOPPED, limited(request.control)),
        # Only a cutoff makes these: nothing was found at or below it.
        state.kObjectiveBound: (Ended.INFEASIBLE, None),
    }.get(model_status, (Ended.FAILED, None))
    solution = highs.getSolution()
    point = None
    if solution.value_valid and info.primal_solution_status == int(
        highspy.SolutionStatus.kSolutionStatusFeasible
    ):
        point = np.array(solution.col_value, float)
    duals = None
    if program.continuous:
        bound = info.objective_function_value if ended is Ended.PROVEN else None
        if solution.dual_valid:
            duals = np.array(solution.row_dual, float)
    else:
        bound = info.mip_dual_bound
    return Outcome(
        ended,
        point,
        bound,
        duals,
        limit,
        {
            "nodes": max(int(info.mip_node_count), 0),
            "simplex iterations": max(int(info.simplex_iteration_count), 0),
        },
        "" if ended is not Ended.FAILED else f"HiGHS: {highs.modelStatusToString(model_status)}",
    )
