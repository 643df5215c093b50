"""HiGHS through highspy: the default backend for programs with linear rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from ...errors import UnsupportedOption
from ...models.model import Model
from ...models.programs.base import RowProgram
from ...models.programs.linear import MixedIntegerProgram, QuadraticProgram
from ..contract.backend import Answer, Feature, Option, Request
from ..programs.attempts import (
    Clock,
    Ended,
    Ending,
    loosened_cutoff,
    solver_options,
    solver_tolerance,
)
from ..programs.highs_library import meanings, run_highs
from ..qp.base import UNPOLISHED, answered
from ..qp.highs import attempt as attempt_quadratic
from ..qp.settings import POLISH
from .base import CALLED_BACK, Incumbents, ProgramBackend

__all__ = ["Highs", "ending", "search"]


class Highs(ProgramBackend):
    """Backend for HiGHS, called in this process with the arrays of the program."""

    name = "highs"
    accepts = (MixedIntegerProgram, QuadraticProgram)
    features = CALLED_BACK | {Feature.THREADS, Feature.DUALS}
    requires = ("highspy",)
    # highspy and ortools each contain a libhighs.so.1 of another version. The one loaded first serves
    # both, and the other package fails to import because of a missing symbol.
    conflict_group = "highs"
    natives = ("highspy._core",)
    options: ClassVar[Mapping[str, Option]] = {
        "presolve": Option("choose", "Whether to presolve.", str, ("choose", "on", "off")),
        "mip_heuristic_effort": Option(
            0.05, "Share of the time spent on heuristics.", float, lower=0.0, upper=1.0
        ),
        "polish": POLISH,
    }
    summary = "HiGHS: branch and cut, simplex, interior point, quadratic active set; the default"

    def interrupts(self, kind: type[Model[Any]]) -> bool:
        """Return False for quadratic programs, whose solver in HiGHS cannot be stopped."""
        return not issubclass(kind, QuadraticProgram)

    def comparison_options(self, kind: type[Model[Any]]) -> Mapping[str, Any]:
        return {} if issubclass(kind, MixedIntegerProgram) else UNPOLISHED

    def run(self, problem: RowProgram, request: Request) -> Answer:
        """Solve a mixed-integer or quadratic program, see :meth:`Backend.run`."""
        if isinstance(problem, QuadraticProgram):
            name = "mip_heuristic_effort"
            if request.options.get(name, self.options[name].default) != self.options[name].default:
                raise UnsupportedOption(
                    f"backend 'highs': {name} is for mixed-integer programs, not for quadratic ones"
                )
            return answered(self, problem, request, attempt_quadratic)
        assert isinstance(problem, MixedIntegerProgram)
        return super().run(problem, request)

    def attempt(self, program: MixedIntegerProgram, request: Request, clock: Clock) -> Ending:
        """Solve the program with HiGHS."""
        return ending(search(program, request, clock), program, request)


def search(program: MixedIntegerProgram, request: Request, clock: Clock) -> Any:
    """Solve a program and return the ``highspy.Highs`` object."""
    tolerance = solver_tolerance(request, 1e-10)
    options: dict[str, Any] = {
        "mip_rel_gap": request.gap,
        "mip_abs_gap": 0.0,
        "primal_feasibility_tolerance": tolerance,
        "dual_feasibility_tolerance": tolerance,
        "mip_feasibility_tolerance": tolerance,
        **solver_options(request, "solver"),
    }
    if request.cutoff is not None and not program.continuous:
        options["objective_bound"] = loosened_cutoff(request.cutoff)

    def prepare(highs: Any) -> None:
        if request.warm_start is not None:
            columns = np.arange(program.size, dtype=np.int32)
            highs.setSolution(program.size, columns, np.asarray(request.warm_start, float))
        _listen(highs, program, request)

    return run_highs(program, program.integral, options, request, clock, prepare)


def _listen(highs: Any, program: MixedIntegerProgram, request: Request) -> None:
    control = request.control

    def stop(event: Any) -> None:
        if control.stopped:
            event.interrupt()

    incumbents = Incumbents(program, request)

    def search(event: Any) -> None:
        incumbents.prove(float(event.data_out.mip_dual_bound))
        stop(event)

    def incumbent(event: Any) -> None:
        incumbents.report(np.array(event.data_out.mip_solution, float))
        incumbents.prove(float(event.data_out.mip_dual_bound))

    highs.cbSimplexInterrupt.subscribe(stop)
    highs.cbIpmInterrupt.subscribe(stop)
    highs.cbMipInterrupt.subscribe(search)
    highs.cbMipImprovingSolution.subscribe(incumbent)


def ending(highs: Any, program: MixedIntegerProgram, request: Request) -> Ending:
    """Return the ending of a search."""
    import highspy

    status, info, solution = highs.getModelStatus(), highs.getInfo(), highs.getSolution()
    result = Ending.read("HiGHS", status, meanings(request), highs.modelStatusToString(status))
    feasible = int(highspy.SolutionStatus.kSolutionStatusFeasible)
    bound = info.mip_dual_bound
    if program.continuous:
        bound = info.objective_function_value if result.ended is Ended.PROVEN else None
    has_duals = program.continuous and solution.dual_valid
    has_point = solution.value_valid and info.primal_solution_status == feasible
    return replace(
        result,
        point=np.array(solution.col_value, float) if has_point else None,
        bound=bound,
        duals=np.array(solution.row_dual, float) if has_duals else None,
        statistics={
            "nodes": max(int(info.mip_node_count), 0),
            "simplex iterations": max(int(info.simplex_iteration_count), 0),
        },
    )
