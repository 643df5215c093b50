"""Rescue: other approximations of a model if the default one leads to no settled plan.

The first mesh of a refined formulation can be infeasible, or its refinement can fail to converge, although
another discretisation of the same model converges from the same guess. The formulation lists such
alternatives, and each of them is solved and refined like the first. Limits count iterations and programs,
not seconds, so that the result is the same at any load of the machine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise
from typing import Any

import numpy as np

from ...errors import InvalidData
from ...models.formulation import Formulation
from ..contract.backend import Answer, Request
from ..contract.enums import CLAIMS_PLAN, Limit, Termination
from ..contract.job import Job, Target
from .running import Run
from .starts import with_iterations

__all__ = [
    "LEAST_FIRST",
    "RESTRICTED_ITERATIONS",
    "STAGES",
    "Work",
    "explodes",
    "has_ladder",
    "limit_first",
    "rescue",
]

#: Key of the statistics: the approximations that were tried, and how each ended.
STAGES = "stages"
#: Iterations of the first program of a stage, so that a search that does not converge leaves room for others.
ITERATIONS = 1000
#: Options of Ipopt far from a solution. From a guess inside two obstacles, the monotone barrier reaches an
#: optimum on 20 intervals in 86 iterations and on 60 intervals in 48. The adaptive one ends at a plan that
#: violates the motion by 0.18 on 20 intervals, and needs 218 iterations on 60.
STEADY = {"mu_strategy": "monotone"}
#: A refinement explodes if it multiplied its nodes by `GROWTH` in the last `MESHES` meshes, and the
#: smallest error of these meshes is more than `SHRINKS` times the smallest one before.
GROWTH, MESHES, SHRINKS = 2.0, 3, 0.5
#: It also explodes if the last `STALLED` meshes, of any size, did not reduce the smallest error that much.
STALLED = 6
#: It also explodes if the objective rose by more than this share in each of the last `RISING` meshes. The
#: plan then passes an obstacle between two nodes: each finer mesh needs a faster turn.
RISE, RISING = 0.1, 3
#: It does not explode if the last relative change of the objective is at most this, or is at most :data:`CLOSE` and
#: falls. A thrust that is switched exceeds its limit at the jumps until the intervals there are short.
CONVERGED = 1e-7
#: Work of all programs, in columns times iterations. Each stage has half of the rest, but at least `SHARE`, and
#: the restricted one at least `RESTRICTED`: all stages together can need about twice as much.
WORK, SHARE, RESTRICTED = 4_500_000, 300_000, 2_500_000
#: Factor of `RESTRICTED` for the second restricted stage, which starts at the best plan.
LATER = 0.6
#: Largest number of iterations of the first program of a restricted stage.
RESTRICTED_ITERATIONS = 400
#: Iterations of a program at least, and of the first one of a stage.
LEAST, LEAST_FIRST = 50, 300
#: Relative advantage of an unsettled plan over a settled one beyond which both are different optima.
CLEARLY = 1e-4
#: Relative change of the objective up to which no stage follows a verified plan, from the restricted stage on.
CLOSE = 1e-5

_SETTLED, _VERIFIED, _REJECTED, _NOTHING = range(4)


def has_ladder(job: Job) -> bool:
    """Return whether the caller left formulation, mesh and start to the run.

    An explicit formulation, its options, a warm start or a random seed keep the first formulation.
    """
    given = job.formulation is not None or job.formulation_options or job.warm_start is not None
    return not given and not job.seed


def limit_first(run: Run, request: Request, *, is_uniform: bool = False) -> Request:
    """Return the request of the first program of a stage, with at most :data:`ITERATIONS`.

    Programs on uniform meshes are solved with :data:`STEADY` options.
    """
    options = dict(request.options)
    if not has_ladder(run.job) or "max_iter" not in options or run.job.backend_options:
        return request
    options["max_iter"] = min(options["max_iter"], ITERATIONS)
    if is_uniform:
        options.update({name: value for name, value in STEADY.items() if name in options})
    return replace(request, options=options)


def explodes(rows: Sequence[dict[str, Any]]) -> bool:
    """Return whether the last meshes of a history grew without approaching a plan."""
    values = [row["objective"] for row in rows if row.get("objective") is not None][-RISING - 1 :]
    if len(values) > RISING and all(
        new - old > RISE * max(abs(new), abs(old)) for old, new in pairwise(values)
    ):
        return True
    known = [row for row in rows if row.get("error") is not None and row.get("nodes")]
    if len(known) <= MESHES or any(row.get("verified") for row in known):
        return False
    changes = (row.get("change") for row in known[-2:])
    former, change = (np.inf if item is None else item for item in changes)
    if change <= max(CONVERGED, min(CLOSE, SHRINKS * former)):
        return False
    errors = [float(row["error"]) for row in known]
    if len(known) > STALLED and min(errors[-STALLED:]) > SHRINKS * min(errors[:-STALLED]):
        return True
    grown = known[-1]["nodes"] >= GROWTH * known[-MESHES - 1]["nodes"]
    return bool(grown and min(errors[-MESHES:]) > SHRINKS * min(errors[:-MESHES]))


class Work:
    """Work of the programs of all stages; unlimited if the caller chose formulation, start or options."""

    def __init__(self, run: Run) -> None:
        # Options of the caller, such as a number of iterations, are not reduced.
        is_limited = has_ladder(run.job) and not run.job.backend_options
        self.left = self.stage = float(WORK) if is_limited else np.inf
        self.restricted = float(RESTRICTED)

    def begin_stage(self, is_restricted: bool = False) -> None:
        """Give the next stage its share."""
        self.stage = max(self.restricted if is_restricted else SHARE, 0.5 * self.left)
        self.restricted *= LATER if is_restricted else 1.0

    def add(self, program: Any, answer: Answer) -> None:
        """Subtract the work of a program."""
        work = program.size * int(answer.statistics.get("iterations", 0))
        self.left, self.stage = self.left - work, self.stage - work

    def lacks(self, program: Any, answer: Answer) -> bool:
        """Return whether the rest of the stage is too small for `LEAST` iterations, or fewer as `answer`."""
        iterations = min(LEAST, int(answer.statistics.get("iterations", 0)))
        return bool(program.size * iterations > self.stage)

    def limit(self, program: Any, request: Request, least: int = LEAST) -> Request:
        """Return the request with the iterations that the rest of the stage allows."""
        if self.stage == np.inf:
            return request
        return with_iterations(request, max(least, int(self.stage // program.size)))


@dataclass
class _Stage:
    """State of the run at the end of one stage, and its grade: the smaller, the better."""

    target: Target
    program: Any
    answer: Answer
    history: list[dict[str, Any]]
    grade: tuple[int, float]

    @classmethod
    def of(cls, run: Run, program: Any, answer: Answer, is_late: bool = False) -> _Stage:
        return cls(run.target, program, answer, run.history, _grade(run, answer, is_late))

    @property
    def is_close(self) -> bool:
        """Whether the plan verifies and its objective changed little on the last mesh."""
        change = self.history[-1].get("change") if self.history else None
        return self.grade[0] == _VERIFIED and change is not None and change <= CLOSE

    @property
    def words(self) -> str:
        name, ended = str(self.target.formulation and self.target.formulation.name), self.answer
        text = "rejected" if self.grade[0] == _REJECTED else str(ended.termination)
        return f"{name}: {text.replace('_', ' ')}"

    def is_better(self, other: _Stage) -> bool:
        """Return whether this stage is preferred to an earlier one."""
        (kind, value), (former, best) = self.grade, other.grade
        if {kind, former} == {_SETTLED, _VERIFIED}:
            # A settled optimum is preferred unless the other plan is at a clearly better one.
            margin = CLEARLY * max(abs(value), abs(best))
            return value < best - margin if kind == _VERIFIED else value <= best + margin
        return self.grade < other.grade


def _ending(request: Request, limit: Limit | None, seconds: float | None) -> Limit | None:
    """Return the limit after which no stage may follow one that ended with `limit`; None if one may."""
    if limit not in (None, Limit.ITERATIONS):
        return limit
    if request.control.stopped:
        return request.control.reason
    return Limit.TIME if seconds is not None and seconds <= 0 else None


def _grade(run: Run, answer: Answer, is_late: bool = False) -> tuple[int, float]:
    """Return whether the answer is settled, verified, rejected or nothing, and its objective or violation.

    The rows of the history decide if it `is_late`, because a verification takes time: the answer is then that of a
    mesh whose plan verified, if there is one.
    """
    if answer.point is None or answer.termination not in CLAIMS_PLAN:
        return _NOTHING, 0.0
    if is_late:
        is_verified, excess = any(row.get("verified") for row in run.history), np.inf
    else:
        with run.clock("refine"):
            try:
                plan = run.decode(answer.point)
            except InvalidData:
                return _NOTHING, 0.0
            checked = run.job.model.verify(plan, tolerance=run.job.verification_tolerance)
        is_verified, excess = checked.ok, checked.excess
    if not is_verified:
        return _REJECTED, excess
    value = answer.primal_bound
    settled = answer.termination in (Termination.OPTIMAL, Termination.LOCALLY_OPTIMAL)
    return (_SETTLED if settled else _VERIFIED), np.inf if value is None else value


def _from_fixed_times(
    run: Run,
    formulation: Any,
    request: Request,
    attend: Callable[[Any, Request], Answer],
    left: float | None,
) -> Iterator[tuple[str, Any]]:
    """Yield the formulation started at a plan with the guessed times, if such a plan is found.

    With free times even a linear motion is not convex: a search that shortens the duration below the least one
    ends infeasible.
    """
    program = formulation.with_fixed_times()
    if program is not None and not request.control.stopped:
        limited = with_iterations(request, RESTRICTED_ITERATIONS)
        answer = attend(program, replace(limited, time_limit=left))
        if answer.point is not None and answer.termination in CLAIMS_PLAN:
            plan = formulation.decode(answer.point)
            yield f"{formulation.name} from fixed times", formulation.guessed(plan)


def rescue(
    run: Run,
    formulation: Formulation[Any, Any],
    program: Any,
    request: Request,
    answer: Answer,
    attend: Callable[[Any, Request], Answer],
    solve: Callable[[Any, Request], tuple[Answer, Any]],
    left: Callable[[], float | None],
) -> tuple[Answer, Any]:
    """Return `answer` and its program, or those of an alternative of the formulation if it is not settled.

    `formulation` is the first one, with the guess of the caller; the run's own may have a drawn start by
    now. `attend` solves one program, `solve` solves and refines the run's target, and `left` returns the
    seconds left (None for no limit). The target and history of the run become those of the best stage.
    Statistics list the stages under :data:`STAGES`.
    """
    settled = (
        answer.termination is Termination.LOCALLY_OPTIMAL
        and run.history
        and run.history[-1].get("verified")
    )
    others = formulation.alternatives()
    is_final = settled or not has_ladder(run.job) or run.job.model.is_blinded
    if is_final:
        return answer, program
    limit = _ending(request, answer.limit, left())
    if limit is not None:  # a verification for the grade may take seconds
        is_unfinished = answer.termination is not Termination.LOCALLY_OPTIMAL and next(others, None)
        return (replace(answer, limit=limit) if is_unfinished else answer), program
    best = _Stage.of(run, program, answer)
    if best.grade[0] == _NOTHING and answer.limit is None:
        others = chain(_from_fixed_times(run, formulation, request, attend, left()), others)
    following = next(others, None)
    if following is None:
        return answer, program
    stages, was_restricted, is_repeated = [best.words], False, False
    limit = answer.limit
    for label, other in chain([following], others):
        if other.is_restricted and was_restricted:
            if is_repeated or best.grade[0] != _REJECTED:
                continue
            is_repeated, label = True, f"{label} from the best plan"
            assert best.target.formulation is not None
            plan = best.target.formulation.decode(best.answer.point)
            other = other.guessed(plan) or other
        was_restricted |= other.is_restricted
        seconds = left()
        if best.grade[0] == _SETTLED or (was_restricted and best.is_close):
            break
        ending = _ending(request, limit, seconds)
        if ending is not None:
            limit = ending
            break
        run.target = replace(run.target, formulation=other)
        run.history, run.spent[:] = [], []
        answer, program = solve(other.program, replace(request, time_limit=seconds))
        is_late = _ending(request, answer.limit, left()) is not None
        stage, limit = _Stage.of(run, program, answer, is_late), answer.limit
        stages.append(f"{label}: {stage.words.partition(': ')[2]}")
        if stage.is_better(best):
            best = stage
    run.target, run.history = best.target, best.history
    if limit in (None, Limit.ITERATIONS):
        limit = best.answer.limit
    if len(stages) == 1:
        return replace(answer, limit=limit), best.program
    statistics = {**best.answer.statistics, STAGES: "; ".join(stages)}
    return replace(best.answer, statistics=statistics, limit=limit), best.program
