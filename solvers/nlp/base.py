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
from ..attempts import Clock, Ended, Outcome, limited, stopped
from ..backend import Answer, Backend, Feature, Guarantee, Limit, Request, Termination
from .quality import Quality, measured, worst_blocks

__all__ = ["COMMON", "NonlinearBackend", "NonlinearOutcome", "own_options"]

Vector = NDArray[np.float64]

#: Stationarity, relative to the objective's gradient, up to which a solver's optimum is one.
STATIONARY = 1e-3
#: The same where the solver itself does not call its point an optimum.
CLEARLY_STATIONARY = 1e-6

#: What every nonlinear backend declares: all of them search from a point.
COMMON = frozenset({Feature.SEED, Feature.WARM_START, Feature.DUALS})


@dataclass(frozen=True)
class NonlinearOutcome(Outcome):
    """What a solver of nonlinear programs reports of one run.

    ``point`` is where it ended, feasible or not; ``INFEASIBLE`` says that no way leads from there to a
    feasible point, ``UNBOUNDED`` that its iterates run away.

    Parameters
    ----------
    iterations : int, optional
        How many it made, where it tells.
    """

    iterations: int | None = None


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
    extra = "nlp"
    prompt: ClassVar[bool] = True

    def interrupts(self, kind: type[Model[Any]]) -> bool:
        """Return whether a stop is heard soon enough for a run in the caller's process."""
        return self.prompt and super().interrupts(kind)

    @abstractmethod
    def attempt(
        self, program: NonlinearProgram, request: Request, clock: Clock, start: Vector
    ) -> NonlinearOutcome:
        """Let the solver search from `start` once and report how it ended.

        Laps of `clock` are called ``"build"`` (until the solver starts) and ``"solve"``.
        """

    def run(self, problem: NonlinearProgram, request: Request) -> Answer:
        """Search `problem` as `request` asks: from the warm start, else from the seed's point."""
        self.require()
        reason = self.refuses(problem)
        if reason:
            raise UnsupportedFormulation(reason)
        return _Run(self, problem, request, Clock(request.time_limit)).answer()


def own_options(request: Request, *without: str) -> dict[str, Any]:
    """Return the backend's own options that go to its solver: those that have a value."""
    return {n: v for n, v in request.options.items() if n not in without and v is not None}


@dataclass(frozen=True, eq=False)
class _Run:
    backend: NonlinearBackend
    problem: NonlinearProgram
    request: Request
    clock: Clock

    def answer(self) -> Answer:
        known = stopped(self.request, self.clock)
        if known is not None:
            return self.judged(NonlinearOutcome(known.ended, limit=known.limit))
        start = self.start()
        if not (self.problem.column_lower < self.problem.column_upper).any():
            # No column is free, or there is none: nothing to search, and solvers refuse that.
            there = self.problem.verify(start, tolerance=self.request.tolerance).ok
            ended = Ended.PROVEN if there else Ended.INFEASIBLE
            return self.judged(NonlinearOutcome(ended, start, iterations=0))
        request = self.request
        if request.time_limit is not None:
            request = replace(request, time_limit=self.clock.left())
        return self.judged(self.backend.attempt(self.problem, request, self.clock, start))

    def start(self) -> Vector:
        """Return where the search begins."""
        if self.request.warm_start is None:
            return self.problem.start(self.request.seed)
        given = np.asarray(self.request.warm_start, float)
        start: Vector = np.clip(given, self.problem.column_lower, self.problem.column_upper)
        return start

    def judged(self, outcome: NonlinearOutcome) -> Answer:
        """Return the answer that `outcome` earns."""
        found = measured(
            self.problem, outcome.point, outcome.duals, self.request.tolerance, STATIONARY
        )
        self.clock.lap("judge")
        if outcome.ended is Ended.UNBOUNDED:
            return self.without(outcome, found, Termination.NO_SOLUTION, "its iterates run away")
        if found is None or not found.feasible:
            return self.kept(outcome, found) or self.infeasible(outcome, found)
        own = outcome.limit is Limit.ITERATIONS and not self.request.control.stopped
        if outcome.ended is Ended.STOPPED and not (
            own and found.stationarity <= CLEARLY_STATIONARY
        ):
            return self.having(outcome, found, Termination.FEASIBLE)
        if outcome.ended is Ended.PROVEN and found.stationarity <= STATIONARY:
            return self.having(replace(outcome, message=""), found, Termination.LOCALLY_OPTIMAL)
        if found.stationarity <= CLEARLY_STATIONARY:
            words = "yet its point is a local optimum"
            return self.having(outcome, found, Termination.LOCALLY_OPTIMAL, words)
        words = f"its point is feasible, with a stationarity of {found.stationarity:.2g}"
        return self.having(outcome, found, Termination.FEASIBLE, words)

    def infeasible(self, outcome: NonlinearOutcome, found: Quality | None) -> Answer:
        """Return the answer where the solver ended outside, or nowhere."""
        words = ""
        if found is not None:
            worst = worst_blocks(self.problem, found.point)
            words = f"violated most: {worst}" if worst else "violated: a column's bound"
        if outcome.ended is Ended.INFEASIBLE and not self.request.control.stopped:
            where = "no feasible point near where the search ended"
            return self.without(
                outcome, found, Termination.LOCALLY_INFEASIBLE, f"{where}; {words}".rstrip("; ")
            )
        if self.limit(outcome) is not None:
            return self.without(outcome, found, Termination.NO_SOLUTION, words)
        if outcome.ended is Ended.PROVEN:
            words = f"the solver calls its point an optimum; {words}".rstrip("; ")
        return self.without(outcome, found, Termination.FAILED, words)

    def kept(self, outcome: NonlinearOutcome, found: Quality | None) -> Answer | None:
        """Return the warm start where it is feasible and the search lost it, else None."""
        if self.request.warm_start is None:
            return None
        first = measured(self.problem, self.start(), None, self.request.tolerance, STATIONARY)
        if first is None or not first.feasible:
            return None
        words = "the warm start is all there is"
        return self.having(outcome, first, Termination.FEASIBLE, words)

    def limit(self, outcome: NonlinearOutcome) -> Limit | None:
        """Return the limit that ended the run: a stop asked for goes before the solver's word."""
        if outcome.ended is Ended.STOPPED or self.request.control.stopped:
            return limited(self.request.control, outcome.limit or Limit.INTERRUPTED)
        return None

    def having(
        self, outcome: NonlinearOutcome, found: Quality, kind: Termination, words: str = ""
    ) -> Answer:
        """Return an answer with a point."""
        optimal = kind is Termination.LOCALLY_OPTIMAL
        return replace(
            self.without(outcome, found, kind, words),
            limit=None if optimal else self.limit(outcome),
            point=found.point,
            primal_bound=found.objective,
            duals=found.duals,
        )

    def without(
        self, outcome: NonlinearOutcome, found: Quality | None, kind: Termination, words: str
    ) -> Answer:
        """Return an answer without a point."""
        counts: dict[str, float | int | str] = dict(outcome.statistics)
        if outcome.iterations is not None:
            counts["iterations"] = outcome.iterations
        if found is not None:
            counts["infeasibility"] = found.infeasibility
            if np.isfinite(found.stationarity):
                counts["stationarity"] = found.stationarity
        return Answer(
            kind,
            self.limit(outcome) if kind is Termination.NO_SOLUTION else None,
            seconds=self.clock.seconds,
            statistics=counts,
            message="; ".join(text for text in (outcome.message, words) if text),
        )
