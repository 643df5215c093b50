"""Automatic restarts: random starts for a local search that found no plan from its guess."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ..contract.control import Control
from ..contract.enums import Limit, Termination
from ..contract.job import Job
from ..contract.solution import Solution
from .looking import wants_none

__all__ = ["start_again"]

#: Largest number of random starts.
MORE = 4
#: Their total seconds without a time limit: at least, and as a multiple of the first run's.
AT_LEAST, TIMES = 60.0, 4.0

_NOTHING = (Termination.NO_SOLUTION, Termination.LOCALLY_INFEASIBLE, Termination.FAILED)


def start_again(
    job: Job, first: Solution[Any], run: Callable[..., Solution[Any]], control: Control
) -> Solution[Any]:
    """Return `first`, or the result of a random start if the guess led to no plan.

    Only formulations that draw starts are restarted, and only if the job has no seed, no number of
    starts and no warm start. The solution has the seed of the successful start.

    Parameters
    ----------
    job : Job
        The job.
    first : Solution
        Solution from the formulation's own guess.
    run : callable
        Function ``(job, control=…) -> Solution`` that runs one start.
    control : Control
        Control that can stop all starts.
    """
    formulation = job.find_target().formulation
    if formulation is None or not formulation.draws or wants_none(job):
        return first
    misled = first.plan is None and first.statistics.get("second look") == "better"
    failed = misled or first.termination in _NOTHING
    if not failed or first.limit not in (None, Limit.ITERATIONS):
        return first
    begin, spent = time.perf_counter(), first.seconds.get("total", 0.0)
    whole = max(AT_LEAST, TIMES * spent) if job.time_limit is None else job.time_limit - spent
    tried, result = 1, first
    # If the second look misled the first run, seed 0 repeats the guess without it.
    for seed in range(0 if misled else 1, MORE + 1):
        left = whole - (time.perf_counter() - begin)
        if left <= 0.0 or control.stopped:
            break
        tried += 1
        with control.stage(left) as part:
            # Each start gets an equal share of the remaining seconds.
            share = left / (MORE + 1 - seed)
            result = run(replace(job, seed=seed, time_limit=share), control=part)
        if result.plan is not None or result.limit is Limit.INTERRUPTED:
            break
    best = first if result.plan is None else result
    remark = f"{tried} starts: from the guess {first.termination}"
    if result.plan is not None:
        remark += f", from seed {result.seed} {result.termination}"
    limit = result.limit if result.limit is Limit.INTERRUPTED else best.limit
    message = "; ".join(filter(None, (best.message, remark)))
    statistics = {**best.statistics, "starts tried": tried}
    return replace(best, message=message, statistics=statistics, limit=limit)
