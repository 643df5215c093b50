"""Programs that grow: two strategies for models that ask for more than rows can say.

A formulation whose programs are relaxations is tightened: rows are added where its solution breaks
the model, and every bound of every program holds for the model. One whose programs are
approximations is refined: each solution says where the next mesh must be finer, and nothing is
proven.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..errors import InvalidData
from ..jit import clock
from .backend import Answer, Request
from .confirmation import confirm
from .enums import PROVING, Feature, Limit, Termination
from .job import Target
from .looking import SECOND, look_again
from .running import Run

__all__ = ["CLAIMS_NONE", "CLAIMS_PLAN", "proven_bound", "proves", "refine"]

CLAIMS_PLAN = (Termination.OPTIMAL, Termination.LOCALLY_OPTIMAL, Termination.FEASIBLE)
CLAIMS_NONE = (Termination.INFEASIBLE, Termination.UNBOUNDED)


def proves(target: Target) -> bool:
    """Return whether bounds and infeasibility of the program hold for the model, if they are right."""
    relaxes = target.formulation is None or target.formulation.relaxes
    return target.backend.guarantee in PROVING and relaxes


def proven_bound(problem: Any, answer: Answer) -> float | None:
    """Return the lower bound that an answer proves: of its multipliers, else as it is claimed."""
    if answer.duals is not None and answer.point is not None:
        # Imported here: it loads SciPy, which a native algorithm on a small problem does without.
        from ..models.programs.base import Program

        if isinstance(problem, Program):
            bound = problem.dual_bound(answer.duals, answer.point)
            if np.isfinite(bound):
                return bound
    return answer.dual_bound


@dataclass
class _Totals:
    """Seconds and counts of all programs solved so far."""

    seconds: dict[str, float] = field(default_factory=dict)
    counts: dict[str, Any] = field(default_factory=dict)
    rounds: int = -1

    def add(self, answer: Answer) -> None:
        self.rounds += 1
        for part, seconds in answer.seconds.items():
            self.seconds[part] = self.seconds.get(part, 0.0) + seconds
        for name, count in answer.statistics.items():
            # Counts add up; what is measured, a residual say, is the last one's.
            former = self.counts.get(name, 0)
            whole = isinstance(count, int) and isinstance(former, int)
            self.counts[name] = count + former if whole else count

    def on(self, answer: Answer) -> Answer:
        """Return `answer` with the seconds and counts of all rounds."""
        if not self.rounds:
            return answer
        counts = {**answer.statistics, **self.counts, "refinements": self.rounds}
        return replace(answer, seconds=self.seconds, statistics=counts)


def refine(run: Run, problem: Any, request: Request) -> tuple[Answer, Any]:
    """Run the backend, and again on refined programs until the formulation is content.

    Returns
    -------
    Answer, object
        The last answer, its seconds and counts summed over all programs, and the program answered.
    """
    totals = _Totals()
    deadline = None if request.time_limit is None else clock() + request.time_limit

    def attend(program: Any, asked: Request) -> Answer:
        begin = clock()
        answer = run.attend(program, asked)
        run.spent.append(clock() - begin)
        totals.add(answer)
        return answer

    def left() -> float | None:
        if deadline is None:
            return None
        return min(deadline - clock(), run.limit.end - time.perf_counter())

    answer = attend(problem, request)
    formulation = run.target.formulation
    if formulation is not None and answer.point is not None:
        answer, problem = look_again(run, problem, request, answer, left())
        if SECOND in answer.statistics:
            totals.counts[SECOND] = answer.statistics[SECOND]
        strategy = _tighten if formulation.relaxes else _approximate
        answer, problem = strategy(run, problem, request, answer, attend, left)
    return totals.on(answer), problem


Attend = Callable[[Any, Request], Answer]
Left = Callable[[], float | None]


def _refined(run: Run, answer: Answer) -> Any:
    """Return the refined formulation with its program built, None where nothing is missing."""
    formulation = run.target.formulation
    assert formulation is not None
    with run.clock("refine"):
        finer = formulation.refined(answer.point, run.job.verification_tolerance, answer.duals)
        if finer is not None:
            finer.program  # noqa: B018 - built here, so that its seconds count as refinement
        return finer


def _reached(request: Request, seconds: float | None) -> Limit | None:
    """Return the limit that forbids another program, None while there may be one."""
    if request.control.stopped:
        return request.control.reason
    return Limit.TIME if seconds is not None and seconds <= 0 else None


#: Programs besides the last whose plans are verified, where none was good enough.
LOOKED = 2
_BETWEEN = "stopped between two refinements of the program"


def _tighten(
    run: Run, problem: Any, request: Request, answer: Answer, attend: Attend, left: Left
) -> tuple[Answer, Any]:
    """Add to a relaxation what its solution breaks, until a solution is a plan of the model."""
    bound = -np.inf
    while answer.point is not None:
        finer = _refined(run, answer)
        if finer is None:
            return answer, problem
        if proves(run.target):
            found = proven_bound(problem, answer)
            bound = max(bound, -np.inf if found is None else found)
        solved = answer.termination is Termination.OPTIMAL
        seconds = left()
        limit = (answer.limit or _reached(request, seconds)) if solved else answer.limit
        if limit is not None or not solved:
            # The point of a relaxation is no plan of the model.
            message = _BETWEEN if solved else answer.message
            answer = Answer(Termination.NO_SOLUTION, limit, message=message)
            break
        run.target, problem = replace(run.target, formulation=finer), finer.program
        warm = None if request.warm_start is None else answer.point
        if warm is not None and not getattr(problem, "continuous", True):
            # Rounding mends no point of whole numbers: the plan is a point of every program.
            warm = finer.encode(run.job.warm_start)
        answer = attend(problem, replace(request, time_limit=seconds, warm_start=warm))
    if answer.termination not in CLAIMS_NONE and np.isfinite(bound):
        known = -np.inf if answer.dual_bound is None else answer.dual_bound
        answer = replace(answer, dual_bound=max(bound, known))
    return answer, problem


def _approximate(
    run: Run, problem: Any, request: Request, answer: Answer, attend: Attend, left: Left
) -> tuple[Answer, Any]:
    """Solve finer and finer approximations, each from the last, until one is fine enough."""
    rounds: list[_Round] = []
    ended, failure, settled = "", "", False
    confirmed: dict[str, Any] = {}
    while answer.point is not None and answer.termination in CLAIMS_PLAN:
        formulation = run.target.formulation
        assert formulation is not None
        finer = _refined(run, answer)
        rounds.append((run.target, problem, answer))
        settled = finer is None and formulation.settled
        if settled:
            confirmation = confirm(run, request, answer, left())
            confirmed, failure = confirmation.statistics, confirmation.failure
            finer = confirmation.finer
            settled = finer is None and not failure
        run.history = [dict(row) for row in formulation.history]
        if finer is None:
            break
        # A point that is not quite optimal yet is as good a start as any.
        limit: Limit | None = None if answer.limit is Limit.ITERATIONS else answer.limit
        seconds = left()
        limit = _reached(request, seconds) or limit
        if limit is not None:
            answer = replace(answer, limit=limit, message=_BETWEEN)
            rounds[-1] = run.target, problem, answer
            break
        program = finer.program
        warm = None
        if Feature.WARM_START in run.target.backend.features:
            warm = program.guess
        run.target, problem = replace(run.target, formulation=finer), program
        answer = attend(problem, replace(request, time_limit=seconds, warm_start=warm))
        if answer.point is None or answer.termination not in CLAIMS_PLAN:
            ended = f"on the refined program {answer.termination}: {answer.message}".rstrip(": ")
    if ended:
        # What a coarser program gave is still the best there is; verification judges it.
        last = answer
        run.target, problem, answer = rounds[-1]
        answer = replace(answer, limit=last.limit, message=ended)
        if run.history:
            failed = dict.fromkeys(run.history[-1]) | {"mesh": len(rounds) + 1, "then": ended}
            run.history.append(failed)
    for row, spent in zip(run.history, run.spent, strict=False):
        row["seconds"] = spent
    if failure:
        answer = replace(answer, message=f"not settled: {failure}")
    if run.history and not (settled and (len(rounds) == 1 or run.history[-1].get("verified"))):
        answer, problem = _best(run, rounds, answer, problem, settled)
    return replace(answer, statistics={**answer.statistics, **confirmed}), problem


#: What was asked of whom, the program, and its answer.
_Round = tuple[Target, Any, Answer]


def _best(
    run: Run, rounds: list[_Round], answer: Answer, problem: Any, settled: bool
) -> tuple[Answer, Any]:
    """Return the round whose plan breaks the model least, the last where that verifies.

    Looked at are the last, the last that was seen to verify, and those with the least errors.
    """
    last = len(rounds) - 1
    rows = run.history[: last + 1]
    seen = [k for k in range(last) if rows[k].get("verified")][-1:]
    known = [k for k in range(last) if rows[k].get("error") is not None]
    nearest = sorted(known, key=lambda k: float(rows[k]["error"]))[:LOOKED]
    found: list[tuple[float, int]] = []
    with run.clock("refine"):
        for k in (last, *seen, *nearest):
            target, _, one = rounds[k]
            assert target.formulation is not None
            try:
                plan = target.formulation.decode(one.point)
            except InvalidData:  # a point that stands for no plan is not the best
                continue
            checked = run.job.model.verify(plan, tolerance=run.job.verification_tolerance)
            found.append((checked.excess, k))
            if checked.excess <= 1.0:
                break
    # One that verifies is as good as another: the first looked at, which is the last solved.
    chosen = min(found, key=lambda one: max(one[0], 1.0), default=(np.inf, last))[1]
    words, limit = [answer.message], answer.limit
    if not settled and not answer.message:
        words = [f"refinement did not settle: {rows[-1]['then']}"]
    if chosen != last:
        run.target, problem, answer = rounds[chosen]
        if not settled:
            words.append(f"the plan is that of mesh {chosen + 1} of {len(rounds)}")
    if not settled and answer.termination in CLAIMS_PLAN:
        answer = replace(answer, termination=Termination.FEASIBLE)
    return replace(answer, limit=limit, message="; ".join(filter(None, words))), problem
