"""Further starts for a local search that found nothing: they follow by themselves, and it is said."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from .control import Control
from .enums import Limit, Termination
from .job import Job
from .looking import wants_none
from .solution import Solution

__all__ = ["start_again"]

#: Drawn starts at most.
MORE = 4
#: Seconds that they get in all where no limit is given, at least and as a multiple of the first's.
AT_LEAST, TIMES = 60.0, 4.0

_NOTHING = (Termination.NO_SOLUTION, Termination.LOCALLY_INFEASIBLE, Termination.FAILED)


def start_again(
    job: Job, first: Solution[Any], run: Callable[..., Solution[Any]], control: Control
) -> Solution[Any]:
    """Return `first`, or what a drawn start gives where `first` is a failure of the guess.

    Only formulations that draw starts themselves have some, and only who asked for no seed, start or
    warm start of his own gets them. The seed of the start that led somewhere is the solution's.

    Parameters
    ----------
    job : Job
        What was asked.
    first : Solution
        What came of the guess.
    run : callable
        ``(job, control=…) -> Solution``: runs one start.
    control : Control
        Stops the whole.
    """
    formulation = job.target().formulation
    if formulation is None or not formulation.draws or wants_none(job):
        return first
    misled = first.plan is None and first.statistics.get("second look") == "better"
    nothing = misled or first.termination in _NOTHING
    if not nothing or first.limit not in (None, Limit.ITERATIONS):
        return first
    begin, spent = time.perf_counter(), first.seconds.get("total", 0.0)
    whole = max(AT_LEAST, TIMES * spent) if job.time_limit is None else job.time_limit - spent
    tried, found = 1, first
    # A better optimum of a first mesh that came to nothing: seed 0 is the guess itself.
    for seed in range(0 if misled else 1, MORE + 1):
        left = whole - (time.perf_counter() - begin)
        if left <= 0.0 or control.stopped:
            break
        tried += 1
        with control.stage(left) as part:
            # None of them may use up what the others need.
            share = left / (MORE + 1 - seed)
            found = run(replace(job, seed=seed, time_limit=share), control=part)
        if found.plan is not None or found.limit is Limit.INTERRUPTED:
            break
    best = first if found.plan is None else found
    words = f"{tried} starts: from the guess {first.termination}"
    if found.plan is not None:
        words += f", from seed {found.seed} {found.termination}"
    limit = found.limit if found.limit is Limit.INTERRUPTED else best.limit
    message = "; ".join(filter(None, (best.message, words)))
    statistics = {**best.statistics, "starts tried": tried}
    return replace(best, message=message, statistics=statistics, limit=limit)
