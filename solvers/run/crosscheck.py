"""The verb :func:`compare`: several backends on several models, in worker processes, with a verdict."""

from __future__ import annotations

import contextlib
import logging
import os
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from ...errors import CrosstrackError, InvalidData, UnknownName, UnsupportedOption
from ...models.conversion import as_model
from ...models.fields import show
from ...models.model import Model
from ...models.records import Table, given
from ...models.verification import check_number
from ..contract.backend import Backend, Feature, Limit
from ..contract.events import Event, listener_of
from ..contract.job import Job
from ..contract.limits import LimitOptions, Limits, limits_of, takes_limits
from ..contract.registry import find_backend
from ..contract.selection import recommended
from ..contract.solution import Solution
from ..contract.verdict import Outcome, Verdict, judge, worst_outcome
from ..processes.output import shown
from ..processes.scheduling import Task, failed, run_by_pool, run_by_threads
from ..report.tables import Printable, frame
from .execution import GRACE
from .recording import Record

if TYPE_CHECKING:
    from pandas import DataFrame

__all__ = ["Comparison", "compare", "rejudged", "run_tasks", "task_of"]

log = logging.getLogger("crosstrack")


@dataclass(frozen=True)
class Comparison(Printable):
    """Result of :func:`compare`: one verdict per model. Printing it shows tables.

    Parameters
    ----------
    verdicts : tuple of Verdict
        One per model, in the order of the models.
    interrupted : bool
        Whether Ctrl-C ended the comparison. Finished answers are included.
    """

    verdicts: tuple[Verdict, ...]
    interrupted: bool = False

    @property
    def outcome(self) -> Outcome:
        """Worst outcome of all verdicts, so a single contradiction decides."""
        return worst_outcome(self.verdicts, self.interrupted)

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
        """Return the printable parts: every verdict with its table, then the outcome of all."""
        parts = [part for verdict in self.verdicts for part in verdict.parts()]
        if len(self.verdicts) > 1:
            parts.append(f"\nall {len(self.verdicts)} instances: {self.outcome}")
        if self.interrupted:
            parts.append("interrupted: missing answers were not run")
        return parts

    def to_frame(self) -> DataFrame:
        """Return the answers as a pandas data frame with one row per answer. Requires pandas."""
        return frame(self.solutions)


@takes_limits(time_limit=60.0)
def compare(
    models: Sequence[Model[Any]] | Model[Any],
    backends: Sequence[str | Backend],
    *,
    formulation: str | None = None,
    formulation_options: Mapping[str, Any] | None = None,
    backend_options: Mapping[str, Mapping[str, Any]] | None = None,
    grace: float = GRACE,
    repeats: int = 1,
    compiled: bool = False,
    workers: int = 1,
    pool: Executor | None = None,
    record: str | Path | None = None,
    resume: bool = False,
    limits: Limits | None = None,
    on_solution: Callable[[Solution[Any]], None] | None = None,
    **options: Unpack[LimitOptions],
) -> Comparison:
    """Solve every model with every backend, each in a process of its own, and judge the answers.

    A backend that crashes, exceeds its deadline or rejects a model affects its own row only.

    Parameters
    ----------
    models : sequence of Model
        The models to solve.
    backends : sequence of str or Backend
        Names, or backend objects. ``"name:formulation"`` selects a formulation, and ``"auto"`` the
        backend that :func:`crosstrack.solve` would use.
    formulation, formulation_options : optional
        Default formulation and its options, for backends that solve programs.
    backend_options : mapping of str to mapping, optional
        Options by name of the backend. Defaults are those of the backend's
        ``comparison_options``, for example ``polish=False`` for solvers of quadratic programs.
    grace : float
        Seconds after the time limit before the worker is killed with its process group.
    repeats : int
        Number of runs of each randomised backend on each model, with seeds ``seed``, ``seed + 1``
        …; the verdicts then contain medians, quartiles and success rates.
    compiled : bool
        Compile all loops of the native algorithms, instead of interpreting short ones, so that
        the seconds of runs are comparable.
    workers : int
        Number of jobs that run at the same time.
    pool : concurrent.futures.Executor, optional
        Executor that launches the workers, for example Dask's. Default: threads of this process.
    record : str or Path, optional
        Name of a JSONL file to which each answer is appended when its job ends.
    resume : bool
        Continue an existing record and run only the missing jobs.
    limits : Limits, optional
        Limits of each job as a whole, see :class:`~crosstrack.solvers.contract.limits.Limits`.
    on_solution : callable, optional
        Deprecated: use `on_event`.
    time_limit : float, optional
        Seconds per job (default 60), including the time to build the program. Compilation is excluded,
        because only the first run of a backend compiles; :attr:`Solution.seconds` reports it
        separately.
    memory_limit, tolerance, verbose : optional
        Fields of `limits`, the same for all backends.
    gap, seed, threads, evaluations, target, stop, starts : optional
        Fields of `limits`, passed to the backends that support them.
    warm_start : plan, Solution or sequence of them, optional
        One for all models, or one per model (None for no warm start). Passed to the backends that
        support it.
    on_event : callable, optional
        Function called with each :class:`~crosstrack.solvers.contract.events.Event`: the end of each
        job with its solution, in the order of completion.

    Returns
    -------
    Comparison
        One verdict per model: ``AGREED``, ``INCONCLUSIVE`` or ``CONTRADICTION``.

    Raises
    ------
    UnknownName, UnsupportedOption, InvalidData
        A name or an option is invalid for every row. An error of one backend alone becomes a row.
    """
    models = [as_model(model) for model in _listed("models", models)]
    backends = _listed("backends", backends)
    if not models or not backends:
        raise InvalidData("compare needs at least one model and one backend")
    for name, value in (("workers", workers), ("repeats", repeats)):
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise UnsupportedOption(f"{name} must be a whole number >= 1, got {show(value)}")
    check_number("grace", grace)
    pool = checked_pool(pool)
    if resume and record is None:
        raise UnsupportedOption("resume needs a record to continue")
    limits = limits_of("compare", limits, options, time_limit=60.0)
    listener = listener_of(limits.on_event, "solution", on_solution=on_solution)
    native_options = {
        name: Table().coerce(f"backend_options[{name!r}]", entries, {})
        for name, entries in given("backend_options", backend_options).items()
    }
    warm = _warm_starts(limits.warm_start, models)
    limits = replace(limits, on_event=None, warm_start=None)
    shared = {
        "formulation_options": given("formulation_options", formulation_options),
        "compiled": compiled,
    }
    known = {_name_of(backend) for backend in backends}
    for name in native_options:
        if name not in known:
            raise UnknownName("backend in backend_options", name, known)
    tasks = []
    for row, model in enumerate(models):
        row_limits = replace(limits, warm_start=warm[row])
        for column, entry in enumerate(backends):
            # Looked up among the backends that accept this model: problems may share names.
            backend, formulation_name = _named(entry, formulation, model)
            draws = Feature.SEED in backend.features
            for turn in range(repeats if draws else 1):
                turn_limits = row_limits
                if draws and repeats > 1:
                    turn_limits = replace(row_limits, seed=(limits.seed or 0) + turn)
                tasks.append(
                    task_of(
                        (row, column, turn), model, backend, formulation_name, turn_limits,
                        native_options.get(_name_of(entry), {}), **shared,
                    )
                )  # fmt: skip

    def finished(task: Task, solution: Solution[Any]) -> None:
        if listener is not None:
            listener(Event.ended(solution))

    answers, interrupted = run_tasks(
        tasks,
        record=record,
        resume=resume,
        workers=workers,
        pool=pool,
        grace=grace,
        finished=finished,
    )
    verdicts = []
    for row, model in enumerate(models):
        found_here = [answers[place] for place in sorted(answers) if place[0] == row]
        if found_here or not interrupted:
            verdicts.append(judge(model.name or model.digest[:12], found_here, model))
    return Comparison(tuple(verdicts), interrupted)


def checked_pool(pool: Any) -> Executor | None:
    """Return `pool` if it is an executor or None; raise :class:`UnsupportedOption` otherwise."""
    if pool is not None and not isinstance(pool, Executor):
        raise UnsupportedOption(
            f"pool must be a concurrent.futures.Executor, got {type(pool).__name__}"
        )
    return pool


def run_tasks(
    tasks: Sequence[Task],
    *,
    record: str | os.PathLike[str] | None = None,
    resume: bool = False,
    retry: bool = False,
    workers: int = 1,
    pool: Executor | None = None,
    room: Callable[[], int | None] | None = None,
    grace: float = GRACE,
    begun: Callable[[Sequence[Task]], None] | None = None,
    started: Callable[[Task], None] | None = None,
    finished: Callable[[Task, Solution[Any]], None],
) -> tuple[dict[tuple[int, int, int], Solution[Any]], bool]:
    """Run tasks and return their answers.

    Parameters
    ----------
    tasks : sequence of Task
        The tasks.
    record, resume, workers, pool, grace : optional
        As in :func:`compare`. Recorded tasks are not run again. New answers are recorded at once,
        except tasks that a pool lost, which can be run again.
    retry : bool
        Whether recorded failures are run again.
    room : callable, optional
        As in :func:`run_by_pool`.
    begun : callable, optional
        Function called once with the tasks that will run.
    started : callable, optional
        Function called with each task before it starts.
    finished : callable
        Function called with each task and its solution.

    Returns
    -------
    answers : dict of tuple to Solution
        Solutions by (row, column, turn).
    interrupted : bool
        Whether Ctrl-C ended the run.
    """
    answers: dict[tuple[int, int, int], Solution[Any]] = {}
    with contextlib.ExitStack() as stack:
        stack.enter_context(shown(any(task.job.verbose for task in tasks)))
        book = None
        if record is not None:
            book = stack.enter_context(Record(record, resume=resume, retry=retry))
        open_tasks: deque[Task] = deque()
        for task in tasks:
            recorded = book.find(task.job, task.job.model) if book is not None else None
            if recorded is None:
                open_tasks.append(task)
            else:
                answers[task.row, task.column, task.turn] = recorded

        if begun is not None:
            begun(tuple(open_tasks))

        def ended(task: Task, solution: Solution[Any]) -> None:
            if book is not None and solution.limit is not Limit.INTERRUPTED and not task.lost:
                try:
                    book.add(task.job, solution)
                except CrosstrackError:
                    raise
                except (TypeError, ValueError, RecursionError) as error:
                    # An answer of an external backend affects its own row only.
                    solution = failed(task.job, f"its answer cannot be written as JSON: {error}")
                    book.add(task.job, solution)
            answers[task.row, task.column, task.turn] = solution
            finished(task, solution)

        if pool is not None:
            interrupted = run_by_pool(open_tasks, pool, grace, ended, started, room)
        else:
            count = min(workers, max(len(open_tasks), 1))
            interrupted = run_by_threads(open_tasks, count, grace, ended, started)
    return answers, interrupted


def rejudged(model: Model[Any], *parts: Comparison) -> Comparison:
    """Return a comparison on `model` that judges the answers of several comparisons together.

    Parameters
    ----------
    model : Model
        The model that all answers belong to.
    *parts : Comparison
        Comparisons, each on `model`.
    """
    solutions = [solution for part in parts for solution in part.solutions]
    verdict = judge(model.name or model.digest[:12], solutions, model)
    return Comparison((verdict,), any(part.interrupted for part in parts))


def _listed(name: str, value: Any) -> list[Any]:
    """Return a sequence of models or backends, or a single one, as a list."""
    if not isinstance(value, Iterable) or isinstance(value, str):
        return [value]
    try:
        return list(value)
    except TypeError:  # for example an array without axes
        raise InvalidData(f"{name} must be a list, got {show(value)}", field=name) from None


def _name_of(backend: str | Backend) -> str:
    """Return the name of a backend without its formulation."""
    return backend.partition(":")[0] if isinstance(backend, str) else find_backend(backend).name


def _named(
    backend: str | Backend, formulation: str | None, model: Model[Any]
) -> tuple[Backend, str | None]:
    """Return the backend and the name of the formulation that ``"name:formulation"`` selects."""
    if isinstance(backend, str) and ":" in backend:
        backend, _, formulation = backend.partition(":")
    if isinstance(backend, str) and backend == "auto":
        return recommended(model, formulation), formulation
    return find_backend(backend, model), formulation


def _warm_starts(value: Any, models: Sequence[Model[Any]]) -> list[Any]:
    """Return one plan per model, from one for all models or a sequence with one per model."""
    many = isinstance(value, list | tuple) and not all(isinstance(k, int) for k in value)
    values = list(value) if many else [value] * len(models)
    if len(values) != len(models):
        raise InvalidData(
            f"warm_start has {len(values)} entries for {len(models)} models", field="warm_start"
        )
    pairs = zip(models, values, strict=True)
    return [None if value is None else model.as_plan(value) for model, value in pairs]


def task_of(
    place: tuple[int, int, int],
    model: Model[Any],
    backend: Backend,
    formulation: str | None,
    limits: Limits,
    backend_options: Mapping[str, Any],
    **others: Any,
) -> Task:
    """Return a task with the limits that the backend supports.

    Parameters
    ----------
    place : tuple of int
        Row, column and turn.
    model : Model
        The model to solve.
    backend : Backend
        The backend to run.
    formulation : str, optional
        Name of the formulation, ignored if the backend accepts the model itself.
    limits : Limits
        Limits that all tasks share. Those that the backend does not support are left out.
    backend_options : mapping
        Options of the backend.
    **others
        Further fields of :class:`Job`.

    Raises
    ------
    UnknownName, UnsupportedOption
        The formulation or an option of the backend does not exist.
    """
    native = isinstance(model, backend.accepts)
    if native:
        others["formulation_options"] = {}
    job = Job(
        model,
        backend,
        None if native else formulation,
        backend_options=dict(backend_options),
        **{**limits.fields(), **backend.unsupported(limits)},
        **others,
    )
    backend.checked_options(job.backend_options)
    try:
        target = job.find_target()
        options = {**backend.comparison_options(target.kind), **job.backend_options}
        job = replace(job, backend_options=options)
    except CrosstrackError as error:
        if isinstance(error, UnknownName):
            raise
        return Task(*place, job, error)
    return Task(*place, job)
