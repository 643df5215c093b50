"""What ``"auto"`` does where the recommended backend fails: it goes on with the next exact one."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import islice
from typing import Any

from ..errors import BackendMissing, UnsupportedFormulation, UnsupportedOption
from .backend import Backend, Guarantee
from .certification import SHAPE, UNCERTIFIED
from .enums import Limit, Termination
from .job import Job
from .registry import exact
from .solution import Solution

__all__ = ["go_on"]

#: Share of the time limit beyond which no other backend starts.
LATE = 0.9
#: Backends that are tried after the recommended one.
MORE = 3
#: Seconds that they get in all where no limit is given, at least and as a multiple of the first's.
AT_LEAST, TIMES = 60.0, 10.0

_PROVEN = (Termination.OPTIMAL, Termination.INFEASIBLE, Termination.UNBOUNDED)


def go_on(job: Job, first: Solution[Any], run: Callable[[Job], Solution[Any]]) -> Solution[Any]:
    """Return `first`, or a better answer of another exact backend where `first` is a failure.

    A failure is an end without proof that no limit but the iterations explains, of a backend that is
    not conclusive; or an end without a plan before the time limit, because kernels had to be
    interpreted. Others run one after the other on the rest of the clock until one proves its
    answer. If none does, the plan with the least gap is kept. Options that another backend does not
    support rule it out.

    Parameters
    ----------
    job : Job
        What was asked, with the recommended backend.
    first : Solution
        How that one ended.
    run : callable
        Runs a job.
    """
    assert isinstance(job.backend, Backend)
    begin, spent = time.perf_counter(), first.seconds.get("total", 0.0)
    late = first.limit is Limit.TIME and first.plan is None and _leaves_time(job, spent)
    failed = first.limit in (None, Limit.ITERATIONS) and not job.backend.conclusive
    # Another backend's plan would be compared with the one that is not certified.
    failed = failed and first.statistics.get(SHAPE) != UNCERTIFIED
    if (
        first.termination in _PROVEN
        or not (late or failed)
        or job.backend.guarantee is not Guarantee.EXACT
        or job.backend_options
    ):
        return first
    whole = max(AT_LEAST, TIMES * spent) if job.time_limit is None else job.time_limit - spent
    best, tried = first, [f"{first.backend}: {first.termination}"]
    others: Iterable[Backend] = exact(job.model, job.formulation)
    if late:  # native backends would interpret the same kernels
        others = (other for other in others if not isinstance(job.model, other.accepts))
    others = (one for one in others if one.name != job.backend.name)
    for backend in islice(others, MORE):
        left = whole - (time.perf_counter() - begin)
        if left <= 0:
            break
        other = replace(job, backend=backend, time_limit=left, has_fallback=False)
        try:
            found = run(other)
        except (BackendMissing, UnsupportedOption, UnsupportedFormulation):
            continue  # it cannot do what was asked of the first
        tried.append(f"{found.backend}: {found.termination}")
        # A verified plan refutes every claim that there is none.
        proven = found.termination in _PROVEN and (found.plan is not None or best.plan is None)
        if proven or _rank(found) < _rank(best):
            best = found
        if proven or found.limit is Limit.INTERRUPTED:
            break
    if len(tried) == 1:
        return first
    return replace(
        best,
        options=job.options(),
        statistics={**best.statistics, "backends tried": ", ".join(tried)},
    )


def _leaves_time(job: Job, spent: float) -> bool:
    """Return whether the run ended clearly before its time limit."""
    return job.time_limit is not None and spent < LATE * job.time_limit


def _rank(solution: Solution[Any]) -> tuple[bool, float]:
    gap = solution.gap
    return solution.plan is None, float("inf") if gap is None else gap
