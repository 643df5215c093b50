"""Starts of a local search beyond its guess: a second look at the first program, and random restarts."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ...timing import clock
from ..contract.backend import Answer, Request
from ..contract.control import Control
from ..contract.enums import Limit, Termination
from ..contract.job import Job
from ..contract.solution import Solution
from .running import Run

__all__ = ["AT_LEAST", "SECOND", "TIMES", "look_again", "start_again", "wants_none"]

#: Key of the statistics: "better", "no better", "stopped" by its limit, or "skipped" to save time.
SECOND = "second look"

#: The seed of the second start.
SEED = 1
#: Relative decrease of the objective required of the second optimum. A first mesh does not resolve
#: smaller differences.
BETTER = 1e-3
#: Iteration limit of the second search: a multiple of the first search's plus a constant. It is the
#: effective limit, so that the same call gives the same plan; seconds only stop a search that hangs.
ITERATIONS, MORE = 3, 50
#: Seconds of the second search: at least, as a multiple of the first, and the multiple of the first
#: that a time limit must leave.
AT_LEAST, TIMES, ROOM = 10.0, 20.0, 8.0
#: Largest number of random restarts.
RESTARTS = 4
#: Their total seconds without a time limit: at least, and as a multiple of the first run's.
RESTARTS_AT_LEAST, RESTARTS_TIMES = 60.0, 4.0

_NOTHING = (Termination.NO_SOLUTION, Termination.LOCALLY_INFEASIBLE, Termination.FAILED)


def wants_none(job: Job) -> bool:
    """Return True if the caller controls the starts: by a seed, several starts or a warm start."""
    return job.seed is not None or job.starts > 1 or job.warm_start is not None


def look_again(
    run: Run, problem: Any, request: Request, answer: Answer, left: float | None
) -> tuple[Answer, Any]:
    """Return the answer and program of a random start if it is clearly better, else the given ones.

    Parameters
    ----------
    run : Run
        The run, whose formulation draws starts. It continues with the better formulation.
    problem : Program
        First program of the formulation.
    request : Request
        Request of that program.
    answer : Answer
        Answer for the formulation's own guess.
    left : float, optional
        Seconds left; None for no limit.

    Returns
    -------
    Answer, Program
        The better answer and its program.
    """
    formulation = run.target.formulation
    if formulation is None or not formulation.draws or wants_none(run.job):
        return answer, problem
    value = answer.primal_bound
    if answer.termination is not Termination.LOCALLY_OPTIMAL or value is None:
        return answer, problem
    if request.control.stopped or (left is not None and left < ROOM * run.spent[-1]):
        run.notes.append(
            "a second, drawn start was skipped: the first program took "
            f"{run.spent[-1]:.2g} s and {max(left or 0.0, 0.0):.2g} s were left; "
            "a larger time_limit may lead to a better optimum"
        )
        return replace(answer, statistics={**answer.statistics, SECOND: "skipped"}), problem
    begin, options = clock(), dict(request.options)
    if "max_iter" in options:
        limit = ITERATIONS * int(answer.statistics.get("iterations", 0)) + MORE
        options["max_iter"] = min(options["max_iter"], limit)
    seconds = max(AT_LEAST, TIMES * run.spent[-1])
    seconds = seconds if left is None else min(seconds, 0.5 * left)
    other = formulation.started(SEED)
    with request.control.stage(seconds) as part:  # its end does not end the run
        stage_request = replace(request, time_limit=seconds, control=part, options=options)
        second = run.attend(other.program, stage_request)
    outcome = "no better"
    if second.limit is Limit.TIME:
        outcome = "stopped"
        run.notes.append(
            f"a second, drawn start was stopped after {clock() - begin:.2g} s; "
            "a larger time_limit may lead to a better optimum"
        )
    answer = replace(answer, statistics={**answer.statistics, SECOND: outcome})
    is_better = second.primal_bound is not None and second.primal_bound < value - BETTER * abs(
        value
    )
    run.spent[-1] += clock() - begin
    if not is_better or second.termination is not Termination.LOCALLY_OPTIMAL:
        return answer, problem
    run.target = replace(run.target, formulation=other)
    run.notes.append("a second, drawn start led to a better optimum than the guess")
    return replace(second, statistics={**second.statistics, SECOND: "better"}), other.program


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
    misled = first.plan is None and first.statistics.get(SECOND) == "better"
    failed = misled or first.termination in _NOTHING
    if not failed or first.limit not in (None, Limit.ITERATIONS):
        return first
    begin, spent = time.perf_counter(), first.seconds.get("total", 0.0)
    whole = (
        max(RESTARTS_AT_LEAST, RESTARTS_TIMES * spent)
        if job.time_limit is None
        else job.time_limit - spent
    )
    tried, result = 1, first
    # If the second look misled the first run, seed 0 repeats the guess without it.
    for seed in range(0 if misled else 1, RESTARTS + 1):
        left = whole - (time.perf_counter() - begin)
        if left <= 0.0 or control.stopped:
            break
        tried += 1
        with control.stage(left) as part:
            # Each start gets an equal share of the remaining seconds.
            share = left / (RESTARTS + 1 - seed)
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
