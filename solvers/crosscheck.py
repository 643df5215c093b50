"""The verb :func:`compare`: several backends on several models, one process each, and a verdict."""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cloudpickle

from ..errors import CrosstrackError, InvalidData, UnknownName, UnsupportedOption
from ..models.fields import show
from ..models.model import Model, as_model
from ..models.records import Table, given
from ..models.verification import check_number
from .assembly import Claim, assemble
from .backend import Backend, Feature, Limit, Termination
from .campaign import Record
from .execution import GRACE
from .interrupts import on_interrupt
from .isolation import Worker
from .job import Job
from .registry import find_backend, recommended
from .report.tables import frame, markup, render
from .running import PATIENCE
from .solution import Solution
from .verdict import Outcome, Verdict, judge

if TYPE_CHECKING:
    from pandas import DataFrame

__all__ = ["Comparison", "compare", "rejudged"]

log = logging.getLogger("crosstrack")


@dataclass(frozen=True)
class Comparison:
    """What :func:`compare` found: a verdict a model; printed, a table.

    Parameters
    ----------
    verdicts : tuple of Verdict
        One a model, in their order.
    interrupted : bool
        Whether Ctrl-C ended it; what had been finished is there.
    """

    verdicts: tuple[Verdict, ...]
    interrupted: bool = False

    @property
    def outcome(self) -> Outcome:
        """The worst of the verdicts: one contradiction makes it a contradiction."""
        outcomes = {verdict.outcome for verdict in self.verdicts}
        for outcome in (Outcome.CONTRADICTION, Outcome.INCONCLUSIVE):
            if outcome in outcomes:
                return outcome
        return Outcome.AGREED if outcomes and not self.interrupted else Outcome.INCONCLUSIVE

    @property
    def solutions(self) -> tuple[Solution[Any], ...]:
        """All answers, model by model."""
        return tuple(s for verdict in self.verdicts for s in verdict.solutions)

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as JSON data."""
        return {
            "verdict": str(self.outcome),
            "interrupted": self.interrupted,
            "instances": [verdict.to_dict() for verdict in self.verdicts],
        }

    def parts(self) -> list[Any]:
        """Return what to print: every verdict with its table, and the outcome of all at the end."""
        parts = [part for verdict in self.verdicts for part in verdict.parts()]
        if len(self.verdicts) > 1:
            parts.append(f"\nall {len(self.verdicts)} instances: {self.outcome}")
        if self.interrupted:
            parts.append("interrupted: what is missing was not run")
        return parts

    def summary(self) -> str:
        """Return the verdicts with their tables as text."""
        return render(*self.parts(), width=140)

    def to_frame(self) -> DataFrame:
        """Return the answers as a pandas frame, one a row; needs pandas."""
        return frame(self.solutions)

    def __str__(self) -> str:
        return self.summary()

    def _repr_html_(self) -> str:
        return markup(*self.parts())


@dataclass
class _Task:
    """One job of a comparison, with the place of its answer."""

    row: int
    column: int
    turn: int
    job: Job
    refusal: CrosstrackError | None = None


def compare(
    models: Sequence[Model[Any]] | Model[Any],
    backends: Sequence[str | Backend],
    *,
    formulation: str | None = None,
    formulation_options: Mapping[str, Any] | None = None,
    time_limit: float | None = 60.0,
    grace: float = GRACE,
    gap: float | None = None,
    tolerance: float | None = None,
    seed: int | None = None,
    threads: int | None = None,
    evaluations: int | None = None,
    target: float | None = None,
    repeats: int = 1,
    warm_start: Any = None,
    backend_options: Mapping[str, Mapping[str, Any]] | None = None,
    compiled: bool = False,
    workers: int = 1,
    pool: Executor | None = None,
    record: str | Path | None = None,
    resume: bool = False,
    on_solution: Callable[[Solution[Any]], None] | None = None,
) -> Comparison:
    """Solve every model with every backend, each in a process of its own, and judge the answers.

    A backend that crashes, hangs past its deadline or refuses costs its own row only.

    Parameters
    ----------
    models : sequence of Model
        What is asked.
    backends : sequence of str or Backend
        Names, ``"name:formulation"`` for one on a certain formulation, ``"auto"`` for the one that
        :func:`crosstrack.solve` takes, or backend objects.
    formulation, formulation_options : optional
        For the backends that take programs.
    time_limit : float, optional
        Seconds for each job, the building of the program included.
    grace : float
        Seconds beyond it before the worker is killed with its process group.
    gap, tolerance : float, optional
        The same for all backends; heuristics know no gap and are not asked for one.
    seed, threads, evaluations : int, optional
        Given to the backends that have the feature.
    target : float, optional
        An objective that is good enough to stop at, for the backends that report incumbents.
    repeats : int
        How often each backend that draws runs on each model, from the seeds ``seed``, ``seed + 1``
        …; the verdicts then hold medians, quartiles and success rates over them.
    warm_start : plan, Solution or sequence of them, optional
        One for all models, or one a model (None where there is none); given to the backends that
        take one.
    backend_options : mapping of str to mapping, optional
        Own options by the backend's name; what is not given is as the backend's
        ``comparison_options`` say, ``polish=False`` for solvers of quadratic programs.
    compiled : bool
        Compile the loops of our own algorithms instead of interpreting short ones, so that the seconds
        of runs compare.
    workers : int
        How many jobs run at the same time.
    pool : concurrent.futures.Executor, optional
        Where the workers are launched instead of from threads of this process (Dask's too).
    record : str or Path, optional
        A JSONL file that receives every finished answer at once.
    resume : bool
        Go on with a record that exists, running only what it lacks.
    on_solution : callable, optional
        Called with every answer, in the order in which they come.

    Returns
    -------
    Comparison
        A verdict a model: ``AGREED``, ``INCONCLUSIVE`` or ``CONTRADICTION``.

    Raises
    ------
    UnknownName, UnsupportedOption, InvalidData
        A name or an option that no row could have; a refusal of one backend alone is a row.
    """
    models = [as_model(model) for model in _listed("models", models)]
    backends = _listed("backends", backends)
    if not models or not backends:
        raise InvalidData("compare needs at least one model and one backend")
    for name, value in (("workers", workers), ("repeats", repeats)):
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise UnsupportedOption(f"{name} must be a whole number >= 1, got {show(value)}")
    check_number("grace", grace)
    if pool is not None and not isinstance(pool, Executor):
        raise UnsupportedOption(
            f"pool must be a concurrent.futures.Executor, got {type(pool).__name__}"
        )
    if resume and record is None:
        raise UnsupportedOption("resume needs a record to go on with")
    own = {
        name: Table().coerce(f"backend_options[{name!r}]", options, {})
        for name, options in given("backend_options", backend_options).items()
    }
    warm = _warm_starts(warm_start, models)
    common = {
        "formulation_options": given("formulation_options", formulation_options),
        "time_limit": time_limit, "gap": gap, "tolerance": tolerance, "seed": seed, "threads": threads,
        "evaluations": evaluations, "target_value": target, "compiled": compiled,
    }  # fmt: skip
    known = {_name_of(backend) for backend in backends}
    for name in own:
        if name not in known:
            raise UnknownName("backend in backend_options", name, known)
    tasks = []
    for row, model in enumerate(models):
        for column, asked in enumerate(backends):
            # Looked up among what this model accepts: problems may share names.
            backend, wanted = _named(asked, formulation, model)
            draws = Feature.SEED in backend.features
            for turn in range(repeats if draws else 1):
                if draws and repeats > 1:
                    common["seed"] = (seed or 0) + turn
                tasks.append(
                    _task(
                        (row, column, turn), model, backend, wanted, common, warm[row],
                        own.get(_name_of(asked), {}),
                    )
                )  # fmt: skip
            common["seed"] = seed
    answers: dict[tuple[int, int, int], Solution[Any]] = {}
    with contextlib.ExitStack() as stack:
        book = stack.enter_context(Record(record, resume=resume)) if record is not None else None
        open_tasks: deque[_Task] = deque()
        for task in tasks:
            found = book.find(task.job, task.job.model) if book is not None else None
            if found is None:
                open_tasks.append(task)
            else:
                answers[task.row, task.column, task.turn] = found

        def finished(task: _Task, solution: Solution[Any]) -> None:
            answers[task.row, task.column, task.turn] = solution
            if book is not None and solution.limit is not Limit.INTERRUPTED:
                book.add(task.job, solution)
            if on_solution is not None:
                on_solution(solution)

        if pool is not None:
            interrupted = _by_pool(open_tasks, pool, grace, finished)
        else:
            interrupted = _by_threads(open_tasks, min(workers, len(tasks)), grace, finished)
    verdicts = []
    for row, model in enumerate(models):
        found_here = [answers[place] for place in sorted(answers) if place[0] == row]
        if found_here or not interrupted:
            verdicts.append(judge(model.name or model.digest[:12], found_here, model))
    return Comparison(tuple(verdicts), interrupted)


def rejudged(model: Model[Any], *parts: Comparison) -> Comparison:
    """Return one comparison on `model` of answers that came in several turns."""
    solutions = [solution for part in parts for solution in part.solutions]
    verdict = judge(model.name or model.digest[:12], solutions, model)
    return Comparison((verdict,), any(part.interrupted for part in parts))


def _listed(name: str, value: Any) -> list[Any]:
    """Return several models or backends, or the one that was given, as a list."""
    if not isinstance(value, Iterable) or isinstance(value, str):
        return [value]
    try:
        return list(value)
    except TypeError:  # such as an array without axes
        raise InvalidData(f"{name} must be a list, got {show(value)}", field=name) from None


def _name_of(backend: str | Backend) -> str:
    """Return the name of a backend that is asked for, ``"name:formulation"`` included."""
    return backend.partition(":")[0] if isinstance(backend, str) else find_backend(backend).name


def _named(
    backend: str | Backend, formulation: str | None, model: Model[Any]
) -> tuple[Backend, str | None]:
    """Return the backend and the formulation that ``"name:formulation"`` asks for."""
    if isinstance(backend, str) and ":" in backend:
        backend, _, formulation = backend.partition(":")
    if backend == "auto":
        return recommended(model, formulation), formulation
    return find_backend(backend, model), formulation


def _warm_starts(value: Any, models: Sequence[Model[Any]]) -> list[Any]:
    """Return one plan a model, from one for all of them or a sequence of one for each."""
    many = isinstance(value, list | tuple) and not all(isinstance(k, int) for k in value)
    values = list(value) if many else [value] * len(models)
    if len(values) != len(models):
        raise InvalidData(
            f"warm_start has {len(values)} entries for {len(models)} models", field="warm_start"
        )
    pairs = zip(models, values, strict=True)
    return [None if value is None else model.as_plan(value) for model, value in pairs]


def _task(
    place: tuple[int, int, int],
    model: Model[Any],
    backend: Backend,
    formulation: str | None,
    common: Mapping[str, Any],
    warm_start: Any,
    own: Mapping[str, Any],
) -> _Task:
    """Return the task with the common options that the backend knows."""
    asked = dict(common)
    for name, feature in (
        ("gap", Feature.GAP),
        ("seed", Feature.SEED),
        ("threads", Feature.THREADS),
        ("evaluations", Feature.EVALUATIONS),
        ("target_value", Feature.INCUMBENTS),
    ):
        if feature not in backend.features and not (name == "seed" and backend.deterministic):
            asked[name] = None
    native = isinstance(model, backend.accepts)
    if native:
        asked["formulation_options"] = {}
    usable = {Feature.WARM_START, Feature.CUTOFF} & backend.features
    job = Job(
        model=model,
        backend=backend,
        formulation=None if native else formulation,
        warm_start=warm_start if usable else None,
        backend_options=dict(own),
        **asked,
    )
    backend.checked_options(job.backend_options)
    try:
        target = job.target()
        kind = type(target.model) if target.formulation is None else target.formulation.program_type
        options = {**backend.comparison_options(kind), **job.backend_options}
        job = replace(job, backend_options=options)
    except CrosstrackError as error:
        if isinstance(error, UnknownName):
            raise
        return _Task(*place, job, error)
    return _Task(*place, job)


def _refused(task: _Task) -> Solution[Any]:
    """Return the row of a backend that cannot run the job at all."""
    return failed(task.job, f"{type(task.refusal).__name__}: {task.refusal}")


def failed(job: Job, message: str, seconds: float = 0.0) -> Solution[Any]:
    """Return the solution of a job that did not run to an answer."""
    broken = Claim(
        Termination.FAILED,
        formulation=job.formulation,
        seconds={"total": seconds},
        messages=(message,),
    )
    return assemble(job, broken)


def _run(worker: Worker, job: Job, grace: float) -> Solution[Any]:
    begin = time.monotonic()
    try:
        return worker.solve(job, grace=grace)
    except Exception as error:  # whatever one row meets, the others go on
        if not isinstance(error, CrosstrackError):
            log.error("%s could not be run", job.backend, exc_info=error)
        return failed(job, f"{type(error).__name__}: {error}", time.monotonic() - begin)


Finished = Callable[[_Task, Solution[Any]], None]


def _by_threads(tasks: deque[_Task], count: int, grace: float, finished: Finished) -> bool:
    """Run the tasks in threads that drive workers; return whether Ctrl-C ended it.

    A worker serves one backend only, and lives while that backend has jobs left.
    """
    # None for each thread that has ended.
    results: queue.SimpleQueue[tuple[_Task, Solution[Any] | BaseException] | None]
    results = queue.SimpleQueue()
    lock = threading.Lock()
    idle: dict[int, list[Worker]] = {}
    busy: set[Worker] = set()
    left: dict[int, int] = {}
    stop = threading.Event()
    for task in tasks:
        left[task.column] = left.get(task.column, 0) + 1

    def work() -> None:
        try:
            drive()
        finally:
            results.put(None)

    def drive() -> None:
        while True:
            with lock:
                if stop.is_set() or not tasks:
                    return
                task = tasks.popleft()
                if task.refusal is None:
                    worker = (idle.get(task.column) or [Worker()]).pop()
                    busy.add(worker)
            outcome: Solution[Any] | BaseException
            if task.refusal is not None:
                outcome = _refused(task)
            else:
                try:
                    outcome = _run(worker, task.job, grace)
                except BaseException as error:  # raised again in the waiting thread
                    outcome = error
            with lock:
                left[task.column] -= 1
                if task.refusal is None:
                    busy.discard(worker)
                    if left[task.column] and not stop.is_set():
                        idle.setdefault(task.column, []).append(worker)
                    else:
                        worker.close()
                        for other in idle.pop(task.column, []):
                            other.close()
            results.put((task, outcome))

    def interrupt() -> None:
        interrupted.append(True)
        stop.set()
        with lock:
            for worker in busy:
                worker.interrupt()

    interrupted: list[bool] = []
    threads = [
        threading.Thread(target=work, name="crosstrack-compare", daemon=True) for _ in range(count)
    ]
    running = count
    try:
        for thread in threads:
            thread.start()
        with on_interrupt(interrupt):
            while running:
                received = results.get()
                if received is None:
                    running -= 1
                    continue
                task, outcome = received
                if isinstance(outcome, BaseException):
                    raise outcome
                finished(task, outcome)
    finally:
        stop.set()
        with lock:
            tasks.clear()
            for worker in [*busy, *(w for group in idle.values() for w in group)]:
                worker.close()
    return bool(interrupted)


def _by_pool(tasks: deque[_Task], pool: Executor, grace: float, finished: Finished) -> bool:
    """Run the tasks in an executor whose tasks only launch workers; return whether Ctrl-C ended it."""
    futures: dict[Future[bytes], _Task] = {}
    interrupted: list[float] = []

    def interrupt() -> None:
        interrupted.append(time.monotonic())
        for worker in _launched.copy():
            worker.interrupt()

    with on_interrupt(interrupt):
        for task in tasks:
            if interrupted:
                break
            if task.refusal is not None:
                finished(task, _refused(task))
            else:
                futures[pool.submit(_launch, cloudpickle.dumps((task.job, grace)))] = task
        while futures:
            if interrupted:
                futures = {f: task for f, task in futures.items() if not f.cancel()}
                if time.monotonic() - interrupted[0] > 3 * PATIENCE:
                    break  # it runs elsewhere, where nobody was told
            # Polled, for executors of other libraries do not fit concurrent.futures.wait.
            done = [future for future in futures if future.done()]
            if not done:
                time.sleep(0.02)
            for future in done:
                task = futures.pop(future)
                try:
                    data = cloudpickle.loads(future.result())
                except KeyboardInterrupt:  # Ctrl-C reached the executor's processes as well
                    interrupted.append(time.monotonic())
                except Exception as error:  # the executor lost the task: its row, no other
                    log.error("the executor lost a task", exc_info=error)
                    finished(task, failed(task.job, f"executor: {type(error).__name__}: {error}"))
                else:
                    finished(task, Solution.from_dict(data, task.job.model))
    return bool(interrupted)


def _launch(request: bytes) -> bytes:
    """Run one job in a fresh worker; executed inside an executor's process or thread."""
    job, grace = cloudpickle.loads(request)
    with Worker() as worker:
        _launched.add(worker)
        try:
            message = cloudpickle.dumps(_run(worker, job, grace).to_dict())
        finally:
            _launched.discard(worker)
    return bytes(message)


#: The workers that an executor's threads in this process have launched.
_launched: set[Worker] = set()
