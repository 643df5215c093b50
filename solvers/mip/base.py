"""What every mixed-integer backend shares: the clock, the stop, and what a solver's end means.

A backend here only translates: :meth:`ProgramBackend.attempt` hands the program to its solver and
reports how the solver ended. What that proves (an infeasible run below a cutoff proves a bound, an
unbounded relaxation does not prove an unbounded program) is decided once, in this file.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.model import Model
from ...models.programs.linear import MixedIntegerProgram
from ..attempts import (
    Clock,
    Ended,
    Ending,
    above_cutoff,
    ending_if_stopped,
    is_satisfied,
    loosened_cutoff,
    stop_reason,
    trivial_ending,
)
from ..backend import Answer, Backend, Control, Feature, Guarantee, Limit, Request, Termination
from ..scaling import Scaling

__all__ = [
    "CALLED_BACK",
    "Incumbents",
    "ProgramBackend",
    "proven_bound",
    "with_cutoff_row",
    "with_offset_column",
]

Vector = NDArray[np.float64]

#: Seconds that a solver may take to stop which reports its points on the way, and one which does
#: not: presolve, building and linear programs at the root look at no clock, and were seen to go on
#: for 10.
REPORTED, SILENT = 0.8, 3.0
#: What the solvers understand that take starts and call back while they search.
CALLED_BACK = frozenset(
    {
        Feature.GAP,
        Feature.SEED,
        Feature.WARM_START,
        Feature.CUTOFF,
        Feature.INCUMBENTS,
        Feature.DUAL_BOUND,
        Feature.INTERRUPT,
        Feature.LOG,
    }
)


class Incumbents:
    """Passes a solver's better points and bounds on; those that better nothing are dropped."""

    def __init__(self, program: MixedIntegerProgram, request: Request) -> None:
        self._program = program
        self._request = request
        self._control = request.control
        self._best = np.inf

    def report(self, point: Vector) -> None:
        """Report `point`, whose objective is computed anew, if it is better than all before."""
        objective = self._program.objective(point)
        if objective < self._best:
            self._best = objective
            self._control.incumbent(objective, point)

    def prove(self, bound: float) -> None:
        """Report the solver's lower bound."""
        self._control.prove(proven_bound(self._program, self._request, bound))


def with_cutoff_row(program: MixedIntegerProgram, cutoff: float | None) -> MixedIntegerProgram:
    """Return `program` with a last row that keeps the objective at or below the cutoff.

    For solvers without a cutoff of their own. A linear program is left as it is: the row would
    take a share of the duals, and its optimum can be held against the cutoff afterwards.
    """
    if cutoff is None or program.continuous:
        return program
    return replace(
        program,
        matrix=sp.csr_array(sp.vstack([program.matrix, sp.csr_array(program.cost[None, :])])),
        row_lower=np.append(program.row_lower, -np.inf),
        row_upper=np.append(program.row_upper, loosened_cutoff(cutoff) - program.offset),
        rows=(),
    )


def with_offset_column(program: MixedIntegerProgram) -> MixedIntegerProgram:
    """Return `program` with its offset as a last column fixed at 1.

    For solvers that know no offset, and would measure their relative gap without it.
    """
    if not program.offset:
        return program
    nothing = sp.csr_array((program.row_count, 1))
    return replace(
        program,
        cost=np.append(program.cost, program.offset),
        matrix=sp.csr_array(sp.hstack([program.matrix, nothing])),
        column_lower=np.append(program.column_lower, 1.0),
        column_upper=np.append(program.column_upper, 1.0),
        integral=np.append(program.integral, False),
        offset=0.0,
        columns=(),
    )


class ProgramBackend(Backend):
    """Base of the backends that solve a :class:`MixedIntegerProgram` to proven optimality."""

    accepts: ClassVar[type[Model[Any]] | tuple[type[Model[Any]], ...]] = MixedIntegerProgram
    guarantee = Guarantee.EXACT

    @abstractmethod
    def attempt(self, program: MixedIntegerProgram, request: Request, clock: Clock) -> Ending:
        """Hand `program` to the solver once and report how it ended.

        Laps of `clock` are called ``"build"`` (until the solver starts) and ``"solve"``.
        """

    def patience(self, kind: type[Model[Any]]) -> float:
        """Return fewer seconds where points are reported as they are found: nothing is to come."""
        if not issubclass(kind, MixedIntegerProgram):
            return super().patience(kind)
        return REPORTED if Feature.INCUMBENTS in self.features else SILENT

    def run(self, problem: MixedIntegerProgram, request: Request) -> Answer:
        """Solve `problem` as `request` asks."""
        self.require()
        request = replace(request, options=self.checked_options(request.options))
        scaling = Scaling.of(problem)
        if scaling is not None:
            return scaling.answered(request, self._run)
        return self._run(problem, request)

    def _run(self, problem: MixedIntegerProgram, request: Request) -> Answer:
        clock = Clock(request.time_limit)
        ending = trivial_ending(problem, request) or ending_if_stopped(request, clock)
        if ending is None:
            ending = self.attempt(problem, request, clock)
            if ending.ended is Ended.UNCLEAR or (
                ending.ended is Ended.UNBOUNDED and not problem.continuous
            ):
                ending = self._resolve(problem, request, clock, ending)
        return _conclude(problem, request, clock, ending)

    def _resolve(
        self, program: MixedIntegerProgram, request: Request, clock: Clock, first: Ending
    ) -> Ending:
        """Tell an unbounded program from an infeasible one by asking for any feasible point.

        Presolve stops at "infeasible or unbounded", and an unbounded relaxation says nothing of
        whole points. With rational data, a feasible program whose relaxation is unbounded is
        unbounded itself.
        """
        ending = ending_if_stopped(request, clock)
        if ending is not None:
            return ending
        # The cutoff stays, as a row: it may be what makes the program infeasible.
        posed = with_cutoff_row(program, request.cutoff)
        question = replace(posed, cost=np.zeros(program.size), offset=0.0)
        silent = Control()
        # The same flag stops it, but its points are no incumbents of the program asked.
        silent.flag = request.control.flag
        probe = self.attempt(question, replace(request, cutoff=None, control=silent), clock)
        if probe.ended is Ended.PROVEN or probe.point is not None:
            return replace(first, ended=Ended.UNBOUNDED, point=probe.point, bound=None, duals=None)
        if probe.ended is Ended.STOPPED:
            return replace(probe, limit=stop_reason(request.control, probe.limit or Limit.TIME))
        return replace(probe, bound=None, duals=None)


def _tidied(program: MixedIntegerProgram, point: Vector, tolerance: float) -> Vector:
    """Return `point` on its bounds and whole where it must be, if the rows allow it as well."""
    tidy = np.clip(point, program.column_lower, program.column_upper)
    tidy[program.integral] = np.round(tidy[program.integral])
    if np.array_equal(tidy, point):
        return tidy
    return tidy if is_satisfied(program, tidy, tolerance) else point


def _conclude(
    program: MixedIntegerProgram, request: Request, clock: Clock, ending: Ending
) -> Answer:
    """Say what `ending` proves."""
    point, objective = None, None
    if ending.point is not None and ending.ended is not Ended.UNBOUNDED:
        point = _tidied(program, np.array(ending.point, float), request.tolerance)
        if ending.ended is Ended.STOPPED and not is_satisfied(program, point, request.tolerance):
            # A stopped solver may hand back whatever it held, a simplex vertex on its way say.
            point = None
        else:
            objective = program.objective(point)
    answer = Answer(
        termination=Termination.FAILED,
        point=point,
        primal_bound=objective,
        dual_bound=proven_bound(program, request, ending.bound, objective),
        duals=ending.duals if program.continuous else None,
        seconds=clock.seconds,
        statistics=ending.statistics,
        message=ending.message,
    )
    match ending.ended:
        case Ended.PROVEN:
            if request.cutoff is not None and (
                objective is None or objective > loosened_cutoff(request.cutoff)
            ):
                return above_cutoff(answer, request.cutoff)
            return replace(answer, termination=Termination.OPTIMAL)
        case Ended.INFEASIBLE:
            if request.cutoff is not None and not ending.absolute:
                return above_cutoff(answer, request.cutoff)
            return replace(answer, termination=Termination.INFEASIBLE, dual_bound=None)
        case Ended.UNBOUNDED:
            return replace(answer, termination=Termination.UNBOUNDED, dual_bound=None)
        case Ended.STOPPED | Ended.UNCLEAR:
            kind = Termination.NO_SOLUTION if point is None else Termination.FEASIBLE
            return replace(answer, termination=kind, limit=ending.limit)
        case Ended.FAILED:
            return replace(answer, duals=None)


def proven_bound(
    program: MixedIntegerProgram,
    request: Request,
    bound: float | None,
    objective: float | None = None,
) -> float | None:
    """Return what a solver's lower `bound` proves, None where it is nothing."""
    if bound is None or not np.isfinite(bound) or abs(bound) >= 1e20:
        return None
    if request.cutoff is not None and not program.continuous:
        # What lies above a cutoff is pruned, so the search knows nothing of plans there: HiGHS
        # was seen to report a bound far above the optimum it was forbidden to find.
        bound = min(bound, request.cutoff)
    if objective is not None and objective < bound <= objective + 1e-6 * max(1.0, abs(objective)):
        return float(objective)
    return float(bound)
