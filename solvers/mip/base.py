"""What every mixed-integer backend shares: the clock, the stop, and what a solver's end means.

A backend here only translates: :meth:`ProgramBackend.attempt` hands the program to its solver and
reports how the solver ended. What that proves (an infeasible run below a cutoff proves a bound, an
unbounded relaxation does not prove an unbounded program) is decided once, in this file.
"""

from __future__ import annotations

import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs import MixedIntegerProgram
from ..backend import Answer, Backend, Control, Guarantee, Limit, Request, Termination

__all__ = [
    "Clock",
    "Ended",
    "Incumbents",
    "Outcome",
    "ProgramBackend",
    "allowed",
    "limited",
    "solver_tolerance",
    "watched",
    "with_cutoff_row",
    "with_offset_column",
]

Vector = NDArray[np.float64]

#: How far, relatively, a cutoff is loosened, so that the plan it stems from stays allowed: solvers
#: compare objectives with tolerances of their own, and 1e-9 was seen to lose the plan in SCIP.
LOOSENED = 1e-6
#: Seconds between two looks at a stop request.
POLL = 0.02


class Ended(StrEnum):
    """How a solver ended, before anybody asks what that proves."""

    PROVEN = "proven"
    INFEASIBLE = "infeasible"
    UNBOUNDED = "unbounded"
    UNCLEAR = "infeasible or unbounded"
    STOPPED = "stopped"
    FAILED = "failed"


@dataclass(frozen=True)
class Outcome:
    """What a solver reports of one run.

    Parameters
    ----------
    ended : Ended
        Its status; ``PROVEN`` is an optimum within the gap.
    point : ndarray, optional
        Its best feasible column vector.
    bound : float, optional
        Its lower bound on the objective; None or infinite where it has none.
    duals : ndarray, optional
        Row multipliers, signed as :meth:`MixedIntegerProgram.dual_bound` wants them.
    limit : Limit, optional
        What stopped it, for ``STOPPED``.
    statistics : mapping
        Its counts.
    message : str
        Its own status, where a person should see it.
    absolute : bool
        Whether ``INFEASIBLE`` was proven without the cutoff.
    """

    ended: Ended
    point: Vector | None = None
    bound: float | None = None
    duals: Vector | None = None
    limit: Limit | None = None
    statistics: Mapping[str, float | int | str] = field(default_factory=dict)
    message: str = ""
    absolute: bool = False


class Clock:
    """Counts the seconds of a run: what is left of the limit, and what each part took."""

    def __init__(self, limit: float | None) -> None:
        self._limit = limit
        self._started = self._mark = time.perf_counter()
        self.seconds: dict[str, float] = {}

    def left(self) -> float | None:
        """Return the seconds left, at least 0; None where there is no limit."""
        if self._limit is None:
            return None
        return max(self._limit - (time.perf_counter() - self._started), 0.0)

    def lap(self, part: str) -> None:
        """Count the time since the last lap as `part`."""
        now = time.perf_counter()
        self.seconds[part] = self.seconds.get(part, 0.0) + now - self._mark
        self._mark = now


class Incumbents:
    """Passes a solver's better points on; those that better nothing are dropped."""

    def __init__(self, program: MixedIntegerProgram, control: Control) -> None:
        self._program = program
        self._control = control
        self._best = np.inf

    def report(self, point: Vector) -> None:
        """Report `point`, whose objective is computed anew, if it is better than all before."""
        objective = self._program.objective(point)
        if objective < self._best:
            self._best = objective
            self._control.incumbent(objective, point)


def allowed(cutoff: float) -> float:
    """Return `cutoff` loosened, so that its own plan stays allowed."""
    return cutoff + LOOSENED * max(1.0, abs(cutoff))


def solver_tolerance(tolerance: float, least: float, most: float = 1e-3) -> float:
    """Return the tolerance to give a solver, within the range it knows.

    A tenth of the request's: solvers measure in their own scaling and before postsolve, and what
    they let pass at the very edge would fail the verification.
    """
    return float(min(max(tolerance / 10, least), most))


def limited(control: Control, otherwise: Limit = Limit.INTERRUPTED) -> Limit:
    """Return the limit that stopped a run: the control's reason, else `otherwise`."""
    return control.reason if control.stopped and control.reason is not None else otherwise


@contextmanager
def watched(control: Control, stop: Callable[[], Any]) -> Iterator[None]:
    """Call `stop` from a thread once the control asks to, again and again until the run ends.

    Again, because most solvers forget a stop that reaches them before they have started. Needs a
    solver that releases the interpreter's lock, and a `stop` that any thread may call.
    """
    over = threading.Event()

    def watch() -> None:
        while not over.wait(POLL):
            if control.stopped:
                stop()

    thread = threading.Thread(target=watch, name="crosstrack-stop", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


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
        row_upper=np.append(program.row_upper, allowed(cutoff) - program.offset),
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

    accepts = MixedIntegerProgram
    guarantee = Guarantee.EXACT

    @abstractmethod
    def attempt(self, program: MixedIntegerProgram, request: Request, clock: Clock) -> Outcome:
        """Hand `program` to the solver once and report how it ended.

        Laps of `clock` are called ``"build"`` (until the solver starts) and ``"solve"``.
        """

    def run(self, problem: MixedIntegerProgram, request: Request) -> Answer:
        """Solve `problem` as `request` asks."""
        self.require()
        clock = Clock(request.time_limit)
        outcome = _obvious(problem, request) or self._stopped(request, clock)
        if outcome is None:
            outcome = self.attempt(problem, request, clock)
            if outcome.ended is Ended.UNCLEAR or (
                outcome.ended is Ended.UNBOUNDED and not problem.continuous
            ):
                outcome = self._resolve(problem, request, clock, outcome)
        return _conclude(problem, request, clock, outcome)

    @staticmethod
    def _stopped(request: Request, clock: Clock) -> Outcome | None:
        if request.control.stopped:
            return Outcome(Ended.STOPPED, limit=limited(request.control))
        if clock.left() == 0.0:
            return Outcome(Ended.STOPPED, limit=Limit.TIME)
        return None

    def _resolve(
        self, program: MixedIntegerProgram, request: Request, clock: Clock, first: Outcome
    ) -> Outcome:
        """Tell an unbounded program from an infeasible one by asking for any feasible point.

        Presolve stops at "infeasible or unbounded", and an unbounded relaxation says nothing of
        whole points. With rational data, a feasible program whose relaxation is unbounded is
        unbounded itself.
        """
        stopped = self._stopped(request, clock)
        if stopped is not None:
            return stopped
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
            return replace(probe, limit=limited(request.control, probe.limit or Limit.TIME))
        return replace(probe, bound=None, duals=None)


def _obvious(program: MixedIntegerProgram, request: Request) -> Outcome | None:
    """Answer what some solvers refuse as malformed: crossed bounds, no columns, empty rows."""
    for lower, upper, name in (
        (program.column_lower, program.column_upper, program.column_name),
        (program.row_lower, program.row_upper, program.row_name),
    ):
        crossed = np.flatnonzero(lower > upper)
        if crossed.size:
            at = int(crossed[0])
            return Outcome(
                Ended.INFEASIBLE,
                message=f"{name(at)}: the lower bound {lower[at]:g} exceeds the upper {upper[at]:g}",
                absolute=True,
            )
    slack = request.tolerance
    wrong = (program.row_lower > slack) | (program.row_upper < -slack)
    wrong &= np.diff(program.matrix.indptr) == 0
    if wrong.any():
        row = program.row_name(int(np.flatnonzero(wrong)[0]))
        message = f"{row}: no column enters, and 0 does not satisfy it"
        return Outcome(Ended.INFEASIBLE, message=message, absolute=True)
    if not program.size:
        return Outcome(Ended.PROVEN, np.zeros(0), program.offset, np.zeros(program.row_count))
    return None


def _tidied(program: MixedIntegerProgram, point: Vector, tolerance: float) -> Vector:
    """Return `point` on its bounds and whole where it must be, if the rows allow it as well."""
    tidy = np.clip(point, program.column_lower, program.column_upper)
    tidy[program.integral] = np.round(tidy[program.integral])
    if np.array_equal(tidy, point):
        return tidy
    return tidy if _holds(program, tidy, tolerance) else point


def _conclude(
    program: MixedIntegerProgram, request: Request, clock: Clock, outcome: Outcome
) -> Answer:
    """Say what `outcome` proves."""
    point, objective = None, None
    if outcome.point is not None and outcome.ended is not Ended.UNBOUNDED:
        point = _tidied(program, np.array(outcome.point, float), request.tolerance)
        if outcome.ended is Ended.STOPPED and not _holds(program, point, request.tolerance):
            # A stopped solver may hand back whatever it held, a simplex vertex on its way say.
            point = None
        else:
            objective = program.objective(point)
    answer = Answer(
        termination=Termination.FAILED,
        point=point,
        primal_bound=objective,
        dual_bound=_settled(program, request, outcome, objective),
        duals=outcome.duals if program.continuous else None,
        seconds=clock.seconds,
        statistics=outcome.statistics,
        message=outcome.message,
    )
    match outcome.ended:
        case Ended.PROVEN:
            if request.cutoff is not None and (
                objective is None or objective > allowed(request.cutoff)
            ):
                return _above_cutoff(answer, request.cutoff)
            return replace(answer, termination=Termination.OPTIMAL)
        case Ended.INFEASIBLE:
            if request.cutoff is not None and not outcome.absolute:
                return _above_cutoff(answer, request.cutoff)
            return replace(answer, termination=Termination.INFEASIBLE, dual_bound=None)
        case Ended.UNBOUNDED:
            return replace(answer, termination=Termination.UNBOUNDED, dual_bound=None)
        case Ended.STOPPED | Ended.UNCLEAR:
            kind = Termination.NO_SOLUTION if point is None else Termination.FEASIBLE
            return replace(answer, termination=kind, limit=outcome.limit)
        case Ended.FAILED:
            return replace(answer, duals=None)


def _above_cutoff(answer: Answer, cutoff: float) -> Answer:
    """Return what a search below the cutoff proves when it finds nothing: the cutoff is a bound."""
    return replace(
        answer,
        termination=Termination.NO_SOLUTION,
        point=None,
        primal_bound=None,
        duals=None,
        dual_bound=cutoff,
        message="no plan better than the cutoff",
    )


def _settled(
    program: MixedIntegerProgram, request: Request, outcome: Outcome, objective: float | None
) -> float | None:
    """Return the bound that is proven, None where nothing is."""
    bound = outcome.bound
    if bound is None or not np.isfinite(bound) or abs(bound) >= 1e20:
        return None
    if request.cutoff is not None and not program.continuous:
        # What lies above a cutoff is pruned, so the search knows nothing of plans there: HiGHS
        # was seen to report a bound far above the optimum it was forbidden to find.
        bound = min(bound, request.cutoff)
    if objective is not None and objective < bound <= objective + 1e-6 * max(1.0, abs(objective)):
        return float(objective)
    return float(bound)


def _holds(program: MixedIntegerProgram, point: Vector, tolerance: float) -> bool:
    return bool(np.isfinite(point).all()) and program.verify(point, tolerance=tolerance).ok
