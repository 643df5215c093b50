"""What every quadratic backend shares: a solver's claim is recomputed before it is an answer.

A backend here only translates: its ``attempt`` hands the program to its solver and reports how the
solver ended. An optimum is one when its point verifies and its multipliers prove the gap; an infeasible
or unbounded program is one when a ray proves it. What falls short is polished, then asked for once
more, and at last called what it is. A near miss is asked for with a tighter tolerance; what failed is
made strictly convex by a proximal term, for it is on flat objectives that solvers stumble.
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
from ..attempts import (
    Clock,
    Ended,
    Ending,
    above_cutoff,
    ending_if_stopped,
    is_satisfied,
    limit_reached,
    loosened_cutoff,
    solver_tolerance,
    stop_reason,
    trivial_ending,
)
from ..backend import Answer, Backend, Feature, Guarantee, Limit, Option, Request, Termination
from ..job import UNPOLISHED
from ..scaling import Scaling
from .forms import Core
from .polishing import polished
from .proofs import Findings, examined
from .quality import Quality, measured

__all__ = [
    "COMMON",
    "EPS",
    "LINEAR_ALGEBRA",
    "POLISH",
    "UNPOLISHED",
    "QuadraticBackend",
    "Run",
    "answered",
    "first_order_precision",
    "pause",
    "prefers_dense",
    "told",
    "too_large",
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

#: The option that every quadratic backend has, and what a comparison makes of it.
POLISH = Option(
    True,
    "Whether to make the answer to a quadratic program exact by solving the equations of what "
    "binds; off shows the solver's own precision, and is what comparisons set.",
    bool,
)
#: The option of first-order methods.
EPS = Option(
    None,
    "Absolute and relative precision; by default a tenth of the tolerance, which the polish does "
    "the rest for, or a thousandth without it.",
    float,
    lower=1e-15,
    upper=1.0,
)
#: The option of solvers that have both kinds of factors.
LINEAR_ALGEBRA = Option(
    "choose",
    "Dense or sparse factors; by the share of entries by default.",
    str,
    ("choose", "dense", "sparse"),
)
#: Share of entries that are not zero, above which dense factors are faster.
DENSE = 0.1
#: Gigabytes of dense data above which a dense solver is refused.
MEMORY = 2.0
#: Seconds of a solve that goes on from where it paused.
SLICE = 0.5

_EPS = ("eps_abs", "eps_rel")
#: How the libraries over many solvers tell each its time limit and its tolerances; one that is not
#: among these, or has no time limit, runs as it is by default and is stopped with its process.
_TOLD: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "clarabel": ("time_limit", ("tol_feas", "tol_gap_abs", "tol_gap_rel")),
    "daqp": ("", ("primal_tol", "dual_tol")),
    "ecos": ("", ("abstol", "reltol", "feastol")),
    "highs": ("time_limit", ("primal_feasibility_tolerance", "dual_feasibility_tolerance")),
    "osqp": ("time_limit", _EPS),
    "piqp": ("", _EPS),
    "proxqp": ("", _EPS),
    "scs": ("time_limit_secs", _EPS),
}
#: First-order methods need more iterations than their defaults allow.
_MORE: Mapping[str, Mapping[str, Any]] = {
    "osqp": {"max_iter": 200_000},
    "scs": {"max_iters": 200_000},
}

Attempt = Callable[[QuadraticProgram, Request, Clock], Ending]


class QuadraticBackend(Backend):
    """Base of the backends that solve a convex :class:`QuadraticProgram` to proven optimality."""

    accepts: ClassVar[type[Model[Any]] | tuple[type[Model[Any]], ...]] = QuadraticProgram
    guarantee = Guarantee.EXACT
    features = COMMON
    single_threaded = True
    options: ClassVar[Mapping[str, Option]] = {"polish": POLISH}

    def comparison_options(self, kind: type[Model[Any]]) -> Mapping[str, Any]:
        return UNPOLISHED

    @abstractmethod
    def attempt(self, program: QuadraticProgram, request: Request, clock: Clock) -> Ending:
        """Hand `program` to the solver once and report how it ended.

        The program has columns that are not fixed, and only rows with entries and a bound. Laps
        of `clock` are called ``"build"`` (until the solver starts) and ``"solve"``.
        """

    def run(self, problem: QuadraticProgram, request: Request) -> Answer:
        """Solve `problem` as `request` asks."""
        return answered(self, problem, request, self.attempt)


def first_order_precision(request: Request) -> float:
    """Return the precision to ask of a first-order method: its option, else by the tolerance.

    Its last digits take most of its iterations, and the polish finds them in one system.
    """
    share = 1.0 if request.options["polish"] else 1e-2
    return request.options.get("eps") or solver_tolerance(request.tolerance * share, 1e-11, 1e-6)


def pause(clock: Clock) -> float:
    """Return the seconds after which a solver without a callback pauses, so that a stop is heard."""
    left = clock.left()
    return SLICE if left is None else max(min(SLICE, left), 1e-3)


def prefers_dense(program: QuadraticProgram, request: Request, largest: int) -> bool:
    """Return whether dense factors are asked for, or are faster up to `largest` rows and columns."""
    asked = request.options["linear_algebra"]
    if asked != "choose":
        return bool(asked == "dense")
    size, total = program.size, program.size + program.row_count
    filled = program.hessian.nnz + program.matrix.nnz
    return total <= largest and (total <= 50 or filled > DENSE * size * total)


def answered(
    backend: Backend, problem: Any, request: Request, attempt: Any, run: type[Run] | None = None
) -> Answer:
    """Return the answer that `attempt` earns `backend` by a `run`: recomputed, polished, proven."""
    backend.require()
    reason = backend.refuses(problem)
    if reason:
        raise UnsupportedFormulation(reason)
    request = replace(request, options=backend.checked_options(request.options))
    kind = run or Run

    def solved(posed: QuadraticProgram, asked: Request) -> Answer:
        return kind(posed, asked, attempt, Clock(asked.time_limit)).answer()

    scaling = Scaling.of(problem) if type(problem) is QuadraticProgram else None
    return solved(problem, request) if scaling is None else scaling.answered(request, solved)


@dataclass(frozen=True, eq=False)
class Run:
    """One run: attempts, and what their answers prove."""

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
                # So far off, or called unsolvable: a proof settles it, and where there is none
                # the claim was wrong.
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
        """Return what of the program the solver gets."""
        return Core.of(self.problem)

    def tried(self, core: Core, request: Request) -> Ending:
        """Return what the solver says of the whole program, given its core."""
        if not core.program.size:
            # Every column is fixed: what rows say of them is left to the verification.
            return Ending(Ended.PROVEN, core.point(np.zeros(0)), duals=core.duals(np.zeros(0)))
        if request.warm_start is not None:
            start = np.asarray(request.warm_start, float)[core.columns]
            request = replace(request, warm_start=start)
        if request.time_limit is not None:
            request = replace(request, time_limit=self.clock.left())
        found = self.attempt(core.program, request, self.clock)
        point = core.direction if found.ended is Ended.UNBOUNDED else core.point
        return replace(found, point=point(found.point), bound=None, duals=core.duals(found.duals))

    def judged(self, ending: Ending) -> Quality | None:
        """Return the quality of the point, polished where that is due; None without a point."""
        if ending.point is None or ending.ended in (Ended.INFEASIBLE, Ended.UNBOUNDED):
            return None
        found = measured(self.problem, ending.point, ending.duals)
        if found is None or found.clean or not self.request.options["polish"]:
            return found
        # Through, and its point is an optimum by its own word, or nearly one.
        through = ending.ended is not Ended.STOPPED or ending.limit is Limit.ITERATIONS
        if through and ending.ended is not Ended.UNCLEAR and not self.limit_reached():
            found = polished(self.problem, found, self.limit_reached)
            self.clock.lap("polish")
        return found

    def limit_reached(self) -> bool:
        """Whether the run may not go on."""
        return limit_reached(self.request, self.clock) is not None

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

    def optimal(self, ending: Ending, best: Quality) -> Answer:
        """Return the optimum, held against the cutoff."""
        objective = best.objective
        if ending.ended is not Ended.PROVEN and ending.message:
            ending = replace(ending, message=f"{ending.message}; yet its point proved optimal")
        # Rounding may leave the bound just above.
        answer = self.basic(ending, best, Termination.OPTIMAL, min(best.bound, objective))
        cutoff = self.request.cutoff
        if cutoff is not None and objective > loosened_cutoff(cutoff):
            return above_cutoff(answer, cutoff)
        return answer

    def unsolved(
        self, ending: Ending, best: Quality | None, findings: Findings | None = None
    ) -> Answer:
        """Return what is known where no optimum is proven."""
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
        found = examined(
            self.problem,
            ray=ending.duals if ending.ended is Ended.INFEASIBLE else None,
            direction=ending.point if ending.ended is Ended.UNBOUNDED else None,
            point=None if feasible is None else feasible.point,
            left=self.clock.left,
        )
        self.clock.lap("proof")
        return found

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


def told(solver: str, request: Request) -> tuple[str, dict[str, Any]]:
    """Return what `solver` calls its time limit, empty for none, and its options for `request`."""
    time_name, tolerances = _TOLD.get(solver, ("", ()))
    tolerance = solver_tolerance(request.tolerance * 1e-2, 1e-10, 1e-8)
    return time_name, {**dict.fromkeys(tolerances, tolerance), **_MORE.get(solver, {})}


def too_large(owner: str, program: QuadraticProgram, rows: int | None = None) -> str:
    """Return why `owner`, which makes dense copies of `rows` rows, does not take `program`, else ``""``."""
    # The Hessian and the rows, twice each.
    count = program.row_count if rows is None else rows
    needed = 16.0 * program.size * (program.size + count) / 1e9
    if needed <= MEMORY:
        return ""
    return (
        f"{owner} is dense: {program.row_count} rows and {program.size} columns would take "
        f"{needed:.1f} GB, and it stops at {MEMORY:g} GB"
    )
