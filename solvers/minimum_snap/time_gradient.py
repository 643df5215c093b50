"""``time-gradient``: native time allocation, L-BFGS on the logarithms of the durations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...jit import clock
from ...models.minimum_snap.time_allocation import TimeAllocation
from ..contract.backend import (
    Answer,
    Backend,
    Feature,
    Guarantee,
    Option,
    Request,
    Termination,
)

if TYPE_CHECKING:
    from .time_barrier import Inner

__all__ = ["TimeGradient"]

Floats = NDArray[np.float64]

#: Minimum time between two incumbents, s.
PAUSE = 0.1
#: Largest relative difference of two objectives that is attributed to rounding.
ROUNDING = 1e-9
#: Standard deviation of the logarithms of the durations of additional starts.
SPREAD = 0.4
#: Largest number of steps per descent while free knots are added one by one.
EACH = 400
#: Relative complementarity of the first barrier after a warm start, which stays near its start.
WARM = 1e-3


def _concluded(
    problem: TimeAllocation,
    inner: Inner,
    durations: Floats,
    request: Request,
    begin: float,
    termination: Termination,
    statistics: dict[str, float | int | str],
    message: str = "",
) -> Answer:
    """Return the answer with the plan at `durations`, even after the deadline."""
    from .time_barrier import Spline

    limit = request.control.limit
    if limit is not None:
        termination = Termination.FEASIBLE
    if not isinstance(inner, Spline):
        inner.flag = np.zeros(1, np.int8)
        statistics["instants"] = sum(group.held.s.size for group in inner.groups)
    plan = inner.plan(durations)
    statistics["solves"] = inner.solves
    if inner.steps:
        statistics["newton steps"] = inner.steps
    seconds = {"solve": clock() - begin}
    if plan is None:
        return Answer(
            Termination.NO_SOLUTION, limit, seconds=seconds, statistics=statistics,
            message=message or "the trajectory at the durations found cannot be computed",
        )  # fmt: skip
    residual = problem.identity_residual(plan)
    if residual is not None:
        statistics["identity residual"] = residual
    return Answer(
        termination, limit, plan, problem.objective(plan), seconds=seconds,
        statistics=statistics, message=message,
    )  # fmt: skip


class TimeGradient(Backend):
    """Quasi-Newton descent on log T, with the slope of J by the envelope theorem.

    The first start is the better of the durations by trapezoid and by distance, scaled for
    J + ρ ΣT and stretched until a path satisfies the bounds. A seed above 0 perturbs it. A
    decreasing barrier represents corridor and limits. Durations without a path have an infinite
    value. With free knots, the solver first solves problems with fewer of them. Their solution with
    a halved segment is the start for an additional knot, so that more free knots never increase the
    objective.

    The result is a local optimum. The statistics include the gradient by log T, relative to the
    objective.
    """

    name = "time-gradient"
    accepts = TimeAllocation
    single_threaded = True
    guarantee = Guarantee.LOCAL
    features = frozenset({Feature.SEED, Feature.WARM_START, Feature.INCUMBENTS, Feature.INTERRUPT})
    options: ClassVar[Mapping[str, Option]] = {
        "gradient": Option(
            None,
            "Largest derivative of the objective by log T at the end, relative to it; 1e-6 by "
            "default with corridor or limits, 1e-8 without.",
            float, lower=1e-12, upper=1e-1,
        ),
        "rule": Option(
            "choose",
            "Durations to start from: of a trapezoidal velocity profile on each segment, "
            "proportional to the distances, or the better of the two.",
            str, ("choose", "trapezoid", "distance"),
        ),
        "iterations": Option(2000, "Most quasi-Newton steps.", int, lower=1),
    }  # fmt: skip
    summary = "L-BFGS on log T with exact gradients, limits by a barrier; ours"

    def refuses(self, problem: TimeAllocation) -> str:
        """Return the features of `problem` that the inner solvers do not support, or empty."""
        from .direct import Banded
        from .interior_point import InteriorPoint

        if problem.beyond_times:
            return problem.beyond_times
        if not problem.bounded:
            return Banded().refuses(problem.unit)
        return InteriorPoint().refuses(problem.unit)

    def run(self, problem: TimeAllocation, request: Request) -> Answer:
        """Descend from a start, and return the warm start if the result is not better."""
        self.require_support(problem)
        return _no_worse(problem, request, self._descend(problem, request))

    def _descend(self, problem: TimeAllocation, request: Request) -> Answer:
        """Return the answer of the descent, with its final gradient."""
        from .time_barrier import Barrier, Spline, inner_problem
        from .time_descent import Allocated, allocate
        from .time_rules import coarsen, restore_path, runs_of, set_barrier, subdivide

        begin = clock()
        control = request.control
        last_report = [clock()]
        inner = inner_problem(problem, control.flag)
        tolerance = request.options.get("gradient")
        most = request.options.get("iterations", 2000)
        nested = problem.bounded and request.warm_start is None
        runs = runs_of(problem)
        result: Allocated | None = None
        counts = runs
        iterations = evaluations = solves = steps = 0

        def report(durations: Floats, value: float) -> None:
            if clock() - last_report[0] > PAUSE:
                plan = inner.plan(durations)
                if plan is not None:
                    control.incumbent(problem.objective(plan), plan)
                last_report[0] = clock()

        for now, model in coarsen(problem) if nested else [(runs, problem)]:
            if control.stopped:
                break
            last = model is problem
            # Start from the rules' durations and, if that result is worse, from that of fewer knots.
            for carried in (False, True):
                own = inner if last else inner_problem(model, control.flag)
                if carried:
                    if result is None or counts is now or not isinstance(own, Barrier):
                        continue
                    start = restore_path(model, own, subdivide(result.durations, counts, now))
                else:
                    start = _start(model, own, request)
                if start is None:
                    continue
                more = allocate(
                    model, own, start,
                    tolerance=tolerance or (1e-6 if problem.bounded else 1e-8),
                    most=min(most, EACH) if runs.size < problem.segments and nested else most,
                    between=max(1e-3 * request.tolerance, 1e-9),
                    stopped=lambda: control.stopped,
                    report=report if last else lambda durations, value: None,
                    first=WARM if carried or request.warm_start is not None else 1.0,
                )  # fmt: skip
                iterations += more.iterations
                evaluations += more.evaluations
                if not last:
                    solves, steps = solves + own.solves, steps + own.steps
                if result is None or more.value < result.value:
                    result, counts = more, now
        if result is None:
            return Answer(
                Termination.NO_SOLUTION,
                control.limit,
                seconds={"solve": clock() - begin},
                statistics={"solves": inner.solves, "newton steps": inner.steps},
                message=""
                if control.stopped
                else "no durations were found that leave a path within the "
                "bounds; this is no proof that there are none",
            )
        durations = subdivide(result.durations, counts, runs)
        if isinstance(inner, Barrier) and counts is not runs:
            set_barrier(problem, inner, Spline(problem), durations)
        inner.solves += solves
        inner.steps += steps
        statistics: dict[str, Any] = {
            "iterations": iterations,
            "evaluations": evaluations,
            "gradient": result.gradient,
        }
        shortest = float(durations.min() / durations.max())
        statistics["shortest to longest"] = shortest
        done = Termination.LOCALLY_OPTIMAL if result.settled else Termination.FEASIBLE
        message = (
            "" if result.settled else "the steps no longer helped before the gradient was small"
        )
        if shortest < 1e-8:
            message = "a duration falls to 0: its segment may be better left out"
        return _concluded(problem, inner, durations, request, begin, done, statistics, message)


def _no_worse(problem: TimeAllocation, request: Request, answer: Answer) -> Answer:
    """Return `answer`, or the warm start if that is better by more than rounding.

    The first barrier moves the path away from the bounds, so that an early end may be worse than the
    start.
    """
    if request.warm_start is None:
        return answer
    value = problem.objective(request.warm_start)
    if answer.primal_bound is not None and answer.primal_bound <= value + ROUNDING * abs(value):
        return answer
    return replace(
        answer, termination=Termination.FEASIBLE, point=request.warm_start, primal_bound=value,
        message="nothing better than the warm start was found",
    )  # fmt: skip


def _start(problem: TimeAllocation, inner: Inner, request: Request) -> Floats | None:
    """Return durations with a path, from the warm start or the better rule, or None."""
    from .time_barrier import Spline
    from .time_rules import (
        distance,
        prepare_start,
        restore_path,
        scale_durations,
        shorten_total,
        trapezoid,
    )

    generator = np.random.default_rng(request.seed) if request.seed else None

    def varied(durations: Floats) -> Floats:
        if generator is None:
            return durations
        return durations * np.exp(SPREAD * generator.standard_normal(durations.size))

    if request.warm_start is not None:
        given = varied(np.asarray(request.warm_start.durations, float))
        if problem.total_time is not None:
            given = given * (problem.total_time / given.sum())
        return restore_path(problem, inner, given) if not isinstance(inner, Spline) else given
    spline = Spline(problem)
    ranked = []
    rules = {"trapezoid": trapezoid, "distance": distance}
    rule_option = request.options.get("rule", "choose")
    for rule in rules.values() if rule_option == "choose" else (rules[rule_option],):
        durations = scale_durations(problem, spline, varied(rule(problem)))
        cost = spline.value(durations).objective
        price = problem.time_weight * float(durations.sum())
        ranked.append((cost + price if np.isfinite(cost) else np.inf, durations))
    ranked.sort(key=lambda pair: pair[0])
    for _, durations in ranked:
        result = prepare_start(problem, inner, durations)
        if result is not None:
            return result
    return shorten_total(problem, inner, ranked[0][1]) if not isinstance(inner, Spline) else None
