"""Run of a backend: its clock, its incumbents, its thread."""

from __future__ import annotations

import logging
import math
import queue
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ... import timing
from ...errors import CrosstrackError, InvalidData, show
from ...models.verification import TOLERANCE
from ...timing import clock
from ..contract.backend import Answer, Backend, Control, Request
from ..contract.control import GRACE
from ..contract.enums import Feature, Limit, Termination
from ..contract.job import Job, Target
from ..contract.registry import find_backend, is_plain, shares_process
from ..contract.solution import Incumbent

if TYPE_CHECKING:
    from ..contract.events import Listener
    from ..processes.output import Printed

__all__ = ["GRACE", "PATIENCE", "Run", "proven_bound"]

log = logging.getLogger("crosstrack")
output = logging.getLogger("crosstrack.output")

#: Seconds that a run in a worker may take to stop once it has a plan or was interrupted.
PATIENCE = 2.0
#: Seconds between two checks of the stopping criteria.
POLL = 0.1
#: Seconds after the limit before an interpreted loop that does not return is ended by an exception.
STRETCH = 0.25
#: Share of the time limit for the heuristic that runs before an exact backend.
STARTING = 0.3


def proven_bound(problem: Any, answer: Answer) -> float | None:
    """Return the lower bound that an answer proves, from its multipliers or else as claimed.

    Parameters
    ----------
    problem : Model
        The program or model that was solved.
    answer : Answer
        The answer of the backend.

    Returns
    -------
    float or None
        The bound; None if the answer has none, or only one that holds near its point.
    """
    if answer.duals is not None and answer.point is not None:
        # Imported here because it loads SciPy, which native algorithms may not need.
        from ...models.programs.base import Program

        if isinstance(problem, Program):
            if answer.termination is not Termination.OPTIMAL and _is_local(problem, answer):
                return None
            bound = problem.dual_bound(answer.duals, answer.point)
            if np.isfinite(bound):
                return bound
    return answer.dual_bound


def _is_local(problem: Any, answer: Answer) -> bool:
    """Return True if the bound holds only near the point; see :meth:`.QuadraticProgram.dual_bound`."""
    if not hasattr(problem, "dual_residual"):
        return False
    largest = float(np.abs(problem.cost).max(initial=0.0))
    return bool(problem.dual_residual(answer.point, answer.duals) > TOLERANCE * max(1.0, largest))


def _captured(request: Request, backend: Backend) -> AbstractContextManager[Printed | None]:
    """Capture the output of `backend`; None if it cannot print."""
    if is_plain(backend) or shares_process(backend):  # the user's function may print
        return nullcontext()
    from ..processes.output import captured

    return captured(request.verbose, quiet=False)


@dataclass
class Run:
    """State of one job while it runs.

    Parameters
    ----------
    job : Job
        The job.
    target : Target
        Input of the backend. Its formulation changes during refinement.
    listener : callable, optional
        Function called with every incumbent and bound, in the caller's thread.
    limit : timing.Limit, optional
        Wall-clock limit for compilation.
    """

    job: Job
    target: Target
    listener: Listener | None = None
    limit: timing.Limit = field(default_factory=lambda: timing.Limit(None))
    seconds: dict[str, float] = field(default_factory=dict)
    incumbents: list[Incumbent[Any]] = field(default_factory=list)
    last_point: Any = None
    #: Objective of the starter's plan; worse plans of the backend are not incumbents.
    start_objective: float = math.inf
    #: Seconds per program of a formulation that is refined.
    spent: list[float] = field(default_factory=list)
    #: Report of the formulation per program.
    history: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @contextmanager
    def clock(self, part: str) -> Iterator[None]:
        """Add the seconds of the block to `part`, without the time of compilation."""
        begin = clock()
        try:
            yield
        finally:
            self.seconds[part] = self.seconds.get(part, 0.0) + clock() - begin

    def decode(self, point: Any) -> Any:
        """Return the plan that belongs to the point of a backend."""
        formulation = self.target.formulation
        return point if formulation is None else formulation.decode(point)

    def accept(self, seconds: float, objective: float, point: Any, evaluations: int | None) -> None:
        """Store an incumbent and pass it to the listener."""
        if objective > self.start_objective:
            return
        self.last_point = point
        self.limit.interpretation_end = self.limit.end  # no other backend needs to continue
        plan = None
        if self.listener is not None:
            try:
                plan = self.decode(point)
            except InvalidData as error:
                name = self.target.backend.name
                log.debug("incumbent %g of %s does not decode: %s", objective, name, error)
        if self.job.verbose:
            output.info("incumbent %.10g after %.2f s", objective, seconds)
        incumbent = Incumbent(seconds, objective, plan, evaluations)
        self.incumbents.append(incumbent)
        self._report("incumbent", incumbent=incumbent)

    def _report(self, kind: str, **content: Any) -> None:
        if self.listener is not None:
            from ..contract.events import Event, EventKind

            event = Event(EventKind(kind), self.job.model.name, self.target.backend.name, **content)
            self.listener(event)

    def _patience(self, control: Control) -> float:
        """Return the seconds that the run may take to stop."""
        longest = self.target.backend.patience(self.target.kind)
        is_patient = control.reason is not Limit.INTERRUPTED and self.last_point is None
        return longest if control.patience is None or is_patient else min(control.patience, longest)

    def _run(self, problem: Any, request: Request) -> Answer:
        """Run the backend, after its starter if it has one and there is a time limit."""
        backend = self.target.backend
        name = backend.starter(problem) if request.time_limit is not None else ""
        if not name or request.warm_start is not None:
            return backend.run(problem, request)
        assert request.time_limit is not None
        heuristic = find_backend(name, problem)
        share = STARTING * request.time_limit
        # Imports may have used the share of interpreted kernels that is measured from the start.
        end = min(time.perf_counter() + share, self.limit.end)
        self.limit.interpretation_end = max(self.limit.interpretation_end, end)
        try:
            first = request.within(heuristic, problem, time_limit=share)
        except timing.OutOfTime:  # the backend may still return a plan without a search
            return backend.run(problem, request)
        checked = None if first.point is None else problem.verify(first.point)
        if checked is None or not checked.ok or checked.within_tolerance:
            return backend.run(problem, request)
        self.start_objective = checked.objective
        request.control.incumbent(checked.objective, first.point)
        warm = first.point if Feature.WARM_START in backend.features else None
        answer = backend.run(problem, replace(request, warm_start=warm))
        counts = {**answer.statistics, "starter": name}
        value = math.inf if answer.primal_bound is None else answer.primal_bound
        open_ = answer.termination in (Termination.NO_SOLUTION, Termination.FEASIBLE)
        if open_ and (answer.point is None or checked.objective < value):
            return replace(
                answer, termination=Termination.FEASIBLE, point=first.point,
                primal_bound=checked.objective, statistics=counts,
            )  # fmt: skip
        return replace(answer, statistics=counts)

    def attend(self, problem: Any, request: Request) -> Answer:
        """Run the backend in a thread, so that this one can handle incumbents, the clock and Ctrl-C.

        A brief run uses this thread; its incumbents are handled when it has ended.

        Parameters
        ----------
        problem : Model
            The program, or the model of a native algorithm.
        request : Request
            Options of the run.

        Returns
        -------
        Answer
            ``FAILED`` with the message of the exception if the backend raised one. Exceptions of type
            :class:`CrosstrackError` are raised again.
        """
        control, backend = request.control, self.target.backend
        brief = backend.is_brief(problem)
        box: list[Answer | BaseException] = []

        def work() -> None:
            try:
                with capture, timing.within(self.limit):
                    box.append(self._run(problem, request))
            except BaseException as error:  # the waiting thread raises or records it
                box.append(error)
            finally:
                control.events.put(None)

        with self.clock("run"), _captured(request, backend) as printed:
            capture = nullcontext() if printed is None else printed.by_this_thread()
            control.arm(None if brief else request.time_limit)
            thread = threading.Thread(target=work, name=f"crosstrack-{backend.name}", daemon=True)
            if brief:
                work()
            else:
                thread.start()
            given_up = False
            stop_time: float | None = None
            try:
                while True:
                    try:
                        event = control.events.get(timeout=POLL)
                    except queue.Empty:
                        if printed is not None:
                            printed.forward()
                        control.check()
                        if self.limit.is_interpreted_too_long:
                            control.stop(Limit.TIME)
                        if control.stopped:
                            stop_time = stop_time or time.perf_counter()
                            late = time.perf_counter() - stop_time
                            given_up = late > self._patience(control)
                            if late > STRETCH and thread.ident is not None and not brief:
                                from ... import jit

                                jit.end_interpretation(thread.ident)
                        if given_up:
                            break
                        continue
                    if event is None:
                        break
                    if isinstance(event, float):
                        self._report("bound", bound=event)
                    else:
                        self.accept(*event)
            except BaseException:
                # An exception of the listener or a second Ctrl-C must not leave the backend running.
                control.stop(Limit.INTERRUPTED)
                raise
            finally:
                control.disarm()
        if given_up:
            control.abandon()
            log.info("backend %s does not stop; its thread is abandoned", backend.name)
            return Answer(
                Termination.NO_SOLUTION,
                control.reason,
                dual_bound=control.bound,
                message="did not stop in time; given up",
            )
        if not brief:
            thread.join()
        outcome = box[0]
        if isinstance(outcome, Answer):
            return outcome
        if isinstance(outcome, timing.OutOfTime):
            reason = control.reason or Limit.TIME
            return Answer(Termination.NO_SOLUTION, reason, dual_bound=control.bound)
        if not isinstance(outcome, BaseException):
            outcome = TypeError(f"run() must return an Answer, got {show(outcome)}")
        if isinstance(outcome, CrosstrackError) or not isinstance(outcome, Exception):
            raise outcome
        log.error("backend %s failed", backend.name, exc_info=outcome)
        text = f"{type(outcome).__name__}: {outcome}"
        limit = Limit.MEMORY if isinstance(outcome, MemoryError) else None
        return Answer(Termination.FAILED, limit, message=text)
