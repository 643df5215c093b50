"""Running a campaign: in one process or several, on a cluster, and on from where it stopped."""

from __future__ import annotations

import contextlib
import os
import statistics
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

from ...errors import BackendMissing, InvalidData, UnsupportedOption
from ...models.fields import required, show
from ..crosscheck import checked_pool, run_tasks
from ..enums import Limit, Termination
from ..scheduling import Task, close_kept
from ..solution import Solution
from .campaign import Campaign
from .records import Records

__all__ = ["Progress", "bench"]

#: Jobs of a backend whose seconds say what its others will take.
TOLD = 3


@dataclass
class Progress:
    """How far a campaign is.

    Parameters
    ----------
    workers : int
        Jobs that run at the same time.
    total, recorded : int
        Jobs that the record lacks, and jobs that it holds.
    waiting, running : mapping of int to Task
        What has not begun, and what runs, as far as this process knows.
    done, failed : int
        What has ended, and how much of that failed or was rejected.
    last : Solution, optional
        The answer that came last.
    """

    workers: int
    total: int = 0
    recorded: int = 0
    waiting: dict[int, Task] = field(default_factory=dict)
    running: dict[int, Task] = field(default_factory=dict)
    done: int = 0
    failed: int = 0
    last: Solution[Any] | None = None
    #: Seconds of what has ended, by backend and kind of model.
    spent: dict[tuple[str, str], list[float]] = field(default_factory=dict)

    @property
    def left(self) -> tuple[float | None, bool]:
        """Seconds left, None where nothing limits them, and whether they are a sum of limits alone.

        A job is taken to last as long as the median of those of its backend on models of its kind,
        where three of them have ended, and else as long as it may.
        """
        usual = {
            kind: statistics.median(told) for kind, told in self.spent.items() if len(told) >= TOLD
        }
        seconds, bound = 0.0, True
        for task in (*self.waiting.values(), *self.running.values()):
            told = usual.get(_kind(task))
            if told is not None:
                seconds, bound = seconds + told, False
            elif task.refusal is None:
                if task.job.time_limit is None:
                    return None, True
                seconds += task.job.time_limit
        return seconds / self.workers, bound

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
    """Return a length of time in words, rounded up to what matters."""
    minutes = seconds / 60
    if minutes < 2:
        return f"{seconds:.0f} s"
    return f"{minutes:.0f} min" if minutes < 120 else f"{minutes / 60:.1f} h"


def bench(
    campaign: Campaign | str | os.PathLike[str],
    *,
    record: str | os.PathLike[str],
    resume: bool = False,
    retry: bool = False,
    workers: int = 1,
    cluster: str | None = None,
    pool: Executor | None = None,
    on_progress: Callable[[Progress], None] | None = None,
) -> Records:
    """Run a campaign and return its records.

    Every job has a process of its own, which is killed when it passes its limits. Its answer is written
    to `record` at once; a job whose process was killed by somebody else is run once more. The same
    campaign gives the same records on one worker, several, and a cluster, but for seconds and what
    depends on them: what ends at a limit of time.

    Parameters
    ----------
    campaign : Campaign or path-like
        The campaign, or its TOML file.
    record : path-like
        The JSON-lines file that receives every answer.
    resume : bool
        Go on with a record that exists, running only what it lacks.
    retry : bool
        With `resume`, run what failed again as well: a licence or a library may be there now.
    workers : int
        Jobs at the same time, where there is no cluster.
    cluster : str, optional
        Address of a Dask scheduler, such as ``"tcp://10.0.0.1:8786"``, whose workers see this package;
        needs the extra ``cluster``.
    pool : concurrent.futures.Executor, optional
        Any other place that launches the jobs.
    on_progress : callable, optional
        Called with a :class:`Progress` when a job begins or ends, by one thread at a time.

    Raises
    ------
    InvalidData
        The campaign's file, or the record, is not what it should be.
    UnsupportedOption
        An option has a value that is not allowed.
    BackendMissing
        The extra ``cluster`` is not installed.
    """
    if isinstance(campaign, str | os.PathLike):
        campaign = Campaign.read(campaign)
    campaign = required("campaign", campaign, Campaign)
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 1:
        raise UnsupportedOption(f"workers must be a whole number >= 1, got {show(workers)}")
    if cluster is not None and (pool is not None or not isinstance(cluster, str)):
        raise UnsupportedOption("cluster must be an address, and there may be no pool beside it")
    if retry and not resume:
        raise UnsupportedOption("retry needs resume: without it there is nothing that failed")
    pool = checked_pool(pool)
    tasks = campaign.tasks
    news, turn = Progress(workers), threading.RLock()

    def started(task: Task) -> None:
        with turn:  # called by the threads that run the jobs
            news.waiting.pop(id(task), None)
            news.running[id(task)] = task
            if on_progress is not None:
                on_progress(news)

    def finished(task: Task, solution: Solution[Any]) -> None:
        with turn:
            news.waiting.pop(id(task), None)
            news.running.pop(id(task), None)
            news.spent.setdefault(_kind(task), []).append(solution.seconds.get("total", 0.0))
            news.done += 1
            news.failed += solution.termination in (Termination.FAILED, Termination.REJECTED)
            news.last = solution
            if on_progress is not None:
                on_progress(news)

    def begun(waiting: Sequence[Task]) -> None:
        news.waiting = {id(task): task for task in waiting}
        news.recorded, news.total = len(tasks) - len(waiting), len(waiting)

    with ExitStack() as stack:
        client = None
        if cluster is not None:
            client = stack.enter_context(_connected(cluster))
            pool = client.get_executor(pure=False)
            stack.callback(_tidy, client)

        def room() -> int | None:
            """Return how many jobs run at the same time, and note it; None where it is not known."""
            if client is None:
                most = getattr(pool, "_max_workers", None)
            else:
                most = news.workers
                with contextlib.suppress(Exception):  # whatever it says when its scheduler is away
                    most = sum(client.nthreads().values())
            news.workers = news.workers if most is None else max(most, 1)
            return most

        answers, interrupted = run_tasks(
            tasks, record=record, resume=resume, retry=retry, workers=workers, pool=pool, room=room,
            begun=begun, started=started, finished=finished,
        )  # fmt: skip
    found = [answers[place] for place in sorted(answers)]
    kept = tuple(one for one in found if one.limit is not Limit.INTERRUPTED)
    return Records(kept, campaign.title, interrupted)


def _tidy(client: Any) -> None:
    """Close the processes that wait on a cluster for a next job."""
    with contextlib.suppress(Exception):  # a cluster that is away takes them with it
        client.run(close_kept)


def _connected(address: str) -> Any:
    """Return the client of a Dask scheduler, a context."""
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
