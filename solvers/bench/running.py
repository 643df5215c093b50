"""Run of a campaign: in worker processes or on a cluster, with resumption."""

from __future__ import annotations

import contextlib
import os
import statistics
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import Any, Unpack

from ...errors import BackendMissing, InvalidData, UnsupportedOption
from ...models.fields import required, show
from ..contract.enums import Limit, Termination
from ..contract.events import Event, EventKind, Listener, listener_of
from ..contract.limits import LimitOptions, Limits, limits_of, takes_limits
from ..contract.solution import Solution
from ..processes.scheduling import Task, close_kept
from ..run.crosscheck import checked_pool, run_tasks
from .campaign import Campaign
from .records import Records

__all__ = ["Progress", "bench"]

#: Finished jobs of a backend from which the seconds of the others are estimated.
TOLD = 3


@dataclass
class Progress:
    """Progress of a campaign.

    Parameters
    ----------
    workers : int
        Number of jobs that run in parallel.
    total, recorded : int
        Number of jobs to run, and of jobs already in the record.
    waiting, running : mapping of int to Task
        Jobs that wait and jobs that run, as far as this process knows.
    done, failed : int
        Number of finished jobs, and how many of these failed or were rejected.
    last : Solution, optional
        Latest answer.
    spent : dict of tuple to list of float
        Seconds of finished jobs by backend and kind of model.
    """

    workers: int
    total: int = 0
    recorded: int = 0
    waiting: dict[int, Task] = field(default_factory=dict)
    running: dict[int, Task] = field(default_factory=dict)
    done: int = 0
    failed: int = 0
    last: Solution[Any] | None = None
    spent: dict[tuple[str, str], list[float]] = field(default_factory=dict)

    @property
    def left(self) -> tuple[float | None, bool]:
        """Estimated seconds left, and whether they are a sum of time limits alone.

        Estimates use the median of at least three finished jobs of the same backend on models of the
        same kind, else the time limit. The seconds are None if a waiting job has no time limit.
        """
        usual = {
            kind: statistics.median(times)
            for kind, times in self.spent.items()
            if len(times) >= TOLD
        }
        seconds, only_limits = 0.0, True
        for task in (*self.waiting.values(), *self.running.values()):
            estimate = usual.get(_kind(task))
            if estimate is not None:
                seconds, only_limits = seconds + estimate, False
            elif task.refusal is None:
                if task.job.time_limit is None:
                    return None, True
                seconds += task.job.time_limit
        return seconds / self.workers, only_limits

    def __str__(self) -> str:
        names = ", ".join(f"{t.job.model.name} {_backend(t)}" for t in self.running.values())
        seconds, bound = self.left
        time = ""
        if seconds is not None:
            left = _span(seconds)
            time = f", {left} left at the limits" if bound else f", about {left} left"
        failed = f", {self.failed} failed" if self.failed else ""
        recorded = f", {self.recorded} recorded before" if self.recorded else ""
        return f"{self.done} of {self.total} done{failed}{recorded}{time}: {names}"


def _backend(task: Task) -> str:
    backend = task.job.backend
    return backend if isinstance(backend, str) else backend.name


def _kind(task: Task) -> tuple[str, str]:
    return _backend(task), task.job.model.kind


def _span(seconds: float) -> str:
    """Return a duration as rounded text with its unit."""
    minutes = seconds / 60
    if minutes < 2:
        return f"{seconds:.0f} s"
    return f"{minutes:.0f} min" if minutes < 120 else f"{minutes / 60:.1f} h"


@takes_limits()
def bench(
    campaign: Campaign | str | os.PathLike[str],
    *,
    record: str | os.PathLike[str],
    resume: bool = False,
    retry: bool = False,
    workers: int = 1,
    cluster: str | None = None,
    pool: Executor | None = None,
    limits: Limits | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    **options: Unpack[LimitOptions],
) -> Records:
    """Run a campaign and return its records.

    Every job has a worker process, which is killed if it exceeds its limits. Its answer is appended
    to `record` at once. A job whose process was killed from outside runs once more. The records do
    not depend on the number and place of the workers, except for seconds and for answers that end
    at a time limit.

    Parameters
    ----------
    campaign : Campaign or path-like
        The campaign, or the name of its TOML file.
    record : path-like
        Name of the JSON-lines file that receives every answer.
    resume : bool
        Continue an existing record and run only the missing jobs.
    retry : bool
        With `resume`, also run failed jobs again, for example after installing a licence.
    workers : int
        Number of jobs that run in parallel without a cluster.
    cluster : str, optional
        Address of a Dask scheduler, such as ``"tcp://10.0.0.1:8786"``, whose workers can import this
        package. Requires the extra ``cluster``.
    pool : concurrent.futures.Executor, optional
        Other executor that launches the jobs.
    limits : Limits, optional
        Record whose fields replace those of the campaign, unless they have their defaults.
    on_progress : callable, optional
        Deprecated: use `on_event`.
    time_limit, memory_limit, evaluations, target, gap, tolerance, seed, threads, stop : optional
        Fields of `limits`, which replace those of the campaign. `seed` replaces its list of seeds.
    warm_start, starts, verbose : optional
        As in :func:`crosstrack.compare`.
    on_event : callable, optional
        Function called with an :class:`~crosstrack.solvers.contract.events.Event` when a job starts
        or ends, by one thread at a time. Its `progress` is a :class:`.bench.Progress`.

    Returns
    -------
    Records
        All answers, including recorded ones.

    Raises
    ------
    InvalidData
        The file of the campaign or the record is invalid.
    UnsupportedOption
        The value of an option is not allowed.
    BackendMissing
        The extra ``cluster`` is not installed.
    """
    if isinstance(campaign, str | os.PathLike):
        campaign = Campaign.read(campaign)
    campaign = required("campaign", campaign, Campaign)
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 1:
        raise UnsupportedOption(f"workers must be a whole number >= 1, got {show(workers)}")
    if cluster is not None and (pool is not None or not isinstance(cluster, str)):
        raise UnsupportedOption("cluster must be an address, and excludes pool")
    if retry and not resume:
        raise UnsupportedOption("retry needs resume: without it no failed job is known")
    pool = checked_pool(pool)
    on_event, changes = _changes(limits, options)
    listener = listener_of(on_event, "progress", on_progress=on_progress)
    if changes:
        campaign = replace(campaign, limits=changes)
    tasks = campaign.tasks
    state, turn = Progress(workers), threading.RLock()

    def started(task: Task) -> None:
        with turn:  # called by the threads that run the jobs
            state.waiting.pop(id(task), None)
            state.running[id(task)] = task
            if listener is not None:
                names = task.job.model.name, _backend(task)
                listener(Event(EventKind.STARTED, *names, progress=state))

    def finished(task: Task, solution: Solution[Any]) -> None:
        with turn:
            state.waiting.pop(id(task), None)
            state.running.pop(id(task), None)
            state.spent.setdefault(_kind(task), []).append(solution.seconds.get("total", 0.0))
            state.done += 1
            state.failed += solution.termination in (Termination.FAILED, Termination.REJECTED)
            state.last = solution
            if listener is not None:
                listener(Event.ended(solution, state))

    def begun(waiting: Sequence[Task]) -> None:
        state.waiting = {id(task): task for task in waiting}
        state.recorded, state.total = len(tasks) - len(waiting), len(waiting)

    with ExitStack() as stack:
        client = None
        if cluster is not None:
            client = stack.enter_context(_connected(cluster))
            pool = client.get_executor(pure=False)
            stack.callback(_tidy, client)

        def room() -> int | None:
            """Update and return the number of jobs that run in parallel; None if it is unknown."""
            if client is None:
                count = getattr(pool, "_max_workers", None)
            else:
                count = state.workers
                with contextlib.suppress(Exception):  # a lost scheduler can raise any exception
                    count = sum(client.nthreads().values())
            state.workers = state.workers if count is None else max(count, 1)
            return count

        answers, interrupted = run_tasks(
            tasks, record=record, resume=resume, retry=retry, workers=workers, pool=pool, room=room,
            begun=begun, started=started, finished=finished,
        )  # fmt: skip
    finished_answers = [answers[place] for place in sorted(answers)]
    complete = tuple(s for s in finished_answers if s.limit is not Limit.INTERRUPTED)
    return Records(complete, campaign.title, interrupted)


def _changes(
    limits: Limits | None, options: Mapping[str, Any]
) -> tuple[Listener | None, dict[str, Any]]:
    """Return the callback, and the fields of the limits that the caller sets."""
    joined = limits_of("bench", limits, options)
    changes = {**joined.changes(), **options}
    changes.pop("on_event", None)
    return joined.on_event, changes


def _tidy(client: Any) -> None:
    """Close the idle worker processes on a cluster."""
    with contextlib.suppress(Exception):  # a lost cluster has no processes left
        client.run(close_kept)


def _connected(address: str) -> Any:
    """Return the client of a Dask scheduler, a context manager."""
    try:
        from distributed import Client
    except ImportError:
        raise BackendMissing(
            "a cluster needs the extra 'cluster': pip install 'crosstrack[cluster]'"
        ) from None
    try:
        return Client(address, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError, TimeoutError) as error:
        raise InvalidData(
            f"cluster {address!r} cannot be reached: {error}", field="cluster"
        ) from None
