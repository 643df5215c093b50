"""Starts of a local search beyond its guess: a comparison on a coarse program, and random restarts."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ...timing import clock
from ..contract.backend import Answer, Backend, Request
from ..contract.control import Control
from ..contract.enums import Feature, Limit, Termination
from ..contract.job import Job
from ..contract.solution import Solution
from .running import Run

__all__ = ["SECOND", "look_again", "start_again", "wants_none", "with_iterations"]

#: Key of the statistics: "better", "no better", "convex" if one start suffices, "stopped" by the time
#: limit, or "skipped" to save time.
SECOND = "second look"

#: Relative difference between the objectives of two optima. Coarse meshes do not resolve smaller ones.
BETTER = 1e-3
#: Starts on the coarse program: at least, and at most if they end at several optima or the first plan is
#: not reached. Of 16 starts of the F-8 aircraft and the free-flying robot, 3 to 5 reach the best optimum.
LEAST, MOST = 4, 8
#: Number of starts at the optimum of the plan after which worse optima do not require more starts.
AGREEING = 3
#: Iterations of each of these starts, and of all together.
COARSE_ITERATIONS, BUDGET = 200, 1000
#: Optima on the coarse program that are compared on the first one.
LIFTED = 2
#: Iterations of a search that is compared with another: a multiple of those of the other plus a constant.
#: Limits count iterations, because the same call must give the same plan on a busy machine.
ITERATIONS, MORE = 3, 50
#: Share of a time limit for these starts, and multiple of the first search's seconds that it must leave.
SHARE, ROOM = 0.5, 8.0
#: Largest number of random restarts, and iterations of each of their programs.
RESTARTS, RESTART_ITERATIONS = 4, 1000
#: Iterations of all restarts after which another one is unlikely to succeed. If the second look misled the
#: first run, its iterations count, because seed 0 repeats all stages.
RESTARTS_END = 2500

_NOTHING = (Termination.NO_SOLUTION, Termination.LOCALLY_INFEASIBLE, Termination.FAILED)


def wants_none(job: Job) -> bool:
    """Return True if the caller controls the starts: by a seed, several starts or a warm start."""
    return job.seed is not None or job.starts > 1 or job.warm_start is not None


def with_iterations(request: Request, count: int) -> Request:
    """Return the request with at most `count` iterations, if the backend has such a limit."""
    if "max_iter" not in request.options:
        return request
    most = min(request.options["max_iter"], count)
    return replace(request, options={**request.options, "max_iter": most})


def _iterations(answer: Answer) -> int:
    return int(answer.statistics.get("iterations", 0))


def look_again(
    run: Run, problem: Any, request: Request, answer: Answer, left: float | None
) -> tuple[Answer, Any]:
    """Return the answer and program of another start if it is clearly better, else the given ones.

    The formulation's coarse program is solved from the plan of `answer`, which is that from the formulation's own guess,
    and from random starts. Its best optima are starts of the first program, `problem`. The run continues with the
    better formulation. `left` are the seconds left, None without a limit.
    """
    formulation = run.target.formulation
    if formulation is None or not formulation.draws or wants_none(run.job):
        return answer, problem
    value = answer.primal_bound
    if answer.termination is not Termination.LOCALLY_OPTIMAL or value is None:
        return answer, problem
    coarse = formulation.coarse()
    if coarse is None:
        return answer, problem
    if formulation.is_convex:
        return _marked(answer, "convex"), problem
    if request.control.stopped or (left is not None and left < ROOM * run.spent[-1]):
        run.notes.append(
            "other starts were skipped: the first program took "
            f"{run.spent[-1]:.2g} s and {max(left or 0.0, 0.0):.2g} s were left; "
            "a larger time_limit may lead to a better optimum"
        )
        return _marked(answer, "skipped"), problem
    begin, seconds = clock(), None if left is None else SHARE * left
    with request.control.stage(seconds) as part:  # its end does not end the run
        stage_request = replace(request, time_limit=seconds, control=part)
        plan = formulation.decode(answer.point)
        outcome = "no better"
        for start in _optima(run, coarse, plan, value, stage_request):
            other = formulation.guessed(start)
            assert other is not None
            program = other.program
            warm = program.guess if Feature.WARM_START in run.target.backend.features else None
            limited = with_iterations(stage_request, ITERATIONS * _iterations(answer) + MORE)
            second = run.attend(program, replace(limited, warm_start=warm))
            if _is_better(second, value):
                run.target = replace(run.target, formulation=other)
                run.notes.append("a drawn start led to a better optimum than the guess")
                outcome, answer, problem = "better", second, program
                break
        if outcome != "better" and part.reason is Limit.TIME:
            outcome = "stopped"
            run.notes.append(
                f"other starts were stopped by the time limit after {clock() - begin:.2g} s; "
                "a larger time_limit may lead to a better optimum"
            )
    run.spent[-1] += clock() - begin
    return _marked(answer, outcome), problem


def _marked(answer: Answer, outcome: str) -> Answer:
    return replace(answer, statistics={**answer.statistics, SECOND: outcome})


def _is_better(answer: Answer, value: float) -> bool:
    is_optimal = answer.termination is Termination.LOCALLY_OPTIMAL
    bound = answer.primal_bound
    return is_optimal and bound is not None and bound < value - BETTER * abs(value)


def _optima(run: Run, coarse: Any, plan: Any, value: float, request: Request) -> list[Any]:
    """Return the plans of the best distinct optima of the coarse program, if better than `plan` there.

    `value` is the objective of the plan, which is replaced by that on the coarse program.
    """
    program, request = coarse.program, with_iterations(request, COARSE_ITERATIONS)
    optima, spent, reached, several, agreeing = dict[float, Any](), 0, False, False, 0
    for seed in range(MOST + 1):
        is_unlikely = not several or (agreeing >= AGREEING and min(optima) >= value)
        if request.control.stopped or spent >= BUDGET or (reached and seed > LEAST and is_unlikely):
            break
        start = coarse.encode(plan) if seed == 0 else coarse.draw(seed)
        answer = run.attend(replace(program, guess=start), request)
        spent += _iterations(answer)
        bound = answer.primal_bound
        if answer.termination is not Termination.LOCALLY_OPTIMAL or bound is None:
            continue
        if seed == 0:
            value, reached = bound, True
        is_other = abs(bound - value) > BETTER * abs(value)
        several |= is_other
        agreeing += seed > 0 and not is_other
        if all(abs(bound - known) > BETTER * abs(known) for known in optima):
            optima[bound] = answer
    better = sorted(bound for bound in optima if _is_better(optima[bound], value))
    return [coarse.decode(optima[bound].point) for bound in better[:LIFTED]]


def start_again(
    job: Job, first: Solution[Any], run: Callable[..., Solution[Any]], control: Control
) -> Solution[Any]:
    """Return `first`, or the result of a random start if the guess led to no plan.

    Only formulations that draw starts and are not convex are restarted, and only if the job has no
    seed, no number of starts and no warm start. The solution has the seed of the successful start.
    ``run(job, control=…)`` returns the solution of one start, and `control` can stop all starts.
    """
    misled = first.plan is None and first.statistics.get(SECOND) == "better"
    failed = misled or first.termination in _NOTHING
    if not failed or first.limit not in (None, Limit.ITERATIONS) or wants_none(job):
        return first
    formulation = job.find_target().formulation  # which may take long to create
    if formulation is None or not formulation.draws or formulation.is_convex:
        return first
    begin, spent = time.perf_counter(), first.seconds.get("total", 0.0)
    assert isinstance(job.backend, Backend)
    limited = job
    if "max_iter" in job.backend.options:
        most = min(RESTART_ITERATIONS, job.backend_options.get("max_iter", RESTART_ITERATIONS))
        limited = replace(job, backend_options={**job.backend_options, "max_iter": most})
    tried, result, left = 1, first, None
    iterations = int(first.statistics.get("iterations", 0)) if misled else 0
    # If the second look misled the first run, seed 0 repeats the guess without it.
    for seed in range(0 if misled else 1, RESTARTS + 1):
        if job.time_limit is not None:
            left = job.time_limit - spent - (time.perf_counter() - begin)
        over = control.stopped or (left is not None and left <= 0.0)
        if over or iterations >= RESTARTS_END:
            break
        tried += 1
        # Each start gets an equal share of the remaining seconds.
        share = None if left is None else left / (RESTARTS + 1 - seed)
        with control.stage(left) as part:
            result = run(replace(limited, seed=seed, time_limit=share), control=part)
        iterations += int(result.statistics.get("iterations", 0))
        if result.plan is not None or result.limit is Limit.INTERRUPTED:
            break
    if tried == 1:
        return first
    best = first if result.plan is None else result
    remark = f"{tried} starts: from the guess {first.termination}"
    if result.plan is not None:
        remark += f", from seed {result.seed} {result.termination}"
    limit = result.limit if result.limit is Limit.INTERRUPTED else best.limit
    message = "; ".join(filter(None, (best.message, remark)))
    statistics = {**best.statistics, "starts tried": tried}
    return replace(best, message=message, statistics=statistics, limit=limit)
