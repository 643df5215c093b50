"""Sequences of programs: two strategies for models that a single program cannot represent.

If the programs of a formulation are relaxations, the formulation is tightened: rows are added that
its solution violates, and every bound of every program is valid for the model. If the programs are
approximations, the formulation is refined: each solution determines the next mesh, and nothing is
proven.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...errors import InvalidData
from ...timing import clock
from ..contract.backend import Answer, Request
from ..contract.enums import CLAIMS_NONE, CLAIMS_PLAN, Feature, Limit, Termination
from ..contract.job import Target
from .confirmation import confirm
from .rescue import (
    LEAST_FIRST,
    RESTRICTED_ITERATIONS,
    Work,
    explodes,
    has_ladder,
    limit_first,
    rescue,
)
from .running import Run, proven_bound
from .starts import SECOND, look_again, wants_none, with_iterations

__all__ = ["refine"]

#: Time kept for judging and verifying the answer of the next program, as a multiple of the mean time of
#: judging the programs so far, and its largest share of the time left.
RESERVE, MOST_RESERVE = 2.0, 0.5


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
            # Integers are counts, which add up. Other values, such as residuals, are the last ones.
            former = self.counts.get(name, 0)
            whole = isinstance(count, int) and isinstance(former, int)
            self.counts[name] = count + former if whole else count

    def add_to(self, answer: Answer) -> Answer:
        """Return `answer` with the seconds and counts of all rounds."""
        if not self.rounds:
            return answer
        counts = {**answer.statistics, **self.counts, "refinements": self.rounds}
        return replace(answer, seconds=self.seconds, statistics=counts)


def refine(run: Run, problem: Any, request: Request) -> tuple[Answer, Any]:
    """Run the backend on a sequence of programs until the formulation requests no refinement.

    `problem` is the first program. The run's target changes to the last formulation. The last answer, with seconds
    and counts summed over all programs, and its program are returned.
    """
    totals = _Totals()
    deadline = None if request.time_limit is None else clock() + request.time_limit

    def attend(program: Any, stage_request: Request) -> Answer:
        begin = clock()
        answer = run.attend(program, stage_request)
        run.spent.append(clock() - begin)
        totals.add(answer)
        return answer

    def left() -> float | None:
        if deadline is None:
            return None
        seconds = min(deadline - clock(), run.limit.end - time.perf_counter())
        judged = run.seconds.get("refine", 0.0) / max(1, len(run.spent))
        return seconds - min(RESERVE * judged, MOST_RESERVE * seconds)

    formulation = run.target.formulation
    assert formulation is not None
    if formulation.relaxes:
        answer = attend(problem, request)
        if answer.point is not None:
            answer, problem = _tighten(run, problem, request, answer, attend, left)
        return totals.add_to(answer), problem
    remarks = len(run.notes)
    begin, target, limited = clock(), run.target, limit_first(run, request)
    program = _begin_coarse(run, request)
    if program is not None:
        first = attend(program, replace(limited, time_limit=left(), warm_start=program.guess))
    if program is None or first.point is None:
        run.target, program = target, problem
        first = attend(problem, replace(limited, time_limit=left()))
    run.spent[:] = [clock() - begin]  # of all searches on the first mesh
    problem = program
    if first.point is not None:
        first, problem = look_again(run, problem, request, first, left())
        if SECOND in first.statistics:
            totals.counts[SECOND] = first.statistics[SECOND]

    work = Work(run)

    def approximate(program: Any, stage_request: Request) -> tuple[Answer, Any]:
        assert run.target.formulation is not None
        work.begin_stage(run.target.formulation.is_restricted)
        limited = limit_first(run, stage_request, is_uniform=True)
        if run.target.formulation.is_restricted:
            limited = with_iterations(limited, RESTRICTED_ITERATIONS)
        answer = attend(program, work.limit(program, limited, LEAST_FIRST))
        return _approximate(run, program, request, answer, attend, left, work)

    work.begin_stage()
    answer, problem = _approximate(run, problem, request, first, attend, left, work)
    answer, problem = rescue(run, formulation, problem, request, answer, attend, approximate, left)
    if run.target.formulation is not None and run.target.formulation.name != formulation.name:
        # The remarks on other starts are about the first stage.
        del run.notes[remarks:]
        totals.counts.pop(SECOND, None)
    return totals.add_to(answer), problem


Attend = Callable[[Any, Request], Answer]
Left = Callable[[], float | None]


def _begin_coarse(run: Run, request: Request) -> Any:
    """Return the first program, started at the optimum of the coarse one; None if the search begins at the guess."""
    formulation = run.target.formulation
    if formulation is None or not formulation.begins_coarse or wants_none(run.job):
        return None
    coarse = formulation.coarse()
    if coarse is None:
        return None
    answer = run.attend(coarse.program, limit_first(run, request, is_uniform=True))
    if answer.termination is not Termination.LOCALLY_OPTIMAL or answer.point is None:
        return None
    run.target = replace(run.target, formulation=formulation.guessed(coarse.decode(answer.point)))
    return _program(run, run.target.formulation)


def _refined(run: Run, answer: Answer) -> Any:
    """Return the refined formulation; None if none is needed."""
    formulation = run.target.formulation
    assert formulation is not None
    with run.clock("refine"):
        return formulation.refined(answer.point, run.job.verification_tolerance, answer.duals)


def _program(run: Run, formulation: Any) -> Any:
    """Return the program of a refined formulation; its seconds are those of the refinement."""
    with run.clock("refine"):
        return formulation.program


def _reached(request: Request, seconds: float | None) -> Limit | None:
    """Return the limit that prevents another program; None if the run may continue."""
    if request.control.stopped:
        return request.control.reason
    return Limit.TIME if seconds is not None and seconds <= 0 else None


#: Factor of the solver's tolerance, and its smallest value, if every interval is accurate but the plan does not
#: verify. An unstable motion amplifies the residuals of the program, which finer meshes do not reduce.
TIGHTER, TIGHTEST = 0.1, 1e-9
#: Number of earlier programs whose plans are also verified if none was accurate enough.
LOOKED = 2
_UNSETTLED = "the linearisation has not converged"
_BETWEEN = "stopped between two refinements of the program"


def _tighten(
    run: Run, problem: Any, request: Request, answer: Answer, attend: Attend, left: Left
) -> tuple[Answer, Any]:
    """Add violated rows to a relaxation until its solution is a plan of the model."""
    bound = -np.inf
    while answer.point is not None:
        finer = _refined(run, answer)
        if finer is None:
            formulation = run.target.formulation
            found = answer.termination in CLAIMS_PLAN and answer.limit is None
            if found and formulation is not None and formulation.is_local_optimum:
                answer = replace(
                    answer, termination=Termination.LOCALLY_OPTIMAL, dual_bound=None, message=""
                )
            elif found and formulation is not None and not formulation.relaxes:
                plan, tolerance = run.decode(answer.point), run.job.verification_tolerance
                if run.job.model.verify(plan, tolerance=tolerance).ok:
                    answer = replace(
                        answer,
                        termination=Termination.FEASIBLE,
                        dual_bound=None,
                        message=_UNSETTLED,
                    )
                else:
                    answer = Answer(Termination.NO_SOLUTION, message=formulation.failure)
            return answer, problem
        if run.target.proves:
            proven = proven_bound(problem, answer)
            bound = max(bound, -np.inf if proven is None else proven)
        # A linearisation may continue from a point whose optimality is not proven.
        linear = not finer.relaxes and answer.termination in CLAIMS_PLAN and answer.limit is None
        solved = answer.termination is Termination.OPTIMAL or linear
        limit = (answer.limit or _reached(request, left())) if solved else answer.limit
        if limit is not None or not solved:
            # The point of a relaxation is not a plan of the model.
            message = _BETWEEN if solved else answer.message
            answer = Answer(Termination.NO_SOLUTION, limit, message=message)
            break
        run.target, problem = replace(run.target, formulation=finer), _program(run, finer)
        seconds = left()
        warm = None if request.warm_start is None else answer.point
        if warm is not None and not getattr(problem, "continuous", True):
            # The warm start is feasible for every program; a rounded fractional point is not.
            warm = finer.encode(run.job.warm_start)
        answer = attend(problem, replace(request, time_limit=seconds, warm_start=warm))
    if answer.termination not in CLAIMS_NONE and np.isfinite(bound):
        claimed = -np.inf if answer.dual_bound is None else answer.dual_bound
        answer = replace(answer, dual_bound=max(bound, claimed))
    return answer, problem


def _approximate(
    run: Run, problem: Any, request: Request, answer: Answer, attend: Attend, left: Left, work: Work
) -> tuple[Answer, Any]:
    """Solve finer and finer approximations, each from the last, until one is accurate enough."""
    rounds: list[_Round] = []
    ended, failure, settled = "", "", False
    confirmed: dict[str, Any] = {}
    work.add(problem, answer)
    while answer.point is not None and answer.termination in CLAIMS_PLAN:
        formulation = run.target.formulation
        assert formulation is not None
        try:
            finer = _refined(run, answer)
        except InvalidData as error:
            if rounds:  # otherwise the answer is reported as it is
                ended = f"the refined program ends at a point that is no plan: {error}"
            break
        rounds.append((run.target, problem, answer))
        settled = finer is None and formulation.settled
        if settled:
            confirmation = confirm(run, request, answer, left())
            confirmed, failure = confirmation.statistics, confirmation.failure
            finer = confirmation.finer
            settled = finer is None and not failure
        run.history = [dict(row) for row in formulation.history]
        may_explode = has_ladder(run.job) and not formulation.is_restricted
        if finer is not None and may_explode and explodes(run.history):
            run.history[-1]["then"] = "given up: neither error nor objective converges"
            break
        if finer is None:
            break
        # A point that is not yet optimal is an adequate start.
        limit: Limit | None = None if answer.limit is Limit.ITERATIONS else answer.limit
        limit = _reached(request, left()) or limit
        if limit is not None:
            answer = replace(answer, limit=limit, message=_BETWEEN)
            rounds[-1] = run.target, problem, answer
            break
        if run.history and run.history[-1].get("verified") is False:
            request = replace(
                request,
                tolerance=min(request.tolerance, max(TIGHTEST, TIGHTER * request.tolerance)),
            )
        program = _program(run, finer)
        if work.lacks(program, answer):
            run.history[-1]["then"] = "given up: finer meshes need too many iterations"
            break
        warm, seconds = None, left()
        # Without a limit, a feasible point is no minimum. A warm start would stay there, and is not tested for one.
        is_stuck = answer.termination is Termination.FEASIBLE and answer.limit is None
        if Feature.WARM_START in run.target.backend.features and not is_stuck:
            warm = program.guess
        run.target, problem = replace(run.target, formulation=finer), program
        limited = work.limit(problem, request)
        answer = attend(problem, replace(limited, time_limit=seconds, warm_start=warm))
        work.add(problem, answer)
        has_failed = answer.point is None or answer.termination not in CLAIMS_PLAN
        if has_failed and warm is not None and answer.limit is None:
            # Ipopt can fail to reach the accuracy from the small barrier of a warm start.
            answer = attend(problem, replace(limited, time_limit=left(), warm_start=None))
            work.add(problem, answer)
        if answer.point is None or answer.termination not in CLAIMS_PLAN:
            ended = f"on the refined program {answer.termination}: {answer.message}".rstrip(": ")
    if ended:
        # The last coarser program has the best point so far, which verification judges.
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
        late = _reached(request, left()) is not None
        answer, problem = _best(run, rounds, answer, problem, settled, late)
    return replace(answer, statistics={**answer.statistics, **confirmed}), problem


#: Target, program and answer of one round.
_Round = tuple[Target, Any, Answer]


def _best(
    run: Run, rounds: list[_Round], answer: Answer, problem: Any, settled: bool, late: bool
) -> tuple[Answer, Any]:
    """Return the answer and program of the round whose plan violates the model least.

    Candidates are the last round, the last round that verified, and those with the smallest errors.
    The last round is returned if it verifies. After a limit, `late`, the reports of the rounds decide.
    """
    last = len(rounds) - 1
    rows = run.history[: last + 1]
    verified = [k for k in range(last) if rows[k].get("verified")][-1:]
    measured = [k for k in range(last) if rows[k].get("error") is not None]
    nearest = sorted(measured, key=lambda k: float(rows[k]["error"]))[:LOOKED]
    candidates, excesses = (last, *verified, *nearest), list[tuple[float, int]]()
    if late:  # a verification can take longer than the grace
        is_verified = rows and rows[-1].get("verified")
        excesses = [(0.0, last if is_verified else (*verified, *nearest, last)[0])]
    with run.clock("refine"):
        for k in () if late else candidates:
            target, _, candidate = rounds[k]
            assert target.formulation is not None
            try:
                plan = target.formulation.decode(candidate.point)
            except InvalidData:  # a point without a plan is not the best
                continue
            checked = run.job.model.verify(plan, tolerance=run.job.verification_tolerance)
            excesses.append((checked.excess, k))
            if checked.excess <= 1.0:
                break
    # Plans within the tolerance are equally good: take the first candidate, the last solved.
    choice = min(excesses, key=lambda pair: max(pair[0], 1.0), default=(np.inf, last))[1]
    remarks, limit = [answer.message], answer.limit
    if not settled and not answer.message:
        remarks = [f"refinement did not settle: {rows[-1]['then']}"]
    if choice != last:
        run.target, problem, answer = rounds[choice]
        if not settled:
            remarks.append(f"the plan is that of mesh {choice + 1} of {len(rounds)}")
    if not settled and answer.termination in CLAIMS_PLAN:
        answer = replace(answer, termination=Termination.FEASIBLE)
    return replace(answer, limit=limit, message="; ".join(filter(None, remarks))), problem
