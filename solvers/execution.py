"""Running one job in this process: build, run, decode, verify; a limit or Ctrl-C loses nothing."""

from __future__ import annotations

import logging
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from ..errors import CrosstrackError, InvalidData
from ..models.programs.linear import MixedIntegerProgram, QuadraticProgram
from ..models.verification import TOLERANCE, Verification
from ..version import __version__
from .backend import Answer, Control, Feature, Guarantee, Limit, Request, Termination
from .job import GAP, Job, Target
from .solution import Incumbent, Solution, relative_gap

__all__ = ["GRACE", "execute"]

log = logging.getLogger("crosstrack")

#: Seconds that a run may take beyond its time limit before it is given up.
GRACE = 10.0
#: Difference between objective and bound, in the objective's unit, that rounding explains.
NOTHING = 1e-9

Listener = Callable[[Incumbent[Any]], None]

_CLAIMS_PLAN = (Termination.OPTIMAL, Termination.LOCALLY_OPTIMAL, Termination.FEASIBLE)
_CLAIMS_NONE = (Termination.INFEASIBLE, Termination.UNBOUNDED)


@dataclass
class _Run:
    """What happens during one job."""

    job: Job
    target: Target
    listener: Listener | None
    seconds: dict[str, float] = field(default_factory=dict)
    incumbents: list[Incumbent[Any]] = field(default_factory=list)
    last_point: Any = None

    @contextmanager
    def clock(self, part: str) -> Iterator[None]:
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[part] = self.seconds.get(part, 0.0) + time.perf_counter() - begin

    def decode(self, point: Any) -> Any:
        """Return the plan of a backend's point."""
        formulation = self.target.formulation
        return point if formulation is None else formulation.decode(point)

    def heard(self, seconds: float, objective: float, point: Any) -> None:
        """Keep an incumbent, and tell the listener."""
        self.last_point = point
        plan = None
        if self.listener is not None:
            try:
                plan = self.decode(point)
            except InvalidData as error:
                log.debug(
                    "incumbent %g of %s does not decode: %s",
                    objective,
                    self.target.backend.name,
                    error,
                )
        incumbent = Incumbent(seconds, objective, plan)
        self.incumbents.append(incumbent)
        if self.listener is not None:
            self.listener(incumbent)


def execute(
    job: Job,
    *,
    listener: Listener | None = None,
    on_prepare: Callable[[bool], None] | None = None,
    control: Control | None = None,
) -> Solution[Any]:
    """Run `job` here and return its verified solution.

    Parameters
    ----------
    job : Job
        What is asked; whatever it cannot have raises before anything starts.
    listener : callable, optional
        Called with every :class:`~crosstrack.solvers.solution.Incumbent`, in the caller's thread.
    on_prepare : callable, optional
        Called with True before and False after what only the first run needs (compilation).
    control : Control, optional
        To stop the run from another thread.
    """
    if job.starts > 1:
        return _multistart(job, listener)
    begin = time.perf_counter()
    run = _Run(job, job.target(), listener)
    control = control or Control()
    backend = run.target.backend
    if on_prepare is not None:
        on_prepare(True)
    with run.clock("compile"):
        backend.prepare()
    if on_prepare is not None:
        on_prepare(False)
    started = time.perf_counter()
    problem, request = _build(run, control)
    if job.time_limit is not None:
        left = max(job.time_limit - (time.perf_counter() - started), 1e-3)
        request = replace(request, time_limit=left)
    with _interrupt(control):
        answer, problem = _refine(run, problem, request)
    if control.reason is Limit.INTERRUPTED and answer.limit is None:
        answer = replace(answer, limit=Limit.INTERRUPTED)  # asked for when all was done but this
    solution = _finish(run, answer, problem)
    seconds = {**solution.seconds, "total": time.perf_counter() - begin}
    return replace(solution, seconds=seconds)


def _build(run: _Run, control: Control) -> tuple[Any, Request]:
    """Return the problem for the backend, with the warm start verified and encoded."""
    job, formulation = run.job, run.target.formulation
    warm, cutoff, seed = job.warm_start, None, job.seed
    with run.clock("build"):
        if formulation is not None and formulation.draws:
            if seed:
                formulation = formulation.started(seed)
                run.target = replace(run.target, formulation=formulation)
            seed = None
        if warm is not None:
            checked = job.model.verify(warm, tolerance=_tolerance(job))
            if not checked.ok:
                raise InvalidData(
                    f"warm_start is no plan of the model: {checked.summary()}", field="warm_start"
                )
            if not checked.within_tolerance:
                cutoff = checked.objective
                if formulation is not None and cutoff is not None:
                    formulation = formulation.bounded(cutoff)
                    run.target = replace(run.target, formulation=formulation)
            if formulation is not None:
                warm = formulation.encode(warm)
        problem: Any = run.target.model if formulation is None else formulation.program
    features = run.target.backend.features
    return problem, Request(
        gap=GAP if job.gap is None else float(job.gap),
        tolerance=_tolerance(job) * (1.0 if formulation is None else formulation.precision),
        seed=seed,
        threads=job.threads,
        warm_start=warm if Feature.WARM_START in features else None,
        cutoff=cutoff if Feature.CUTOFF in features else None,
        options=run.target.backend.checked_options(job.backend_options),
        control=control,
    )


def _tolerance(job: Job) -> float:
    return TOLERANCE if job.tolerance is None else float(job.tolerance)


@contextmanager
def _interrupt(control: Control) -> Iterator[None]:
    """Let Ctrl-C stop the run instead of losing it; a second one raises as usual."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = signal.getsignal(signal.SIGINT)
    if previous is not signal.default_int_handler:
        yield  # the caller handles signals; it has its own way to stop us
        return

    def handler(number: int, frame: Any) -> None:
        if control.reason is Limit.INTERRUPTED:
            signal.default_int_handler(number, frame)
        control.stop(Limit.INTERRUPTED)

    signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)


def _attend(run: _Run, problem: Any, request: Request) -> Answer:
    """Run the backend in a thread, so that this one can hear incumbents, the clock and Ctrl-C."""
    control, backend = request.control, run.target.backend
    box: list[Answer | BaseException] = []

    def work() -> None:
        try:
            box.append(backend.run(problem, request))
        except BaseException as error:  # handed to the waiting thread, which raises or records it
            box.append(error)
        finally:
            control.events.put(None)

    with run.clock("run"):
        control.arm(request.time_limit)
        thread = threading.Thread(target=work, name=f"crosstrack-{backend.name}", daemon=True)
        thread.start()
        given_up = False
        stop_seen: float | None = None
        try:
            while True:
                try:
                    event = control.events.get(timeout=0.25)
                except queue.Empty:
                    if control.stopped:
                        stop_seen = stop_seen or time.perf_counter()
                        given_up = time.perf_counter() - stop_seen > GRACE
                    if given_up:
                        break
                    continue
                if event is None:
                    break
                run.heard(*event)
        except BaseException:
            # A listener that raises, or a second Ctrl-C, must not leave the backend running.
            control.stop(Limit.INTERRUPTED)
            raise
        finally:
            control.disarm()
    if given_up:
        log.warning("backend %s does not stop; its thread is left behind", backend.name)
        return Answer(
            Termination.NO_SOLUTION, control.reason, message="did not stop when asked; given up"
        )
    thread.join()
    outcome = box[0]
    if isinstance(outcome, Answer):
        return outcome
    if isinstance(outcome, CrosstrackError) or not isinstance(outcome, Exception):
        raise outcome
    log.error("backend %s failed", backend.name, exc_info=outcome)
    text = f"{type(outcome).__name__}: {outcome}"
    limit = Limit.MEMORY if isinstance(outcome, MemoryError) else None
    return Answer(Termination.FAILED, limit, message=text)


def _refine(run: _Run, problem: Any, request: Request) -> tuple[Answer, Any]:
    """Run the backend, and again on refined programs until the formulation is content.

    Where each program is a relaxation of the model, a bound of any of them stands. Returns the last
    answer, its parts and counts summed over all runs, with the program answered.
    """
    begin, whole_limit = time.perf_counter(), request.time_limit
    answer = _attend(run, problem, request)
    total, counts = dict(answer.seconds), dict(answer.statistics)
    rounds, bound = 0, -np.inf
    exact = run.target.backend.guarantee is Guarantee.EXACT
    while run.target.formulation is not None and answer.point is not None:
        before = run.target, problem, answer
        relaxes = run.target.formulation.relaxes
        if not relaxes and answer.termination not in _CLAIMS_PLAN:
            break
        with run.clock("refine"):
            finer = run.target.formulation.refined(answer.point, _tolerance(run.job))
        if finer is None:
            break
        if exact and relaxes:
            bound = max(bound, _bound(problem, answer))
        left = None
        limit, message = answer.limit, answer.message
        if not relaxes and limit is Limit.ITERATIONS:
            limit = None  # a point that is not quite optimal yet is as good a start as any
        solved = answer.termination is Termination.OPTIMAL
        if solved or not relaxes:
            if whole_limit is not None:
                left = whole_limit - (time.perf_counter() - begin)
                limit = Limit.TIME if left <= 0 else limit
            limit = request.control.reason if request.control.stopped else limit
            message = "stopped between two refinements of the program"
        if limit is not None or (relaxes and not solved):
            # The point of a relaxation is no plan of the model; that of an approximation may be one.
            answer = (
                Answer(Termination.NO_SOLUTION, limit, message=message)
                if relaxes
                else replace(answer, limit=limit, message=message)
            )
            break
        with run.clock("refine"):
            program = finer.program
        run.target, problem = replace(run.target, formulation=finer), program
        warm = None if request.warm_start is None else answer.point
        if not relaxes and Feature.WARM_START in run.target.backend.features:
            warm = program.guess  # type: ignore[attr-defined]
        request = replace(request, time_limit=left, warm_start=warm)
        answer = _attend(run, problem, request)
        rounds += 1
        for part, seconds in answer.seconds.items():
            total[part] = total.get(part, 0.0) + seconds
        for name, count in answer.statistics.items():
            # Counts add up; what is measured, a residual say, is the last one's.
            former = counts.get(name, 0)
            whole = isinstance(count, int) and isinstance(former, int)
            counts[name] = count + former if whole else count  # type: ignore[operator]
        if not relaxes and (answer.point is None or answer.termination not in _CLAIMS_PLAN):
            # What the coarser program gave is still the best there is; verification judges it.
            ended = f"on the refined program {answer.termination}: {answer.message}".rstrip(": ")
            limit = answer.limit
            run.target, problem, answer = before
            answer = replace(answer, limit=limit, message=ended)
            break
    if rounds:
        counts["refinements"] = rounds
    if answer.point is None and answer.termination not in _CLAIMS_NONE and np.isfinite(bound):
        answer = replace(answer, dual_bound=max(bound, answer.dual_bound or bound))
    return replace(answer, seconds=total, statistics=counts), problem


def _bound(problem: Any, answer: Answer) -> float:
    """Return the lower bound on a program that an answer proves, -inf without one."""
    if answer.duals is not None and isinstance(problem, QuadraticProgram):
        return problem.dual_bound(answer.duals, answer.point)
    if answer.duals is not None and isinstance(problem, MixedIntegerProgram):
        return problem.dual_bound(answer.duals)
    return -np.inf if answer.dual_bound is None else answer.dual_bound


def _finish(run: _Run, answer: Answer, problem: Any) -> Solution[Any]:
    """Decode and verify what the backend claims, and keep only what stands."""
    job, target = run.job, run.target
    backend, model = target.backend, job.model
    exact = backend.guarantee is Guarantee.EXACT
    point = run.last_point if answer.point is None else answer.point
    termination, messages = answer.termination, [answer.message]
    dual = answer.dual_bound if exact else None
    plan: Any = None
    decoded: Any = None
    verification: Verification | None = None
    rejected: Any = None
    stored: Any = None
    if termination in _CLAIMS_NONE and not exact:
        messages.append(f"claims {termination}, which a {backend.guarantee} backend cannot prove")
        termination = Termination.NO_SOLUTION
    if point is not None and termination not in _CLAIMS_NONE:
        try:
            with run.clock("decode"):
                plan = run.decode(point)
                if target.formulation is not None and answer.duals is not None:
                    plan = target.formulation.explained(plan, point, answer.duals)
                decoded = plan
            with run.clock("verify"):
                verification = model.verify(plan, tolerance=_tolerance(job))
        except InvalidData as error:
            # Whether it does not decode or is no plan of the model: nothing of it is returned.
            messages.append(f"the point is no plan: {error}")
            termination, plan, dual = Termination.REJECTED, None, None
        else:
            stored = partial(model.plan_to_data, plan)
            if not verification.ok:
                messages.append(f"plan {verification.summary()}")
                rejected = model.plan_to_data(plan)
                termination, plan, stored = Termination.REJECTED, None, None
                dual = None
    elif termination in _CLAIMS_PLAN:
        messages.append(f"claims {termination} without a point")
        termination = Termination.FAILED
    primal = verification.objective if plan is not None and verification is not None else None
    if plan is not None and termination in (Termination.NO_SOLUTION, Termination.FAILED):
        termination = Termination.FEASIBLE  # the run ended badly, yet its last incumbent verifies
    if exact and answer.duals is not None and termination is not Termination.REJECTED:
        # The bound of a continuous program is not believed but computed from its multipliers.
        if isinstance(problem, MixedIntegerProgram):
            certified = problem.dual_bound(answer.duals)
            dual = certified if np.isfinite(certified) else dual
        elif isinstance(problem, QuadraticProgram) and answer.point is not None:
            dual = problem.dual_bound(answer.duals, answer.point)
    if termination is Termination.OPTIMAL and exact:
        dual = answer.primal_bound if dual is None else dual
        if dual is None:
            dual = primal
        gap = relative_gap(primal, dual)
        asked = GAP if job.gap is None else job.gap
        # A relative gap says nothing of an optimum of 0.
        apart = primal is None or dual is None or primal - dual > NOTHING
        if gap is None or (gap > asked * 1.01 + 1e-6 and apart):
            messages.append(f"claims optimal, but the verified plan leaves a gap of {gap}")
            termination = Termination.FEASIBLE
    counts = dict(answer.statistics)
    if decoded is not None and target.formulation is not None:
        counts.update(target.formulation.statistics(decoded))
    seconds = dict(run.seconds)
    waited = seconds.pop("run", 0.0)
    reported = dict(answer.seconds)
    seconds["build"] = seconds.get("build", 0.0) + reported.pop("build", 0.0)
    seconds["compile"] = seconds.get("compile", 0.0) + reported.pop("compile", 0.0)
    solve = reported.pop("solve", waited)
    parts = {
        "build": seconds.pop("build"),
        "compile": seconds.pop("compile"),
        "solve": solve,
        "decode": seconds.get("decode", 0.0),
        "verify": seconds.get("verify", 0.0),
        **({"refine": seconds["refine"]} if "refine" in seconds else {}),
        **reported,
    }
    return Solution(
        model=job.model.kind,
        instance=job.model.name,
        digest=job.model.digest,
        backend=backend.name,
        formulation=None if target.formulation is None else target.formulation.name,
        termination=termination,
        limit=answer.limit,
        primal_bound=primal,
        dual_bound=dual,
        plan=plan,
        stored_plan=stored,
        verification=verification,
        seconds=parts,
        incumbents=tuple(run.incumbents),
        backend_version=backend.version(),
        version=__version__,
        options=job.options(),
        formulation_options=dict(job.formulation_options),
        seed=job.seed,
        statistics=counts,
        message="; ".join(text for text in messages if text),
        rejected_plan=rejected,
        duals=None if plan is None else answer.duals,
    )


def _multistart(job: Job, listener: Listener | None) -> Solution[Any]:
    """Run the job from several seeds and return the best result with all of them."""
    job.target()
    first = job.seed or 0
    results: list[Solution[Any]] = []
    begin = time.perf_counter()
    ended: Limit | None = None
    for start in range(job.starts):
        left = None if job.time_limit is None else job.time_limit - (time.perf_counter() - begin)
        if left is not None and left <= 0 and results:
            ended = Limit.TIME
            break
        one = replace(job, seed=first + start, starts=1, time_limit=left)
        results.append(execute(one, listener=listener))
        if results[-1].limit is Limit.INTERRUPTED:
            ended = Limit.INTERRUPTED
            break
    best = min(
        results,
        key=lambda s: (
            s.primal_bound is None,
            s.primal_bound if s.primal_bound is not None else 0.0,
        ),
    )
    seconds = {
        part: sum(result.seconds.get(part, 0.0) for result in results) for part in best.seconds
    }
    return replace(
        best,
        starts=tuple(results),
        seconds=seconds,
        options=job.options(),
        limit=ended or best.limit,
    )
