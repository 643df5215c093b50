"""Base of the backends for mixed-integer and integer quadratic programs: clock, stops, conclusions.

A backend only translates: :meth:`ProgramBackend.attempt` passes the program to its solver and reports
the ending. This module decides what the ending proves. An infeasible run below a cutoff proves a bound,
and an unbounded relaxation does not prove an unbounded program.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ...models.model import Model
from ...models.programs.linear import MixedIntegerProgram, QuadraticProgram
from ..contract.backend import (
    Answer,
    Backend,
    Control,
    Feature,
    Guarantee,
    Limit,
    Request,
    Termination,
)
from ..contract.registry import integrality_refusal
from ..programs.attempts import (
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
from ..programs.scaling import Scaling

__all__ = [
    "CALLED_BACK",
    "Incumbents",
    "ProgramBackend",
    "proven_bound",
    "with_cutoff_row",
    "with_offset_column",
]

Vector = NDArray[np.float64]
IntegerProgram = MixedIntegerProgram | QuadraticProgram

#: Seconds that a solver may take to stop, if it reports incumbents and if it does not. Presolve,
#: building and linear programs at the root do not check the clock, and continued for up to 10 s.
REPORTED, SILENT = 0.8, 3.0
#: Features of the solvers that accept a warm start and call back during the search.
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
    """Reporter of a solver's improved points and bounds; others are dropped."""

    def __init__(self, program: IntegerProgram, request: Request) -> None:
        self._program = program
        self._request = request
        self._control = request.control
        self._best = np.inf

    def report(self, point: Vector) -> None:
        """Report `point` if its recomputed objective is better than that of all points before."""
        objective = self._program.objective(point)
        if objective < self._best:
            self._best = objective
            self._control.incumbent(objective, point)

    def prove(self, bound: float) -> None:
        """Report a lower bound of the solver."""
        self._control.prove(proven_bound(self._program, self._request, bound))


def with_cutoff_row(program: MixedIntegerProgram, cutoff: float | None) -> MixedIntegerProgram:
    """Return `program` with a last row that limits the objective to the cutoff, if it has one.

    For solvers without a cutoff. A linear program is returned unchanged, because the row would change the duals,
    and its optimum can be compared with the cutoff afterwards.
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


def with_offset_column(program: Any) -> Any:
    """Return `program` with its offset as a last column fixed at 1.

    For solvers without an offset, which would compute the relative gap without it.
    """
    if not program.offset:
        return program
    empty = sp.csr_array((program.row_count, 1))
    curved: dict[str, Any] = {}
    if isinstance(program, QuadraticProgram):
        curved["hessian"] = sp.csr_array(sp.block_diag([program.hessian, sp.csr_array((1, 1))]))
    return replace(
        program,
        cost=np.append(program.cost, program.offset),
        matrix=sp.csr_array(sp.hstack([program.matrix, empty])),
        column_lower=np.append(program.column_lower, 1.0),
        column_upper=np.append(program.column_upper, 1.0),
        integral=np.append(program.integral, False),
        offset=0.0,
        columns=(),
        **curved,
    )


class ProgramBackend(Backend):
    """Base of the backends that solve mixed-integer programs to proven optimality.

    Those that accept quadratic programs as well solve the ones with integral columns.
    """

    accepts: ClassVar[type[Model[Any]] | tuple[type[Model[Any]], ...]] = MixedIntegerProgram
    guarantee = Guarantee.EXACT

    @abstractmethod
    def attempt(self, program: Any, request: Request, clock: Clock) -> Ending:
        """Solve `program` once and report the ending; `clock` counts ``"build"``, then ``"solve"``.

        A quadratic program has integral columns, and only backends that declare ``"quadratic-program"`` in
        :attr:`integral_kinds` receive it.
        """

    def patience(self, kind: type[Model[Any]]) -> float:
        """Return fewer seconds for solvers that report incumbents, because no point is lost."""
        if not issubclass(kind, MixedIntegerProgram):
            return super().patience(kind)
        return REPORTED if Feature.INCUMBENTS in self.features else SILENT

    def run(self, problem: IntegerProgram, request: Request) -> Answer:
        """Solve `problem`, see :meth:`Backend.run`."""
        self.require()
        refusal = integrality_refusal(problem, self)
        if not refusal and isinstance(problem, QuadraticProgram):
            refusal = self.refuses(problem)
        if refusal:
            raise UnsupportedFormulation(refusal)
        request = replace(request, options=self.checked_options(request.options))
        scaling = Scaling.of(problem)
        if scaling is not None:
            return scaling.answered(request, self._run)
        return self._run(problem, request)

    def _run(self, problem: IntegerProgram, request: Request) -> Answer:
        clock, given = Clock(request.time_limit), request
        if isinstance(problem, QuadraticProgram):
            # No linear row states the cutoff in the search for a feasible point, see `_resolve`.
            request = replace(request, cutoff=None)
        ending = trivial_ending(problem, request) or ending_if_stopped(request, clock)
        if ending is None:
            ending = self.attempt(problem, request, clock)
            if ending.ended is Ended.UNCLEAR or (
                ending.ended is Ended.UNBOUNDED and not problem.continuous
            ):
                ending = self._resolve(problem, request, clock, ending)
        return _conclude(problem, given, clock, ending)

    def _resolve(
        self, program: IntegerProgram, request: Request, clock: Clock, first: Ending
    ) -> Ending:
        """Distinguish an unbounded from an infeasible program by searching any feasible point.

        Presolve stops at "infeasible or unbounded", and an unbounded relaxation does not decide about
        integer points. With rational data, a feasible program with an unbounded relaxation is unbounded.
        """
        ending = ending_if_stopped(request, clock)
        if ending is not None:
            return ending
        if isinstance(program, QuadraticProgram):
            assert program.integral is not None
            posed = MixedIntegerProgram(**program.shared(), integral=program.integral)
        else:
            # The cutoff stays as a row, because it may be what makes the program infeasible.
            posed = with_cutoff_row(program, request.cutoff)
        question = replace(posed, cost=np.zeros(program.size), offset=0.0)
        silent = Control()
        # The run's flag stops the search, but its points are not incumbents of the program.
        silent.flag = request.control.flag
        probe = self.attempt(question, replace(request, cutoff=None, control=silent), clock)
        if probe.ended is Ended.PROVEN or probe.point is not None:
            return replace(first, ended=Ended.UNBOUNDED, point=probe.point, bound=None, duals=None)
        if probe.ended is Ended.STOPPED:
            return replace(probe, limit=stop_reason(request.control, probe.limit or Limit.TIME))
        return replace(probe, bound=None, duals=None)


def _rounded(program: IntegerProgram, point: Vector, request: Request) -> Vector:
    """Return `point` clipped to its bounds and rounded in integer columns, if the rows permit it."""
    exact = np.clip(point, program.column_lower, program.column_upper)
    exact[program.integral] = np.round(exact[program.integral])
    if np.array_equal(exact, point):
        return exact
    return exact if is_satisfied(program, exact, request.tolerance) else point


def _conclude(program: IntegerProgram, request: Request, clock: Clock, ending: Ending) -> Answer:
    """Return the answer that `ending` proves."""
    point, objective = None, None
    if ending.point is not None and ending.ended is not Ended.UNBOUNDED:
        point = _rounded(program, np.array(ending.point, float), request)
        if ending.ended is Ended.STOPPED and not is_satisfied(program, point, request.tolerance):
            # A stopped solver may return an infeasible point, such as a vertex of the simplex path.
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
    program: IntegerProgram,
    request: Request,
    bound: float | None,
    objective: float | None = None,
) -> float | None:
    """Return the part of a solver's lower bound that is proven; None if nothing is.

    A bound that exceeds `objective`, that of the best point, by rounding is lowered to it.
    """
    if bound is None or not np.isfinite(bound) or abs(bound) >= 1e20:
        return None
    if request.cutoff is not None and not program.continuous:
        # The search prunes plans above the cutoff, so nothing is proven there: HiGHS reported a bound
        # far above the optimum that it must not find.
        bound = min(bound, request.cutoff)
    if objective is not None and objective < bound <= objective + 1e-6 * max(1.0, abs(objective)):
        return float(objective)
    return float(bound)
