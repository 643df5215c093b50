"""Execution of one job in this process: build, run, decode, verify."""

from __future__ import annotations

import copy
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from ... import timing
from ...errors import InvalidData, UnsupportedFormulation
from ...lazy import moved
from ...models.verification import Verification, stated
from ..contract.backend import Answer, Backend, Control, Request, processors
from ..contract.enums import CLAIMS_NONE, Feature, Limit, Termination
from ..contract.job import GAP, Job
from ..contract.registry import integrality_refusal, is_ours
from ..contract.solution import Solution
from ..processes.interrupts import on_interrupt
from .assembly import Claim, assemble
from .running import GRACE, PATIENCE, Run, proven_bound

if TYPE_CHECKING:
    from ..contract.events import Listener

log = logging.getLogger("crosstrack")

__all__ = ["GRACE", "claim", "execute", "warm_objective"]

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__ = moved(__name__, {".multistart": "multistart"})

#: Share of the time limit that interpreted kernels may use if another backend can go on. With an empty cache,
#: `minimum-snap/corridor-10` at 2 s has a plan in 4 of 4 runs with 0.35 and in 2 of 4 with 0.5, and `gate-2d` at
#: 3 s, which always has one, is proven optimal in 0 of 4 and 3 of 4.
INTERPRETED = 0.35


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
        The job. Unsupported options raise before anything starts.
    listener : callable, optional
        Function called with every :class:`~crosstrack.solvers.contract.events.Event`, in the caller's
        thread.
    on_prepare : callable, optional
        Function called with True before and False after work that only the first run needs
        (compilation), which may happen in the middle of a run.
    control : Control, optional
        Control that can stop the run from another thread.
    """
    if job.starts > 1:
        from .multistart import multistart

        return multistart(job, partial(execute, listener=listener), control)
    begin = time.perf_counter()
    job = job.resolved()
    asked = job.model.digest
    control = control or Control()
    assert isinstance(job.backend, Backend)
    if job.backend.hides(job.model):
        control.oracle = job.model.oracle()
        control.patience = PATIENCE if control.patience is None else control.patience
    try:
        result = claim(job, listener=listener, on_prepare=on_prepare, control=control)
    finally:
        if close := getattr(control.oracle, "close", None):
            close()
    if isinstance(job.backend, Backend) and not is_ours(job.backend):
        job, result = _as_asked(job, asked, result)
    with on_interrupt(partial(control.stop, Limit.INTERRUPTED)):  # the point is verified
        solution = assemble(job, result, control.oracle)
    solution = solution.lasting(time.perf_counter() - begin)
    if result.formulation is not None:
        from .starts import start_again

        solution = start_again(job, solution, partial(execute, listener=listener), control)
    return solution.lasting(time.perf_counter() - begin)


def claim(
    job: Job,
    *,
    listener: Listener | None = None,
    on_prepare: Callable[[bool], None] | None = None,
    control: Control | None = None,
) -> Claim:
    """Run `job` here and return what its backend claims; the parameters are those of :func:`execute`."""
    share = INTERPRETED if job.has_fallback else 1.0
    may_try = job.time_limit is None and job.criterion is None
    limit = timing.Limit(job.time_limit if job.counts_compilation else None, share, may_try)
    run = Run(job, job.find_target(), listener, limit)
    control = control or Control()
    control.criterion = job.criterion
    if control.criterion is not None and job.model.maximise:
        control.criterion = control.criterion.maximising()
    backend = run.target.backend

    @contextmanager
    def compiling() -> Iterator[None]:
        tell = None if job.counts_compilation else on_prepare
        if tell is not None:
            tell(True)
        begin = time.perf_counter()
        with nullcontext() if job.counts_compilation else control.paused():
            yield
        run.seconds["compile"] = run.seconds.get("compile", 0.0) + time.perf_counter() - begin
        if tell is not None:
            tell(False)

    if job.compiled:
        from ...jit import compile_always

        compile_always()
    with compiling():
        backend.prepare()
    started = timing.clock()
    with timing.watched(compiling), timing.within(limit):
        problem, request = _build(run, control)
    if job.time_limit is not None:
        left = job.time_limit - (timing.clock() - started)
        if job.counts_compilation:
            left = limit.end - time.perf_counter()
        request = replace(request, time_limit=max(left, 1e-3))
    with on_interrupt(partial(control.stop, Limit.INTERRUPTED)):
        with timing.watched(compiling), timing.within(limit):
            answer, problem = _search(run, problem, request)
        if limit.interpreted:
            names = ", ".join(sorted(limit.interpreted))
            run.notes.append(
                "compiling does not fit in the time limit: interpreted, and compiled in the background "
                f"for later calls: {names}"
            )
        if control.reason is Limit.INTERRUPTED and answer.limit is None:
            # The interrupt arrived after the solver had finished.
            answer = replace(answer, limit=Limit.INTERRUPTED)
        return _claim(run, answer, problem, control.bound)


def _search(run: Run, problem: Any, request: Request) -> tuple[Answer, Any]:
    """Return the answer of the backend and the program that it belongs to, the last of a sequence."""
    if run.target.formulation is None:
        answer = run.attend(problem, request)
    else:
        from .refinement import refine

        answer, problem = refine(run, problem, request)
    if run.job.model.certifier:
        from .certification import certified

        answer = certified(run, request, answer)
    return answer, problem


def _as_asked(job: Job, digest: str, found: Claim) -> tuple[Job, Claim]:
    """Return the job with a copy of its model, and a claim that can be judged with it.

    Arrays are read-only, but an external backend may have replaced a field, a sparse part or a
    derived value. The digest is therefore computed again from the fields.
    """
    try:
        model = copy.deepcopy(job.model)
        if model.digest == digest:
            return replace(job, model=model), found
    except Exception as error:  # a field may hold any object now
        log.debug("the digest cannot be computed again", exc_info=error)
    text = f"the model was changed during the run (digest {digest[:12]} before it): nothing is judged by it, make it anew"
    return job, Claim(Termination.FAILED, seconds=found.seconds, messages=(*found.messages, text))


def _build(run: Run, control: Control) -> tuple[Any, Request]:
    """Return the problem for the backend, with the warm start verified and encoded."""
    job, formulation = run.job, run.target.formulation
    warm, cutoff, seed = job.warm_start, None, job.seed
    with run.clock("build"):
        # Where the data of the verification is hidden, the caller has verified the warm start.
        if warm is not None and not job.model.is_blinded:
            checked = job.model.verify(warm, tolerance=job.verification_tolerance)
            near = None if checked.ok or formulation is None else formulation.guessed(warm)
            if near is None:
                cutoff = _objective(checked)
            else:
                run.notes.append(f"warm start: used as a guess; verification {checked.summary()}")
                warm, formulation = None, near
                run.target = replace(run.target, formulation=formulation)
        if formulation is not None and formulation.draws:
            if seed:
                formulation = formulation.started(seed)
                run.target = replace(run.target, formulation=formulation)
            seed = None
        if warm is not None and formulation is not None:
            if cutoff is not None:
                formulation = formulation.bounded(cutoff)
                run.target = replace(run.target, formulation=formulation)
            try:
                warm = formulation.encode(warm)
            except InvalidData:
                if job.formulation_options:
                    raise
                # It is for another plan, such as another order of stops.
                formulation = formulation.fitted(warm)
                run.target = replace(run.target, formulation=formulation)
                warm = formulation.encode(warm)
        seen = run.target.model
        if run.target.backend.hides(seen):
            seen = seen.blinded()
        if formulation is not None:
            control.prove(formulation.floor)
        problem: Any = seen if formulation is None else formulation.program
        if refusal := integrality_refusal(problem, run.target.backend):
            raise UnsupportedFormulation(refusal)
        for note in () if formulation is None else formulation.notes:
            run.notes.append(note)
            log.warning(note)
    features = run.target.backend.features
    return problem, Request(
        gap=GAP if job.gap is None else float(job.gap),
        tolerance=job.verification_tolerance
        * (1.0 if formulation is None else formulation.precision),
        seed=seed if Feature.SEED in features else None,
        threads=_threads(run),
        warm_start=warm if Feature.WARM_START in features else None,
        cutoff=cutoff if Feature.CUTOFF in features else None,
        evaluations=job.evaluations,
        target=stated(job.target, job.model.maximise),
        verbose=job.verbose,
        options=run.target.backend.checked_options(job.backend_options),
        control=control,
    )


def _threads(run: Run) -> int | None:
    """Return the number of threads, limited to the processors of this process with a note."""
    asked = run.job.threads
    most = processors()
    if asked is None or asked <= most:
        return asked
    run.notes.append(f"threads={asked}: {most} used, as many as there are processors here")
    log.warning(run.notes[-1])
    return most


def warm_objective(job: Job) -> float | None:
    """Return the objective of the warm start; None if it depends on a tolerance.

    Raises
    ------
    InvalidData
        The warm start is not a plan of the model.
    """
    return _objective(job.model.verify(job.warm_start, tolerance=job.verification_tolerance))


def _objective(checked: Verification) -> float | None:
    if not checked.ok:
        raise InvalidData(
            f"warm_start is no plan of the model: {checked.summary()}", field="warm_start"
        )
    return None if checked.within_tolerance else checked.objective


def _claim(run: Run, answer: Answer, problem: Any, reported: float | None) -> Claim:
    """Return what the backend claims, with its point decoded; `reported` is its bound on the way."""
    target = run.target
    formulation = target.formulation
    point = run.last_point if answer.point is None else answer.point
    plan: Any = None
    messages = [*run.notes, answer.message]
    undecodable = False
    counts = dict(answer.statistics)
    if point is not None and answer.termination not in CLAIMS_NONE:
        try:
            with run.clock("decode"):
                plan = run.decode(point)
                if formulation is not None and answer.duals is not None:
                    plan = formulation.explained(plan, point, answer.duals)
        except InvalidData as error:
            messages.append(f"the point is no plan: {error}")
            undecodable = True
    if plan is not None and formulation is not None:
        counts.update(formulation.statistics(plan))
    known, bound = target.proves, None
    if known and answer.termination not in CLAIMS_NONE:
        bounds = (proven_bound(problem, answer), reported)
        bound = max((entry for entry in bounds if entry is not None), default=None)
    spent, laps = dict(run.seconds), dict(answer.seconds)
    seconds = {
        "build": spent.get("build", 0.0) + laps.pop("build", 0.0),
        "compile": spent.get("compile", 0.0) + laps.pop("compile", 0.0),
        "solve": laps.pop("solve", spent.get("run", 0.0)),
        "decode": spent.get("decode", 0.0),
        "verify": 0.0,
        **{part: spent[part] for part in ("refine", "certify") if part in spent},
        **laps,
    }
    return Claim(
        termination=answer.termination,
        limit=answer.limit,
        plan=plan,
        primal_bound=answer.primal_bound,
        dual_bound=bound,
        proves=known,
        formulation=None if formulation is None else formulation.name,
        seconds=seconds,
        statistics=counts,
        incumbents=tuple(run.incumbents),
        duals=answer.duals,
        messages=tuple(messages),
        undecodable=undecodable,
        history=tuple(run.history),
    )
