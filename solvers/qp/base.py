"""Base of the backends for quadratic programs: a solver's claim is recomputed before it is an answer.

A backend only translates: its ``attempt`` passes the program to its solver and reports the ending. An
optimum must verify, and its multipliers must prove the gap. Infeasible and unbounded programs need a
ray as a proof. An answer that falls short is polished, then computed again. A near miss is computed
with a tighter tolerance. After a failure, a proximal term makes the program strictly convex, because
solvers fail mostly on flat objectives. If nothing helps, the answer is weakened.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ...models.model import Model
from ...models.programs.linear import QuadraticProgram
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
from ..contract.job import UNPOLISHED
from ..contract.registry import integrality_refusal
from ..programs.attempts import (
    Clock,
    Ended,
    Ending,
    above_cutoff,
    ending_if_stopped,
    is_satisfied,
    limit_reached,
    loosened_cutoff,
    stop_reason,
    trivial_ending,
)
from ..programs.scaling import Scaling
from .forms import Core
from .polishing import polished
from .proofs import Findings, examined
from .quality import Quality, measured
from .settings import POLISH

__all__ = [
    "COMMON",
    "UNPOLISHED",
    "QuadraticBackend",
    "Run",
    "answered",
]

Vector = NDArray[np.float64]

#: Factor of the tolerance of a second attempt.
TIGHTER = 1e-3
#: Weights of the proximal terms of a second and third attempt, relative to the curvature.
PROXIMAL = (1e-2, 1e-1)
#: Largest merit of a near miss, and largest violation of a claimed optimum before the program is
#: examined for infeasibility.
GROSS = 1e-3

#: Features of every quadratic backend that proves its optima.
COMMON = frozenset({Feature.GAP, Feature.DUAL_BOUND, Feature.DUALS})

Attempt = Callable[[QuadraticProgram, Request, Clock], Ending]


class QuadraticBackend(Backend):
    """Base of the backends that solve convex quadratic programs to proven optimality."""

    accepts: ClassVar[type[Model[Any]] | tuple[type[Model[Any]], ...]] = QuadraticProgram
    guarantee = Guarantee.EXACT
    features = COMMON
    single_threaded = True
    options: ClassVar[Mapping[str, Option]] = {"polish": POLISH}

    def comparison_options(self, kind: type[Model[Any]]) -> Mapping[str, Any]:
        return UNPOLISHED

    @abstractmethod
    def attempt(self, program: QuadraticProgram, request: Request, clock: Clock) -> Ending:
        """Solve `program` once and report the ending.

        Parameters
        ----------
        program : QuadraticProgram
            A program without fixed columns, in which every row has entries and a finite bound.
        request : Request
            Options of the run.
        clock : Clock
            Clock of the run; counts ``"build"`` until the solver starts, then ``"solve"``.

        Returns
        -------
        Ending
            The ending as the solver reports it, which is recomputed afterwards.
        """

    def run(self, problem: QuadraticProgram, request: Request) -> Answer:
        """Solve `problem`, see :meth:`Backend.run`."""
        return answered(self, problem, request, self.attempt)


def answered(
    backend: Backend, problem: Any, request: Request, attempt: Any, run: type[Run] | None = None
) -> Answer:
    """Run `attempt` for `backend` and return the answer: recomputed, polished and proven.

    `attempt` is a function ``(program, request, clock) -> Ending``, and `run` the class of the run, by default
    :class:`Run`. UnsupportedFormulation: the backend rejects the program.
    """
    backend.require()
    reason = integrality_refusal(problem, backend) or backend.refuses(problem)
    if reason:
        raise UnsupportedFormulation(reason)
    request = replace(request, options=backend.checked_options(request.options))
    kind = run or Run

    def solve_posed(posed: QuadraticProgram, posed_request: Request) -> Answer:
        return kind(posed, posed_request, attempt, Clock(posed_request.time_limit)).answer()

    scale = Scaling.of if type(problem) is QuadraticProgram else Scaling.of_objective
    scaling = scale(problem)
    return (
        solve_posed(problem, request) if scaling is None else scaling.answered(request, solve_posed)
    )


@dataclass(frozen=True, eq=False)
class Run:
    """Run of a backend: attempts (functions ``(program, request, clock) -> Ending``) and proofs of their answers."""

    problem: QuadraticProgram
    request: Request
    attempt: Attempt
    clock: Clock

    def answer(self) -> Answer:
        known = trivial_ending(self.problem, self.request) or ending_if_stopped(
            self.request, self.clock
        )
        if known is not None:
            if known.ended is Ended.PROVEN:
                best = measured(self.problem, np.zeros(0), known.duals)
                assert best is not None
                return self.optimal(known, best)
            return self.unsolved(known, None)
        core = self.core()
        ending = self.tried(core, self.request)
        best = self.judged(ending)
        if best is not None and self.accepts(best):
            return self.optimal(ending, best)
        findings = Findings()
        if ending.ended is not Ended.STOPPED or ending.limit is Limit.ITERATIONS:
            if not self.limit_reached() and (best is None or best.violation > GROSS):
                # A point this far off, or a claim of no solution, needs a proof. Without one, the
                # claim was wrong.
                findings = self.findings(ending, None)
            if not (findings.infeasible or findings.unbounded):
                for posed, request in self.further(core, best, findings):
                    if self.limit_reached():
                        break
                    again = self.tried(posed, request)
                    ending = _summed(ending, again)
                    better = self.judged(again)
                    if better is not None and (best is None or better.merit < best.merit):
                        best = better
                    if best is not None and self.accepts(best):
                        return self.optimal(ending, best)
        return self.unsolved(ending, best, findings)

    def core(self) -> Core:
        """Return the part of the program that the solver receives."""
        return Core.of(self.problem)

    def tried(self, core: Core, request: Request) -> Ending:
        """Run the solver on a core and return its ending in terms of the whole program."""
        if not core.program.size:
            # Every column is fixed; verification checks the rows.
            return Ending(Ended.PROVEN, core.point(np.zeros(0)), duals=core.duals(np.zeros(0)))
        if request.warm_start is not None:
            start = np.asarray(request.warm_start, float)[core.columns]
            request = replace(request, warm_start=start)
        if request.time_limit is not None:
            request = replace(request, time_limit=self.clock.left())
        ending = self.attempt(core.program, request, self.clock)
        point = core.direction if ending.ended is Ended.UNBOUNDED else core.point
        return replace(
            ending, point=point(ending.point), bound=None, duals=core.duals(ending.duals)
        )

    def judged(self, ending: Ending) -> Quality | None:
        """Return the quality of the point, polished if necessary; None without a point."""
        if ending.point is None or ending.ended in (Ended.INFEASIBLE, Ended.UNBOUNDED):
            return None
        quality = measured(self.problem, ending.point, ending.duals)
        if quality is None or quality.clean or not self.request.options["polish"]:
            return quality
        # The solver has finished, or nearly, so that its point is close to an optimum.
        is_finished = ending.ended is not Ended.STOPPED or ending.limit is Limit.ITERATIONS
        if is_finished and ending.ended is not Ended.UNCLEAR and not self.limit_reached():
            quality = polished(self.problem, quality, self.limit_reached)
            self.clock.lap("polish")
        return quality

    def limit_reached(self) -> bool:
        """Return True if the run must stop."""
        return limit_reached(self.request, self.clock) is not None

    def accepts(self, quality: Quality) -> bool:
        return quality.proves(self.request.gap, self.request.tolerance)

    def further(
        self, core: Core, best: Quality | None, findings: Findings
    ) -> Iterator[tuple[Core, Request]]:
        """Yield cores and requests for further attempts after an insufficient answer."""
        if best is not None and best.merit <= GROSS:
            tolerance = self.request.tolerance * TIGHTER
            yield core, replace(self.request, tolerance=tolerance, warm_start=best.point)
            return
        yield core.proximal(findings.point, PROXIMAL[0]), self.request
        yield core.proximal(None if best is None else best.point, PROXIMAL[1]), self.request

    def optimal(self, ending: Ending, best: Quality) -> Answer:
        """Return the optimum, or the dual bound if it is worse than the cutoff."""
        objective = best.objective
        if ending.ended is not Ended.PROVEN and ending.message:
            ending = replace(ending, message=f"{ending.message}; yet its point proved optimal")
        # Rounding may put the bound slightly above the objective.
        answer = self.basic(ending, best, Termination.OPTIMAL, min(best.bound, objective))
        cutoff = self.request.cutoff
        if cutoff is not None and objective > loosened_cutoff(cutoff):
            return above_cutoff(answer, cutoff)
        return answer

    def unsolved(
        self, ending: Ending, best: Quality | None, findings: Findings | None = None
    ) -> Answer:
        """Return what is known if no optimum is proven."""
        if ending.ended is Ended.INFEASIBLE and ending.absolute:
            return self.basic(ending, None, Termination.INFEASIBLE)
        feasible = best is not None and best.violation <= self.request.tolerance
        interrupted = ending.ended is Ended.STOPPED and ending.limit is not Limit.ITERATIONS
        findings = findings or Findings()
        if not (findings.source or findings.examined or interrupted or self.limit_reached()):
            findings = self.findings(ending, best if feasible else None)
        if findings.infeasible or findings.unbounded:
            kind = Termination.INFEASIBLE if findings.infeasible else Termination.UNBOUNDED
            counts = {**ending.statistics, "proof": findings.source}
            return self.basic(replace(ending, statistics=counts, message=""), None, kind)
        best = self.kept(best if feasible else None) or best
        feasible = best is not None and best.violation <= self.request.tolerance
        limit = ending.limit
        if limit in (None, Limit.ITERATIONS) and self.limit_reached():
            limit = stop_reason(self.request.control, Limit.TIME)
        if best is not None and feasible:
            bound = min(best.bound, best.objective)
            answer = self.basic(ending, best, Termination.FEASIBLE, bound)
            return replace(answer, limit=limit, message=_joined(answer, best))
        kind = Termination.NO_SOLUTION if limit is not None else Termination.FAILED
        answer = self.basic(ending, None, kind)
        return replace(answer, limit=limit, message=_joined(answer, best, ending.ended, findings))

    def findings(self, ending: Ending, feasible: Quality | None) -> Findings:
        result = examined(
            self.problem,
            ray=ending.duals if ending.ended is Ended.INFEASIBLE else None,
            direction=ending.point if ending.ended is Ended.UNBOUNDED else None,
            point=None if feasible is None else feasible.point,
            left=self.clock.left,
        )
        self.clock.lap("proof")
        return result

    def kept(self, best: Quality | None) -> Quality | None:
        """Return the better of `best` and the warm start, which must not be lost."""
        start = self.request.warm_start
        if start is None or not is_satisfied(
            self.problem, np.asarray(start, float), self.request.tolerance
        ):
            return best
        first = measured(self.problem, np.asarray(start, float), None)
        if first is None or (best is not None and best.objective <= first.objective):
            return best
        return first

    def basic(
        self, ending: Ending, best: Quality | None, kind: Termination, bound: float | None = None
    ) -> Answer:
        polished = best is not None and best.polished
        return Answer(
            termination=kind,
            point=None if best is None else best.point,
            primal_bound=None if best is None else best.objective,
            dual_bound=bound if bound is not None and np.isfinite(bound) else None,
            duals=None if best is None else best.duals,
            seconds=self.clock.seconds,
            statistics={**ending.statistics, "polished": "yes" if polished else "no"},
            message=ending.message,
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


def _summed(first: Ending, second: Ending) -> Ending:
    """Return `second` with the counts of all attempts added."""
    counts: dict[str, float | int | str] = dict(second.statistics)
    for name, value in first.statistics.items():
        other = counts.get(name, 0)
        if isinstance(value, int | float) and isinstance(other, int | float):
            counts[name] = value + other
    counts["attempts"] = 1 + int(first.statistics.get("attempts", 1))
    if second.point is None and second.ended is Ended.STOPPED:
        return replace(first, statistics=counts, limit=second.limit)
    return replace(second, statistics=counts)
