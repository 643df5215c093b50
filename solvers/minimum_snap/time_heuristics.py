"""``time-trapezoid`` and ``time-distance``: durations by rule, with the best total."""

from __future__ import annotations

import time
from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray

from ...models.minimum_snap.time_allocation import TimeAllocation
from ..backend import Answer, Feature, Guarantee, Limit, Request, Termination
from .time_gradient import NativeTimes, concluded

__all__ = ["TimeDistance", "TimeTrapezoid"]

Floats = NDArray[np.float64]


class RuleOfThumb(NativeTimes):
    """Base of the rules: their proportions are kept, their total is the best for J + ρ ΣT.

    Where there are bounds, the total is the best one that leaves a path within them.
    """

    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INTERRUPT})

    @abstractmethod
    def rule(self, problem: TimeAllocation) -> Floats:
        """Return durations, shape (M,), whose proportions are the rule's."""

    def run(self, problem: TimeAllocation, request: Request) -> Answer:
        """Scale the rule's durations, and solve for the trajectory."""
        from .time_barrier import inner_problem
        from .time_descent import allocate
        from .time_inner import Spline
        from .time_rules import started

        self.covered(problem)
        begin = time.perf_counter()
        inner = inner_problem(problem, request.control.flag)
        durations = started(problem, inner, self.rule(problem))
        statistics: dict[str, float | int | str] = {}
        if durations is None:
            stopped = request.control.stopped
            limit = (request.control.reason or Limit.INTERRUPTED) if stopped else None
            return Answer(
                Termination.NO_SOLUTION, limit,
                seconds={"solve": time.perf_counter() - begin},
                message="" if stopped else "no total time was found at which the rule's "
                "proportions leave a path within the bounds",
            )  # fmt: skip
        if not isinstance(inner, Spline) and problem.total_time is None:
            durations = allocate(
                problem, inner, durations, tolerance=1e-7, most=500, between=1e-8,
                stopped=lambda: bool(inner.flag[0]), proportional=True,
            ).durations  # fmt: skip
        return concluded(
            problem, inner, durations, request, begin, Termination.FEASIBLE, statistics
        )


class TimeTrapezoid(RuleOfThumb):
    """Durations of a trapezoidal velocity profile on each segment, with the best total."""

    name = "time-trapezoid"
    summary = "each segment as long as a trapezoidal velocity profile takes; best total; ours"

    def rule(self, problem: TimeAllocation) -> Floats:
        """Return the profile's durations."""
        from .time_rules import trapezoid

        return trapezoid(problem)


class TimeDistance(RuleOfThumb):
    """Durations proportional to the distance between waypoints, with the best total."""

    name = "time-distance"
    summary = "durations proportional to the distance between waypoints; best total; ours"

    def rule(self, problem: TimeAllocation) -> Floats:
        """Return the distances as durations."""
        from .time_rules import distance

        return distance(problem)
