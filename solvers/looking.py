"""A second look: the first program of a local search is solved from a drawn start as well."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..jit import clock
from .backend import Answer, Request
from .enums import Limit, Termination
from .running import Run

__all__ = ["SECOND", "look_again", "wants_none"]

#: Key of the statistics: "better", "no better", "stopped" by its limit, or "skipped" for lack of time.
SECOND = "second look"

#: The seed of the second start.
SEED = 1
#: Share of the objective by which the second optimum must be better: a first mesh tells no more.
BETTER = 1e-3
#: Iterations that the second search may take, in terms of the first and beside them. They decide, so
#: that the same call gives the same plan; seconds are for what hangs.
ITERATIONS, MORE = 3, 50
#: Seconds at least and in terms of the first; a time limit must leave this many times the first's.
AT_LEAST, TIMES, ROOM = 10.0, 20.0, 8.0


def wants_none(job: Any) -> bool:
    """Return whether the caller decides himself where searches start."""
    return job.seed is not None or job.starts > 1 or job.warm_start is not None


def look_again(
    run: Run, problem: Any, request: Request, answer: Answer, left: float | None
) -> tuple[Answer, Any]:
    """Return answer and program of a drawn start where these are clearly better, else as they are.

    Parameters
    ----------
    run : Run
        The run, whose formulation draws starts; it goes on with the better one.
    problem : Program
        The formulation's first program.
    request : Request
        What was asked of it.
    answer : Answer
        What came of the guess.
    left : float, optional
        Seconds left.
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
        most = ITERATIONS * int(answer.statistics.get("iterations", 0)) + MORE
        options["max_iter"] = min(options["max_iter"], most)
    seconds = max(AT_LEAST, TIMES * run.spent[-1])
    seconds = seconds if left is None else min(seconds, 0.5 * left)
    other = formulation.started(SEED)
    with request.control.stage(seconds) as part:  # whose end is not the run's
        asked = replace(request, time_limit=seconds, control=part, options=options)
        found = run.attend(other.program, asked)
    outcome = "no better"
    if found.limit is Limit.TIME:
        outcome = "stopped"
        run.notes.append(
            f"a second, drawn start was stopped after {clock() - begin:.2g} s; "
            "a larger time_limit may lead to a better optimum"
        )
    answer = replace(answer, statistics={**answer.statistics, SECOND: outcome})
    best = found.primal_bound is not None and found.primal_bound < value - BETTER * abs(value)
    run.spent[-1] += clock() - begin
    if not best or found.termination is not Termination.LOCALLY_OPTIMAL:
        return answer, problem
    run.target = replace(run.target, formulation=other)
    run.notes.append("a second, drawn start led to a better optimum than the guess")
    return replace(found, statistics={**found.statistics, SECOND: "better"}), other.program
