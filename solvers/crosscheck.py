"""The verb :func:`compare`: several backends on several models, one process each, and a verdict."""

from __future__ import annotations

import contextlib
import logging
import os
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import CrosstrackError, InvalidData, UnknownName, UnsupportedOption
from ..models.fields import show
from ..models.model import Model, as_model
from ..models.records import Table, given
from ..models.verification import check_number
from .backend import Backend, Feature, Limit
from .campaign import Record
from .execution import GRACE
from .job import Job
from .registry import find_backend, recommended
from .report.tables import frame, markup, render
from .scheduling import Task, failed, run_by_pool, run_by_threads
from .solution import Solution
from .verdict import Outcome, Verdict, judge

if TYPE_CHECKING:
    from pandas import DataFrame

__all__ = ["Comparison", "compare", "rejudged", "run_tasks", "task_of"]

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


def compare(
    models: Sequence[Model[Any]] | Model[Any],
    backends: Sequence[str | Backend],
    *,
    formulation: str | None = None,
    formulation_options: Mapping[str, Any] | None = None,
    time_limit: float | None = 60.0,
    memory_limit: float | None = None,
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
        Seconds for each job, with the building of the program. Compiling is not counted: only the
        first run of a backend has it, and :attr:`Solution.seconds` reports it apart.
    memory_limit : float, optional
        MiB that the processes of a job may hold in memory, at least 64; Linux only.
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
    pool = checked_pool(pool)
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
        "memory_limit": memory_limit,
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
                    task_of(
                        (row, column, turn), model, backend, wanted, common, warm[row],
                        own.get(_name_of(asked), {}),
                    )
                )  # fmt: skip
            common["seed"] = seed

    def finished(task: Task, solution: Solution[Any]) -> None:
        if on_solution is not None:
            on_solution(solution)

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
    """Return what launches jobs, or None; anything but an executor raises."""
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
    """Return the answers by row, column and turn, and whether Ctrl-C ended the run.

    What a record holds is not run again, but for what failed where `retry` asks for it; what is run is written to it at once, but for what a pool lost,
    which can be run again. `begun` is called with what will be run, `started` with what is about to,
    `finished` with what was; `room` is that of :func:`run_by_pool`, and the other parameters are those of
    :func:`compare`.
    """
    answers: dict[tuple[int, int, int], Solution[Any]] = {}
    with contextlib.ExitStack() as stack:
        book = None
        if record is not None:
            book = stack.enter_context(Record(record, resume=resume, retry=retry))
        open_tasks: deque[Task] = deque()
        for task in tasks:
            found = book.find(task.job, task.job.model) if book is not None else None
            if found is None:
                open_tasks.append(task)
            else:
                answers[task.row, task.column, task.turn] = found

        if begun is not None:
            begun(tuple(open_tasks))

        def ended(task: Task, solution: Solution[Any]) -> None:
            if book is not None and solution.limit is not Limit.INTERRUPTED and not task.lost:
                try:
                    book.add(task.job, solution)
                except CrosstrackError:
                    raise
                except (TypeError, ValueError, RecursionError) as error:
                    # What a stranger's answer holds costs its own row.
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
    if isinstance(backend, str) and backend == "auto":
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


def task_of(
    place: tuple[int, int, int],
    model: Model[Any],
    backend: Backend,
    formulation: str | None,
    common: Mapping[str, Any],
    warm_start: Any,
    own: Mapping[str, Any],
) -> Task:
    """Return a task with those common options that the backend knows."""
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
        return Task(*place, job, error)
    return Task(*place, job)
