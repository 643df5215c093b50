"""Several runs of one job from different seeds."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from ..contract.control import Control
from ..contract.enums import Limit
from ..contract.job import Job
from ..contract.solution import Solution
from ..processes.interrupts import on_interrupt

__all__ = ["multistart"]

#: Seconds of a first start whose time is used up before it began.
NO_TIME = 1e-9
#: Seconds of the first start above which the other starts run in processes of their own.
LONG = 1.0


def _starts(job: Job) -> list[Job]:
    """Return one job per start. If the formulation draws starts, the first is its own guess."""
    formulation = job.find_target().formulation
    first = job.seed or 0
    seeds = list(range(first, first + job.starts))
    if formulation is not None and formulation.draws:
        drawn = max(first, 1)
        seeds = [0, *range(drawn, drawn + job.starts - 1)]
    return [replace(job, seed=seed, starts=1) for seed in seeds]


def multistart(
    job: Job,
    run: Callable[..., Solution[Any]],
    control: Control | None = None,
    together: Callable[[list[Job]], list[Solution[Any]]] | None = None,
) -> Solution[Any]:
    """Run the job from several seeds and return the best result with all of them.

    Parameters
    ----------
    job : Job
        The job.
    run : callable
        Function ``(job, control=…) -> Solution`` that runs one start.
    control : Control, optional
        Control that can stop all starts from another thread.
    together : callable, optional
        Function that runs the remaining jobs in parallel. It is used if the first start took long
        enough and no criterion can end the run before the others start.
    """
    jobs = _starts(job)
    begin = time.perf_counter()
    whole = control or Control()
    whole.arm(job.time_limit)
    results: list[Solution[Any]] = []
    try:
        with on_interrupt(partial(whole.stop, Limit.INTERRUPTED)):
            for entry in jobs:
                left = None if job.time_limit is None else job.time_limit - whole.progress.seconds
                if results and left is not None and left <= 0:
                    whole.stop(Limit.TIME)  # the timer's thread may be late
                if results and whole.stopped:
                    break
                if left is not None:
                    left = max(left, NO_TIME)  # the first start reports the lack of time
                pays = len(results) == 1 and results[0].seconds.get("total", 0.0) > LONG
                if together is not None and pays and job.criterion is None:
                    results += together([replace(entry, time_limit=left) for entry in jobs[1:]])
                    if any(result.limit is Limit.INTERRUPTED for result in results):
                        whole.stop(Limit.INTERRUPTED)
                    break
                with whole.stage(left) as part:
                    results.append(run(replace(entry, time_limit=left), control=part))
                if results[-1].limit in (Limit.INTERRUPTED, Limit.TARGET):
                    whole.stop(results[-1].limit)
    finally:
        whole.disarm()
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
    seconds["total"] = time.perf_counter() - begin
    ended = whole.reason if len(results) < job.starts else None
    return replace(
        best,
        starts=tuple(results),
        seconds=seconds,
        options=job.options(),
        limit=ended or best.limit,
    )
