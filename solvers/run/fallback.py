"""Other backends of ``"auto"``: a heuristic before a local solver, exact backends after a failure."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import islice
from typing import Any

from ...errors import BackendMissing, UnsupportedFormulation, UnsupportedOption
from ..contract.backend import Backend, Guarantee
from ..contract.enums import Limit, Termination
from ..contract.job import Job
from ..contract.selection import guaranteed
from ..contract.solution import Solution
from .certification import SHAPE, UNCERTIFIED

__all__ = ["begin", "better", "go_on", "run_automatic"]

#: Share of the time limit beyond which no other backend starts.
LATE = 0.9
#: Backends that are tried after the recommended one.
MORE = 3
#: Their total seconds without a time limit: at least, and as a multiple of the first run's.
AT_LEAST, TIMES = 60.0, 10.0

#: Share of the time limit for the heuristic before a local solver of programs. Steering laws of a slew take
#: 0.3 to 2 s, and the program 4 to 13 s: below `SHORT` seconds the heuristic has all the time.
BEFORE, SHORT = 0.5, 4.0

_PROVEN = (Termination.OPTIMAL, Termination.INFEASIBLE, Termination.UNBOUNDED)


def run_automatic(
    job: Job, remaining: Callable[[], Job], run: Callable[[Job], Solution[Any]]
) -> Solution[Any]:
    """Return the best solution of the recommended backend and of those before and after it.

    Parameters
    ----------
    job : Job
        The job with the recommended backend.
    remaining : callable
        Returns the job with the time that is left of its limit.
    run : callable
        Runs a job.
    """
    left = remaining()
    first = begin(left, run)
    if first is not None and job.time_limit is not None and job.time_limit < SHORT:
        tried = f"{first.backend}: {first.termination}"
        return replace(first, statistics={**first.statistics, "backends tried": tried})
    solution = run(remaining())
    if job.has_fallback:
        solution = go_on(left, solution, run)
    return better(job, first, solution)


def begin(job: Job, run: Callable[[Job], Solution[Any]]) -> Solution[Any] | None:
    """Return the plan of a native heuristic if the backend is a local solver of programs; else None.

    Such a solver may have no plan before its last mesh. Without a time limit it needs no other plan, and
    options that the heuristic does not support rule it out. If a short time limit is exhausted, the
    solution has no plan.

    Parameters
    ----------
    job : Job
        The job with the recommended backend.
    run : callable
        Runs a job.
    """
    assert isinstance(job.backend, Backend)
    local = job.backend.guarantee is Guarantee.LOCAL
    own = job.backend_options or job.formulation is not None or job.warm_start is not None
    if job.time_limit is None or not local or own or isinstance(job.model, job.backend.accepts):
        return None
    for backend in guaranteed(job.model, Guarantee.HEURISTIC):
        if not isinstance(job.model, backend.accepts):
            continue
        is_short = job.time_limit < SHORT
        share = job.time_limit * (1.0 if is_short else BEFORE)
        try:
            result = run(replace(job, backend=backend, time_limit=share))
        except (BackendMissing, UnsupportedOption):
            continue
        late = is_short and not _leaves_time(job, result.seconds.get("total", 0.0))
        return result if late or result.plan is not None else None
    return None


def better(job: Job, first: Solution[Any] | None, last: Solution[Any]) -> Solution[Any]:
    """Return the better of two solutions; `first` is the one of :func:`begin`."""
    if first is None or first.primal_bound is None:
        return last
    if last.primal_bound is not None and last.primal_bound <= first.primal_bound:
        return last
    tried = f"{first.backend}: {first.termination}, {last.backend}: {last.termination}"
    return replace(
        first,
        limit=last.limit,
        options=job.options(),
        statistics={**first.statistics, "backends tried": tried},
    )


def go_on(job: Job, first: Solution[Any], run: Callable[[Job], Solution[Any]]) -> Solution[Any]:
    """Return `first`, or a better answer of another exact backend if `first` is a failure.

    A failure is an end without proof that is not explained by a limit other than the iterations, if
    the backend is not conclusive. An end without a plan before the time limit, because kernels were
    interpreted, is a failure, too. Other backends run in turn for the rest of the time until one
    proves its answer. Otherwise the plan with the smallest gap is kept. Backends that do not support
    an option of the job are skipped.

    Parameters
    ----------
    job : Job
        The job, with the recommended backend.
    first : Solution
        Its solution.
    run : callable
        Function that runs a job.
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
    others: Iterable[Backend] = guaranteed(job.model, Guarantee.EXACT, job.formulation)
    if late:  # native backends would interpret the same kernels
        others = (other for other in others if not isinstance(job.model, other.accepts))
    others = (entry for entry in others if entry.name != job.backend.name)
    for backend in islice(others, MORE):
        left = whole - (time.perf_counter() - begin)
        if left <= 0:
            break
        other = replace(job, backend=backend, time_limit=left, has_fallback=False)
        try:
            result = run(other)
        except (BackendMissing, UnsupportedOption, UnsupportedFormulation):
            continue  # it cannot do what was asked of the first
        tried.append(f"{result.backend}: {result.termination}")
        # A verified plan refutes every claim of infeasibility.
        proven = result.termination in _PROVEN and (result.plan is not None or best.plan is None)
        if proven or _rank(result) < _rank(best):
            best = result
        if proven or result.limit is Limit.INTERRUPTED:
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
