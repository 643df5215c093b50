"""Base of the backends for nonlinear programs: a solver's claim is recomputed before it is an answer.

A backend only translates: its ``attempt`` passes the program and a start to its solver and reports the
ending. A local optimum must verify, and multipliers must explain its gradient; otherwise the claim is
weakened. These solvers cannot prove that no better plan exists or that a program is infeasible.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ...models.model import Model
from ...models.programs.nonlinear import NonlinearProgram
from ...models.verification import ROUNDING
from ..contract.backend import (
    Answer,
    Backend,
    Feature,
    Guarantee,
    Limit,
    Option,
    Request,
    Termination,
)
from ..contract.registry import integrality_refusal
from ..programs.attempts import Clock, Ended, Ending, ending_if_stopped, limit_reached, stop_reason
from .quality import Quality, descent_by_curvature, measure, worst_blocks

__all__ = ["COMMON", "HESSIAN", "NonlinearBackend", "most_iterations"]

Vector = NDArray[np.float64]

#: Largest stationarity, relative to the gradient of the objective, of a claimed optimum.
STATIONARY = 1e-3
#: The same for a point that the solver does not call an optimum.
CLEARLY_STATIONARY = 1e-6

#: Distance of a new start from a saddle point, in column sizes; largest number of saddle points left;
#: required relative decrease of the objective.
AWAY, SADDLES, LESS = 0.1, 3, 1e-9

#: Features of every nonlinear backend, all of which search from a point.
COMMON = frozenset({Feature.SEED, Feature.WARM_START, Feature.DUALS, Feature.LOG})

#: Option of solvers that can work without the Hessian.
HESSIAN = Option(
    "exact", "Exact Hessian, or an approximation from gradients.", str, ("exact", "limited-memory")
)


def most_iterations(default: int) -> Option:
    """Return the option ``max_iter`` of these solvers."""
    return Option(default, "Limit on iterations.", int, lower=1)


class NonlinearBackend(Backend):
    """Base of the backends that search a local optimum of a nonlinear program.

    A solver that is not `prompt` checks for stop requests only between long iterations, so it runs in a worker.
    """

    accepts = NonlinearProgram
    guarantee = Guarantee.LOCAL
    features = COMMON
    prompt: ClassVar[bool] = True

    def interrupts(self, kind: type[Model[Any]]) -> bool:
        """Return True if a run in the caller's process can be stopped soon enough."""
        return self.prompt and super().interrupts(kind)

    @abstractmethod
    def attempt(
        self, program: NonlinearProgram, request: Request, clock: Clock, start: Vector
    ) -> Ending:
        """Run the solver once from `start`, shape (columns,), and report the ending.

        The clock counts ``"build"`` until the solver starts, then ``"solve"``. ``INFEASIBLE`` means that the
        search found no feasible point from `start`, ``UNBOUNDED`` that the iterates diverge.
        """

    def run(self, problem: NonlinearProgram, request: Request) -> Answer:
        """Search `problem` from the warm start, else from the point of the seed; see :meth:`Backend.run`."""
        self.require()
        reason = integrality_refusal(problem, self) or self.refuses(problem)
        if reason:
            raise UnsupportedFormulation(reason)
        request = replace(request, options=self.checked_options(request.options))
        clock = Clock(request.time_limit)
        if problem.integral is not None:
            # Bonmin returned the bound 0.8 of an integral column.
            low = np.where(problem.integral, np.ceil(problem.column_lower - ROUNDING), -np.inf)
            high = np.where(problem.integral, np.floor(problem.column_upper + ROUNDING), np.inf)
            crossed = np.flatnonzero(low > high)
            if crossed.size:
                message = f"{problem.column_name(int(crossed[0]))}: its bounds contain no integer"
                return _Run(self, problem, request, clock).judge(
                    Ending(Ended.INFEASIBLE, message=message)
                )
            problem = replace(
                problem,
                column_lower=np.where(problem.integral, low, problem.column_lower),
                column_upper=np.where(problem.integral, high, problem.column_upper),
                column_scale=np.where(problem.integral, 1.0, problem.column_scale),
            )
        return _Run(self, problem, request, clock).answer()


def _is_less(answer: Answer, other: Answer) -> bool:
    """Return True if `answer` has a point that is better by more than solver errors."""
    if answer.primal_bound is None or other.primal_bound is None or answer.point is None:
        return False
    return answer.primal_bound < other.primal_bound - LESS * abs(other.primal_bound)


@dataclass(frozen=True, eq=False)
class _Run:
    backend: NonlinearBackend
    problem: NonlinearProgram
    request: Request
    clock: Clock

    def answer(self) -> Answer:
        ending = ending_if_stopped(self.request, self.clock)
        if ending is not None:
            return self.judge(ending)
        start = self.start()
        if not (self.problem.column_lower < self.problem.column_upper).any():
            # Without free columns there is nothing to search, and solvers reject the program.
            is_feasible = self.problem.verify(start, tolerance=self.request.tolerance).ok
            ended = Ended.PROVEN if is_feasible else Ended.INFEASIBLE
            return self.judge(Ending(ended, start, statistics={"iterations": 0}))
        answer = self.attempt(start, self.request)
        # Saddle points are left on the first mesh only. On finer meshes, which start warm, the test
        # costs more than the search.
        return self.off_saddles(answer) if self.request.warm_start is None else answer

    def attempt(self, start: Vector, request: Request) -> Answer:
        """Run one search from `start` and return its answer."""
        if request.time_limit is not None:
            request = replace(request, time_limit=self.clock.left())
        return self.judge(self.backend.attempt(self.problem, request, self.clock, start))

    def off_saddles(self, answer: Answer) -> Answer:
        """Return `answer`, or a better one if its point is stationary but not a minimum.

        Integral columns do not move. The search then continues from both sides along a direction in which the objective decreases.
        """
        left = 0
        while answer.termination is Termination.LOCALLY_OPTIMAL:
            assert answer.point is not None and answer.duals is not None
            with np.errstate(all="ignore"):
                away = descent_by_curvature(self.fixed(answer.point), answer.point, answer.duals)
            self.clock.lap("judge")
            if away is None:
                break
            better = False
            if left < SADDLES:
                answer, better = self.search_along(away, answer)
            left += 1
            if not better:
                words = "not a minimum: the objective falls along a direction of negative curvature"
                message = "; ".join(filter(None, (answer.message, words)))
                answer = replace(answer, termination=Termination.FEASIBLE, message=message)
                break
        if left:
            answer = replace(answer, statistics={**answer.statistics, "saddle points left": left})
        return answer

    def search_along(self, away: Vector, answer: Answer) -> tuple[Answer, bool]:
        """Return a better answer from either side of the point of `answer`, and whether there is one.

        Without a better one, `answer` is returned. The iterations of all searches are counted.
        """
        assert answer.point is not None
        low, high = self.problem.column_lower, self.problem.column_upper
        for side in (AWAY, -AWAY):
            if limit_reached(self.request, self.clock) is not None:
                break
            start = np.clip(answer.point + side * away, low, high)
            other = self.attempt(start, replace(self.request, warm_start=None))
            spent = sum(int(part.statistics.get("iterations", 0)) for part in (answer, other))
            answer = replace(answer, statistics={**answer.statistics, "iterations": spent})
            if _is_less(other, answer):
                return replace(other, statistics=answer.statistics), True
        return answer, False

    def start(self) -> Vector:
        """Return the initial point of the search."""
        if self.request.warm_start is None:
            return self.problem.start(self.request.seed)
        given = np.asarray(self.request.warm_start, float)
        start: Vector = np.clip(given, self.problem.column_lower, self.problem.column_upper)
        return start

    def judge(self, ending: Ending) -> Answer:
        """Return the answer that `ending` proves."""
        quality = self.measured(ending)
        self.clock.lap("judge")
        if ending.ended is Ended.UNBOUNDED:
            return self.without_point(
                ending,
                quality,
                Termination.NO_SOLUTION,
                "its iterates diverge: the objective may be unbounded",
            )
        if quality is None or not quality.feasible:
            return self.warm_start_answer(ending) or self.infeasible(ending, quality)
        is_iteration_limit = ending.limit is Limit.ITERATIONS and not self.request.control.stopped
        if ending.ended is Ended.STOPPED and not (
            is_iteration_limit and quality.stationarity <= CLEARLY_STATIONARY
        ):
            return self.with_point(ending, quality, Termination.FEASIBLE)
        if ending.ended is Ended.PROVEN and quality.stationarity <= STATIONARY:
            return self.with_point(
                replace(ending, message=""), quality, Termination.LOCALLY_OPTIMAL
            )
        if quality.stationarity <= CLEARLY_STATIONARY:
            remark = "yet its point is a local optimum"
            return self.with_point(ending, quality, Termination.LOCALLY_OPTIMAL, remark)
        remark = f"its point is feasible, with a stationarity of {quality.stationarity:.2g}"
        return self.with_point(ending, quality, Termination.FEASIBLE, remark)

    def fixed(self, point: Vector, *, whole: bool = True) -> NonlinearProgram:
        """Return the program with integral columns fixed at their values in `point`, rounded if `whole`."""
        program = self.problem
        if program.integral is None:
            return program
        values = np.clip(
            np.round(point) if whole else point, program.column_lower, program.column_upper
        )
        return replace(
            program,
            column_lower=np.where(program.integral, values, program.column_lower),
            column_upper=np.where(program.integral, values, program.column_upper),
            derivatives=program.first_order,
            hessian=program.second_order,
        )

    def measured(self, ending: Ending) -> Quality | None:
        """Return the quality of the point of `ending`, with its integral columns fixed."""
        point, duals, tolerance = ending.point, ending.duals, self.request.tolerance
        if point is None or self.problem.continuous:
            return measure(self.problem, point, duals, tolerance, STATIONARY)
        quality = measure(self.fixed(point), point, duals, tolerance, STATIONARY)
        if quality is not None and quality.feasible:
            return quality
        # Rounding can violate a row with large coefficients.
        return measure(self.fixed(point, whole=False), point, duals, tolerance, STATIONARY)

    def infeasible(self, ending: Ending, quality: Quality | None) -> Answer:
        """Return the answer for an infeasible or missing point."""
        remark = ""
        if quality is not None:
            worst = worst_blocks(self.problem, quality.point)
            remark = f"violated most: {worst}" if worst else "violated: a column's bound"
        if ending.ended is Ended.INFEASIBLE and not self.request.control.stopped:
            text = "no feasible point near where the search ended"
            return self.without_point(
                ending, quality, Termination.LOCALLY_INFEASIBLE, f"{text}; {remark}".rstrip("; ")
            )
        if self.limit(ending) is not None:
            return self.without_point(ending, quality, Termination.NO_SOLUTION, remark)
        if ending.ended is Ended.PROVEN:
            remark = f"the solver calls its point an optimum; {remark}".rstrip("; ")
        return self.without_point(ending, quality, Termination.FAILED, remark)

    def warm_start_answer(self, ending: Ending) -> Answer | None:
        """Return the warm start if it is feasible and the search lost it, else None."""
        if self.request.warm_start is None:
            return None
        first = measure(self.problem, self.start(), None, self.request.tolerance, STATIONARY)
        if first is None or not first.feasible:
            return None
        words = "the warm start is the only feasible point"
        return self.with_point(ending, first, Termination.FEASIBLE, words)

    def limit(self, ending: Ending) -> Limit | None:
        """Return the limit that ended the run. A stop request takes precedence over the solver's status."""
        if ending.ended is Ended.STOPPED or self.request.control.stopped:
            return stop_reason(self.request.control, ending.limit or Limit.INTERRUPTED)
        return None

    def with_point(
        self, ending: Ending, quality: Quality, kind: Termination, words: str = ""
    ) -> Answer:
        """Return an answer with a point."""
        optimal = kind is Termination.LOCALLY_OPTIMAL
        return replace(
            self.without_point(ending, quality, kind, words),
            limit=None if optimal else self.limit(ending),
            point=quality.point,
            primal_bound=quality.objective,
            duals=quality.duals,
        )

    def without_point(
        self, ending: Ending, quality: Quality | None, kind: Termination, words: str
    ) -> Answer:
        """Return an answer without a point."""
        counts: dict[str, float | int | str] = dict(ending.statistics)
        if quality is not None:
            counts["infeasibility"] = quality.infeasibility
            if np.isfinite(quality.stationarity):
                counts["stationarity"] = quality.stationarity
        return Answer(
            kind,
            self.limit(ending) if kind is Termination.NO_SOLUTION else None,
            seconds=self.clock.seconds,
            statistics=counts,
            message="; ".join(text for text in (ending.message, words) if text),
        )
