"""What every nonlinear backend shares: a solver's claim is recomputed before it is an answer.

A backend here only translates: its ``attempt`` hands the program and a point to start from to its
solver and reports where and how the solver ended. A local optimum is one when its point verifies and
multipliers explain the gradient there; what falls short is called what it is. None of these solvers
proves that nothing better exists, or that a program has no solution.
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
from ..attempts import Clock, Ended, Ending, ending_if_stopped, limit_reached, stop_reason
from ..backend import Answer, Backend, Feature, Guarantee, Limit, Option, Request, Termination
from .curvature import descent_by_curvature
from .quality import Quality, measured, worst_blocks

__all__ = ["COMMON", "HESSIAN", "NonlinearBackend", "most_iterations"]

Vector = NDArray[np.float64]

#: Stationarity, relative to the objective's gradient, up to which a solver's optimum is one.
STATIONARY = 1e-3
#: The same where the solver itself does not call its point an optimum.
CLEARLY_STATIONARY = 1e-6

#: How far from a point that is no minimum the search goes on, in terms of the columns' sizes, and from
#: how many such points; the share of the objective by which it must have fallen.
AWAY, SADDLES, LESS = 0.1, 3, 1e-9

#: What every nonlinear backend declares: all of them search from a point.
COMMON = frozenset({Feature.SEED, Feature.WARM_START, Feature.DUALS, Feature.LOG})

#: The option of solvers that can do without the Hessian.
HESSIAN = Option(
    "exact",
    "The exact Hessian, or an approximation from gradients.",
    str,
    ("exact", "limited-memory"),
)


def most_iterations(default: int) -> Option:
    """Return the option ``max_iter``, which all of these solvers have."""
    return Option(default, "Iterations at most.", int, lower=1)


class NonlinearBackend(Backend):
    """Base of the backends that search a local optimum of a :class:`NonlinearProgram`.

    Attributes
    ----------
    prompt : bool
        Whether one iteration is short on large programs too. A solver that hears of a stop only
        between iterations that may take minutes runs in a process of its own.
    """

    accepts = NonlinearProgram
    guarantee = Guarantee.LOCAL
    features = COMMON
    prompt: ClassVar[bool] = True

    def interrupts(self, kind: type[Model[Any]]) -> bool:
        """Return whether a stop is heard soon enough for a run in the caller's process."""
        return self.prompt and super().interrupts(kind)

    @abstractmethod
    def attempt(
        self, program: NonlinearProgram, request: Request, clock: Clock, start: Vector
    ) -> Ending:
        """Let the solver search from `start` once and report where and how it ended.

        ``INFEASIBLE`` says that no way leads from there to a feasible point, ``UNBOUNDED`` that its
        iterates run away.

        Laps of `clock` are called ``"build"`` (until the solver starts) and ``"solve"``.
        """

    def run(self, problem: NonlinearProgram, request: Request) -> Answer:
        """Search `problem` as `request` asks: from the warm start, else from the seed's point."""
        self.require()
        reason = self.refuses(problem)
        if reason:
            raise UnsupportedFormulation(reason)
        request = replace(request, options=self.checked_options(request.options))
        return _Run(self, problem, request, Clock(request.time_limit)).answer()


def _counted(answer: Answer, more: Answer) -> dict[str, float | int | str]:
    """Return the statistics of `answer` with the iterations of another search added."""
    spent = sum(int(one.statistics.get("iterations", 0)) for one in (answer, more))
    return {**answer.statistics, "iterations": spent}


def _is_less(one: Answer, other: Answer) -> bool:
    """Return whether `one` has a plan that is better by more than what solvers leave."""
    if one.primal_bound is None or other.primal_bound is None or one.point is None:
        return False
    return one.primal_bound < other.primal_bound - LESS * abs(other.primal_bound)


@dataclass(frozen=True, eq=False)
class _Run:
    backend: NonlinearBackend
    problem: NonlinearProgram
    request: Request
    clock: Clock

    def answer(self) -> Answer:
        known = ending_if_stopped(self.request, self.clock)
        if known is not None:
            return self.judged(known)
        start = self.start()
        if not (self.problem.column_lower < self.problem.column_upper).any():
            # No column is free, or there is none: nothing to search, and solvers refuse that.
            there = self.problem.verify(start, tolerance=self.request.tolerance).ok
            ended = Ended.PROVEN if there else Ended.INFEASIBLE
            return self.judged(Ending(ended, start, statistics={"iterations": 0}))
        found = self.attempted(start, self.request)
        # What was left on a first mesh is not come back to on a finer one, where the look costs more
        # than the search.
        return self.off_saddles(found) if self.request.warm_start is None else found

    def attempted(self, start: Vector, request: Request) -> Answer:
        """Return the answer of one search from `start`."""
        if request.time_limit is not None:
            request = replace(request, time_limit=self.clock.left())
        return self.judged(self.backend.attempt(self.problem, request, self.clock, start))

    def off_saddles(self, answer: Answer) -> Answer:
        """Return `answer`, or a better one where its point is stationary and no minimum.

        From there the search goes on to both sides of a direction along which the objective falls.
        """
        left = 0
        while answer.termination is Termination.LOCALLY_OPTIMAL:
            assert answer.point is not None and answer.duals is not None
            with np.errstate(all="ignore"):
                away = descent_by_curvature(self.problem, answer.point, answer.duals)
            self.clock.lap("judge")
            if away is None:
                break
            better = False
            if left < SADDLES:
                answer, better = self.searched_along(away, answer)
            left += 1
            if not better:
                words = "not a minimum: the objective falls along a direction of negative curvature"
                message = "; ".join(filter(None, (answer.message, words)))
                answer = replace(answer, termination=Termination.FEASIBLE, message=message)
                break
        if left:
            answer = replace(answer, statistics={**answer.statistics, "saddle points left": left})
        return answer

    def searched_along(self, away: Vector, answer: Answer) -> tuple[Answer, bool]:
        """Return an answer from either side of the point of `answer`, and whether it is better.

        Without a better one it is `answer` itself; either way the searches are counted.
        """
        assert answer.point is not None
        low, high = self.problem.column_lower, self.problem.column_upper
        for side in (AWAY, -AWAY):
            if limit_reached(self.request, self.clock) is not None:
                break
            start = np.clip(answer.point + side * away, low, high)
            found = self.attempted(start, replace(self.request, warm_start=None))
            answer = replace(answer, statistics=_counted(answer, found))
            if _is_less(found, answer):
                return replace(found, statistics=answer.statistics), True
        return answer, False

    def start(self) -> Vector:
        """Return where the search begins."""
        if self.request.warm_start is None:
            return self.problem.start(self.request.seed)
        given = np.asarray(self.request.warm_start, float)
        start: Vector = np.clip(given, self.problem.column_lower, self.problem.column_upper)
        return start

    def judged(self, ending: Ending) -> Answer:
        """Return the answer that `ending` earns."""
        found = measured(
            self.problem, ending.point, ending.duals, self.request.tolerance, STATIONARY
        )
        self.clock.lap("judge")
        if ending.ended is Ended.UNBOUNDED:
            return self.without(ending, found, Termination.NO_SOLUTION, "its iterates run away")
        if found is None or not found.feasible:
            return self.kept(ending, found) or self.infeasible(ending, found)
        own = ending.limit is Limit.ITERATIONS and not self.request.control.stopped
        if ending.ended is Ended.STOPPED and not (own and found.stationarity <= CLEARLY_STATIONARY):
            return self.having(ending, found, Termination.FEASIBLE)
        if ending.ended is Ended.PROVEN and found.stationarity <= STATIONARY:
            return self.having(replace(ending, message=""), found, Termination.LOCALLY_OPTIMAL)
        if found.stationarity <= CLEARLY_STATIONARY:
            words = "yet its point is a local optimum"
            return self.having(ending, found, Termination.LOCALLY_OPTIMAL, words)
        words = f"its point is feasible, with a stationarity of {found.stationarity:.2g}"
        return self.having(ending, found, Termination.FEASIBLE, words)

    def infeasible(self, ending: Ending, found: Quality | None) -> Answer:
        """Return the answer where the solver ended outside, or nowhere."""
        words = ""
        if found is not None:
            worst = worst_blocks(self.problem, found.point)
            words = f"violated most: {worst}" if worst else "violated: a column's bound"
        if ending.ended is Ended.INFEASIBLE and not self.request.control.stopped:
            where = "no feasible point near where the search ended"
            return self.without(
                ending, found, Termination.LOCALLY_INFEASIBLE, f"{where}; {words}".rstrip("; ")
            )
        if self.limit(ending) is not None:
            return self.without(ending, found, Termination.NO_SOLUTION, words)
        if ending.ended is Ended.PROVEN:
            words = f"the solver calls its point an optimum; {words}".rstrip("; ")
        return self.without(ending, found, Termination.FAILED, words)

    def kept(self, ending: Ending, found: Quality | None) -> Answer | None:
        """Return the warm start where it is feasible and the search lost it, else None."""
        if self.request.warm_start is None:
            return None
        first = measured(self.problem, self.start(), None, self.request.tolerance, STATIONARY)
        if first is None or not first.feasible:
            return None
        words = "the warm start is all there is"
        return self.having(ending, first, Termination.FEASIBLE, words)

    def limit(self, ending: Ending) -> Limit | None:
        """Return the limit that ended the run: a stop asked for goes before the solver's word."""
        if ending.ended is Ended.STOPPED or self.request.control.stopped:
            return stop_reason(self.request.control, ending.limit or Limit.INTERRUPTED)
        return None

    def having(self, ending: Ending, found: Quality, kind: Termination, words: str = "") -> Answer:
        """Return an answer with a point."""
        optimal = kind is Termination.LOCALLY_OPTIMAL
        return replace(
            self.without(ending, found, kind, words),
            limit=None if optimal else self.limit(ending),
            point=found.point,
            primal_bound=found.objective,
            duals=found.duals,
        )

    def without(
        self, ending: Ending, found: Quality | None, kind: Termination, words: str
    ) -> Answer:
        """Return an answer without a point."""
        counts: dict[str, float | int | str] = dict(ending.statistics)
        if found is not None:
            counts["infeasibility"] = found.infeasibility
            if np.isfinite(found.stationarity):
                counts["stationarity"] = found.stationarity
        return Answer(
            kind,
            self.limit(ending) if kind is Termination.NO_SOLUTION else None,
            seconds=self.clock.seconds,
            statistics=counts,
            message="; ".join(text for text in (ending.message, words) if text),
        )
