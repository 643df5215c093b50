"""What every quadratic backend shares: a solver's claim is recomputed before it is an answer.

A backend here only translates: its ``attempt`` hands the program to its solver and reports how the
solver ended. An optimum is one when its point verifies and its multipliers prove the gap; an infeasible
or unbounded program is one when a ray proves it. What falls short is polished, then asked for once
more, and at last called what it is. A near miss is asked for with a tighter tolerance; what failed is
made strictly convex by a proximal term, for it is on flat objectives that solvers stumble.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ...models.model import Model
from ...models.programs.base import RowProgram
from ...models.programs.linear import QuadraticProgram
from ..attempts import (
    Clock,
    Ended,
    Outcome,
    above_cutoff,
    allowed,
    holds,
    limited,
    obvious,
    solver_tolerance,
    stopped,
)
from ..backend import Answer, Backend, Feature, Guarantee, Limit, Option, Request, Termination
from .forms import ConicForm, Core
from .polishing import polished
from .proofs import Findings, examined
from .quality import Quality, measured

__all__ = [
    "COMMON",
    "POLISH",
    "Attempt",
    "QuadraticBackend",
    "QuadraticOutcome",
    "Run",
    "answered",
    "certified",
    "dense_memory",
    "first_order_precision",
    "own_options",
]

Vector = NDArray[np.float64]

#: How much tighter a second attempt is asked to be.
TIGHTER = 1e-3
#: Weights of the proximal terms that a second and third attempt add, relative to the curvature.
PROXIMAL = (1e-2, 1e-1)
#: Merit above which an answer is no near miss, and violation above which a claimed optimum looks
#: like the least evil of an infeasible program.
GROSS = 1e-3

#: What every quadratic backend that proves its optima declares.
COMMON = frozenset({Feature.GAP, Feature.DUAL_BOUND, Feature.DUALS})

#: The option that every quadratic backend has.
POLISH = Option(
    True,
    "Whether to make the answer exact by solving the equations of what binds; off shows the "
    "solver's own precision.",
    bool,
)


@dataclass(frozen=True)
class QuadraticOutcome(Outcome):
    """What a solver of quadratic programs reports of one run.

    Parameters
    ----------
    ray : ndarray, optional
        Row multipliers that should prove the program infeasible.
    direction : ndarray, optional
        A direction along which the objective should fall forever.
    """

    ray: Vector | None = None
    direction: Vector | None = None


Attempt = Callable[[QuadraticProgram, Request, Clock], Outcome]


class QuadraticBackend(Backend):
    """Base of the backends that solve a convex :class:`QuadraticProgram` to proven optimality."""

    accepts: ClassVar[type[Model[Any]] | tuple[type[Model[Any]], ...]] = QuadraticProgram
    guarantee = Guarantee.EXACT
    features = COMMON
    single_threaded = True
    extra = "qp"

    @abstractmethod
    def attempt(self, program: QuadraticProgram, request: Request, clock: Clock) -> Outcome:
        """Hand `program` to the solver once and report how it ended.

        The program has columns that are not fixed, and only rows with entries and a bound. Laps
        of `clock` are called ``"build"`` (until the solver starts) and ``"solve"``.
        """

    def run(self, problem: QuadraticProgram, request: Request) -> Answer:
        """Solve `problem` as `request` asks."""
        self.require()
        reason = self.refuses(problem)
        if reason:
            raise UnsupportedFormulation(reason)
        return answered(problem, request, self.attempt)


def own_options(request: Request, *without: str) -> dict[str, Any]:
    """Return the backend's own options that go to its solver: those that have a value."""
    skip = {"polish", *without}
    return {name: v for name, v in request.options.items() if name not in skip and v is not None}


def first_order_precision(request: Request) -> float:
    """Return the precision to ask of a first-order method.

    Its last digits take most of its iterations, and the polish finds them in one system.
    """
    share = 1.0 if request.options.get("polish", True) else 1e-2
    return solver_tolerance(request.tolerance * share, 1e-11, 1e-6)


def certified(
    program: RowProgram,
    form: ConicForm,
    x: Any,
    z: Any,
    ended: Ended,
    limit: Limit | None,
    iterations: int,
    message: str,
) -> QuadraticOutcome:
    """Return the outcome of a conic solver: what it calls its solution may be a certificate."""
    point, duals = np.array(x, float), form.duals(z, program.row_count)
    solution = ended not in (Ended.INFEASIBLE, Ended.UNBOUNDED)
    return QuadraticOutcome(
        ended,
        point if solution else None,
        None,
        duals if solution else None,
        limit,
        {"iterations": iterations},
        message,
        ray=duals if ended is Ended.INFEASIBLE else None,
        direction=point if ended is Ended.UNBOUNDED else None,
    )


def answered(problem: QuadraticProgram, request: Request, attempt: Attempt) -> Answer:
    """Return the answer that `attempt` earns: recomputed, polished, proven."""
    return Run(problem, request, attempt, Clock(request.time_limit)).answer()


@dataclass(frozen=True, eq=False)
class Run:
    """One run: attempts, and what their answers prove."""

    problem: QuadraticProgram
    request: Request
    attempt: Attempt
    clock: Clock

    def answer(self) -> Answer:
        known = obvious(self.problem, self.request) or stopped(self.request, self.clock)
        if known is not None:
            if known.ended is Ended.PROVEN:
                best = measured(self.problem, np.zeros(0), known.duals)
                assert best is not None
                return self.optimal(known, best)
            return self.unsolved(known, None)
        core = self.core()
        outcome = self.tried(core, self.request)
        best = self.judged(outcome)
        if best is not None and self.accepts(best):
            return self.optimal(outcome, best)
        findings = Findings()
        if outcome.ended is not Ended.STOPPED or outcome.limit is Limit.ITERATIONS:
            if not self.over() and (best is None or best.violation > GROSS):
                # So far off, or called unsolvable: a proof settles it, and where there is none
                # the claim was wrong.
                findings = self.findings(outcome, None)
            if not (findings.infeasible or findings.unbounded):
                for posed, request in self.further(core, best, findings):
                    if self.over():
                        break
                    again = self.tried(posed, request)
                    outcome = _summed(outcome, again)
                    better = self.judged(again)
                    if better is not None and (best is None or better.merit < best.merit):
                        best = better
                    if best is not None and self.accepts(best):
                        return self.optimal(outcome, best)
        return self.unsolved(outcome, best, findings)

    def core(self) -> Core:
        """Return what of the program the solver gets."""
        return Core.of(self.problem)

    def tried(self, core: Core, request: Request) -> QuadraticOutcome:
        """Return what the solver says of the whole program, given its core."""
        if not core.program.size:
            # Every column is fixed: what rows say of them is left to the verification.
            found: Outcome = Outcome(Ended.PROVEN, np.zeros(0), duals=np.zeros(core.rows.size))
        else:
            if request.warm_start is not None:
                start = np.asarray(request.warm_start, float)[core.columns]
                request = replace(request, warm_start=start)
            if request.time_limit is not None:
                request = replace(request, time_limit=self.clock.left())
            found = self.attempt(core.program, request, self.clock)
        ray = direction = None
        if isinstance(found, QuadraticOutcome):
            ray, direction = core.duals(found.ray), core.direction(found.direction)
        return QuadraticOutcome(
            found.ended,
            core.point(found.point),
            None,
            core.duals(found.duals),
            found.limit,
            found.statistics,
            found.message,
            ray=ray,
            direction=direction,
        )

    @staticmethod
    def claims_point(outcome: Outcome) -> bool:
        """Whether the solver is through and says that its point is an optimum, or nearly one."""
        if outcome.ended is Ended.STOPPED:
            return outcome.limit is Limit.ITERATIONS
        return outcome.ended in (Ended.PROVEN, Ended.FAILED)

    def judged(self, outcome: Outcome) -> Quality | None:
        """Return the quality of the point, polished where that is due; None without a point."""
        if outcome.point is None or outcome.ended in (Ended.INFEASIBLE, Ended.UNBOUNDED):
            return None
        found = measured(self.problem, outcome.point, outcome.duals)
        if found is None or found.clean or not self.request.options.get("polish", True):
            return found
        if self.claims_point(outcome) and not self.over():
            found = polished(self.problem, found, self.over)
            self.clock.lap("polish")
        return found

    def over(self) -> bool:
        """Whether the run may not go on."""
        return self.request.control.stopped or self.clock.left() == 0.0

    def accepts(self, quality: Quality) -> bool:
        return quality.proves(self.request.gap, self.request.tolerance)

    def further(
        self, core: Core, best: Quality | None, findings: Findings
    ) -> Iterator[tuple[Core, Request]]:
        """Yield what to try after a first attempt that was not good enough."""
        if best is not None and best.merit <= GROSS:
            tolerance = self.request.tolerance * TIGHTER
            yield core, replace(self.request, tolerance=tolerance, warm_start=best.point)
            return
        yield core.proximal(findings.point, PROXIMAL[0]), self.request
        yield core.proximal(None if best is None else best.point, PROXIMAL[1]), self.request

    def optimal(self, outcome: Outcome, best: Quality) -> Answer:
        """Return the optimum, held against the cutoff."""
        objective = best.objective
        if outcome.ended is not Ended.PROVEN and outcome.message:
            outcome = replace(outcome, message=f"{outcome.message}; yet its point proved optimal")
        # Rounding may leave the bound just above.
        answer = self.basic(outcome, best, Termination.OPTIMAL, min(best.bound, objective))
        cutoff = self.request.cutoff
        if cutoff is not None and objective > allowed(cutoff):
            return above_cutoff(answer, cutoff)
        return answer

    def unsolved(
        self, outcome: Outcome, best: Quality | None, findings: Findings | None = None
    ) -> Answer:
        """Return what is known where no optimum is proven."""
        if outcome.ended is Ended.INFEASIBLE and outcome.absolute:
            return self.basic(outcome, None, Termination.INFEASIBLE)
        feasible = best is not None and best.violation <= self.request.tolerance
        interrupted = outcome.ended is Ended.STOPPED and outcome.limit is not Limit.ITERATIONS
        findings = findings or Findings()
        if not (findings.source or findings.examined or interrupted or self.over()):
            findings = self.findings(outcome, best if feasible else None)
        if findings.infeasible or findings.unbounded:
            kind = Termination.INFEASIBLE if findings.infeasible else Termination.UNBOUNDED
            counts = {**outcome.statistics, "proof": findings.source}
            return self.basic(replace(outcome, statistics=counts, message=""), None, kind)
        best = self.kept(best if feasible else None) or best
        feasible = best is not None and best.violation <= self.request.tolerance
        limit = outcome.limit
        if limit in (None, Limit.ITERATIONS) and self.over():
            limit = limited(self.request.control, Limit.TIME)
        if best is not None and feasible:
            bound = min(best.bound, best.objective)
            answer = self.basic(outcome, best, Termination.FEASIBLE, bound)
            return replace(answer, limit=limit, message=_joined(answer, best))
        kind = Termination.NO_SOLUTION if limit is not None else Termination.FAILED
        answer = self.basic(outcome, None, kind)
        return replace(answer, limit=limit, message=_joined(answer, best, outcome.ended, findings))

    def findings(self, outcome: Outcome, feasible: Quality | None) -> Findings:
        ray = direction = None
        if isinstance(outcome, QuadraticOutcome):
            ray, direction = outcome.ray, outcome.direction
        found = examined(
            self.problem,
            ray=ray,
            direction=direction,
            point=None if feasible is None else feasible.point,
            left=self.clock.left,
        )
        self.clock.lap("proof")
        return found

    def kept(self, best: Quality | None) -> Quality | None:
        """Return the better of `best` and the warm start, which must not be lost."""
        start = self.request.warm_start
        if start is None or not holds(
            self.problem, np.asarray(start, float), self.request.tolerance
        ):
            return best
        first = measured(self.problem, np.asarray(start, float), None)
        if first is None or (best is not None and best.objective <= first.objective):
            return best
        return first

    def basic(
        self, outcome: Outcome, best: Quality | None, kind: Termination, bound: float | None = None
    ) -> Answer:
        return Answer(
            termination=kind,
            point=None if best is None else best.point,
            primal_bound=None if best is None else best.objective,
            dual_bound=bound if bound is not None and np.isfinite(bound) else None,
            duals=None if best is None else best.duals,
            seconds=self.clock.seconds,
            statistics=outcome.statistics,
            message=outcome.message,
        )


def _joined(
    answer: Answer,
    best: Quality | None,
    ended: Ended | None = None,
    findings: Findings | None = None,
) -> str:
    parts = [answer.message]
    if ended in (Ended.INFEASIBLE, Ended.UNBOUNDED, Ended.UNCLEAR):
        parts.append(f"the solver calls it {ended}, which nothing proves")
    if best is not None:
        parts.append(best.describe())
    if findings is not None and findings.violation:
        parts.append(f"the least sum of violations is {findings.violation:.2g}")
    return "; ".join(part for part in parts if part)


def _summed(first: QuadraticOutcome, second: QuadraticOutcome) -> QuadraticOutcome:
    """Return `second` with the counts of all attempts."""
    counts: dict[str, float | int | str] = dict(second.statistics)
    for name, value in first.statistics.items():
        other = counts.get(name, 0)
        if isinstance(value, int | float) and isinstance(other, int | float):
            counts[name] = value + other
    counts["attempts"] = 1 + int(first.statistics.get("attempts", 1))
    if second.point is None and second.ended is Ended.STOPPED:
        return replace(first, statistics=counts, limit=second.limit)
    return replace(second, statistics=counts)


def dense_memory(program: QuadraticProgram, rows: int) -> float:
    """Return the gigabytes that dense copies of the Hessian and of `rows` rows take, twice each."""
    return 16.0 * program.size * (program.size + rows) / 1e9
