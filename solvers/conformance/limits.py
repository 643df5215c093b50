"""Conformance cases: a program that no solver finishes, for limits, stops, gaps and warm starts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...models.programs.base import BlockProgram
from ...models.programs.linear import MixedIntegerProgram
from ..contract.backend import Feature, Limit, Termination
from .cases import GRACE, Case, Expectation, Run
from .linear import program

__all__ = [
    "hard_knapsack",
    "limit_cases",
    "numbers",
    "same_seed_same_answer",
    "seeds_differ",
    "timed_cases",
]

#: Best plan of a long search, its objective, and the proven lower bound.
_BEST = (
    0, 1, 2, 5, 9, 12, 13, 14, 16, 17, 21, 22, 23, 24, 25, 26, 31, 32, 33, 39, 44, 46, 48, 50, 52,
    54, 55, 57, 59, 60, 61, 62, 64, 65, 66, 67, 68, 71, 72, 73, 74, 81, 86, 88, 89,
)  # fmt: skip
_BEST_KNOWN, _FLOOR = -38851.0, -38985.0


def timed_cases(
    kind: str,
    program: BlockProgram,
    start: NDArray[np.float64],
    ends: tuple[Termination, ...] = (),
    *,
    best_known: float,
    floor: float,
    seconds: float,
    stop_after: float,
    any_limit: bool = False,
) -> tuple[Case, ...]:
    """Return the cases for time limits, stop requests and keeping a warm start.

    `program` takes longer than `seconds`, the time limit, and `stop_after` are the seconds until the stop request.
    The last run starts from `start`, the best known point. A fast solver may finish with one of `ends`. The other
    arguments are those of :class:`Expectation`.
    """
    # A run without a point is accepted: these cases test the limit, not the search.
    stopped = (Termination.FEASIBLE, Termination.NO_SOLUTION)
    cut = Expectation(stopped, best_known=best_known, floor=floor)
    begun = replace(cut, termination=(*ends, *stopped), through=bool(ends), any_limit=any_limit)
    timed, none = replace(begun, limit=Limit.TIME), replace(cut, limit=Limit.TIME)
    return (
        Case(f"{kind}limit: time", program, timed, arguments={"time_limit": seconds}),
        Case(f"{kind}limit: no time at all", program, none, arguments={"time_limit": 0.0}),
        Case(
            f"{kind}stop: while it runs",
            program,
            replace(begun, limit=Limit.INTERRUPTED),
            frozenset({Feature.INTERRUPT}),
            {"time_limit": 30.0},
            stop_after=stop_after,
        ),
        Case(
            f"{kind}stop: before it starts",
            program,
            replace(cut, limit=Limit.INTERRUPTED),
            arguments={"time_limit": 30.0},
            stop_after=0.0,
        ),
        Case(
            f"{kind}warm start: kept",
            program,
            timed,
            frozenset({Feature.WARM_START}),
            {"time_limit": seconds, "warm_start": start},
            further=no_worse,
        ),
    )


def no_worse(case: Case, run: Run) -> str | None:
    """Return the fault of a run that started from the best known point and ended with a worse one."""
    best, value = case.expectation.best_known, run.answer.primal_bound
    if best is not None and (value is None or value > best + 1e-6 * abs(best) + 1e-9):
        return f"started from a point of {best!r}, ended with {value!r}"
    return None


def limit_cases() -> tuple[Case, ...]:
    """Return the cases."""
    hard = hard_knapsack()
    start = np.zeros(hard.size)
    start[list(_BEST)] = 1.0

    def expect(limit: Limit | None, *termination: Termination) -> Expectation:
        return Expectation(termination, best_known=_BEST_KNOWN, floor=_FLOOR, limit=limit)

    result = expect(Limit.TIME, Termination.FEASIBLE)
    first, *others = timed_cases(
        "", hard, start, best_known=_BEST_KNOWN, floor=_FLOOR, seconds=0.3, stop_after=0.2
    )
    *others, kept = others
    return (
        replace(first, expectation=result, further=_knows_a_bound),
        *others,
        replace(kept, expectation=result),
        Case(
            "gap: a wide one ends the run",
            hard,
            expect(None, Termination.OPTIMAL),
            frozenset({Feature.GAP, Feature.DUAL_BOUND}),
            {"gap": 0.2, "time_limit": 30.0},
        ),
        Case(
            "gap: measured with the offset",
            replace(hard, offset=1e6),
            Expectation((Termination.OPTIMAL,), best_known=_BEST_KNOWN + 1e6, floor=_FLOOR + 1e6),
            frozenset({Feature.GAP, Feature.DUAL_BOUND}),
            {"gap": 0.005, "time_limit": 30.0},
        ),
        Case(
            "warm start: with its own cutoff",
            hard,
            result,
            frozenset({Feature.WARM_START, Feature.CUTOFF}),
            {"time_limit": 0.3, "warm_start": start, "cutoff": _BEST_KNOWN},
            further=no_worse,
        ),
        Case(
            "incumbents: each better and feasible",
            hard,
            result,
            frozenset({Feature.INCUMBENTS}),
            {"time_limit": 0.3},
            further=_monotone,
        ),
        Case(
            "threads: one is one",
            hard,
            result,
            frozenset({Feature.THREADS}),
            {"time_limit": 0.4, "threads": 1},
            further=_one_core,
        ),
    )


def hard_knapsack(size: int = 90, rows: int = 12) -> MixedIntegerProgram:
    """Return a knapsack with `size` items and `rows` constraints, independent of library versions."""
    draw = numbers(1)
    weights = np.array([[10 + next(draw) % 991 for _ in range(size)] for _ in range(rows)], float)
    cost = -np.round(weights.mean(axis=0)) - np.array([next(draw) % 500 for _ in range(size)])
    return program(
        cost.tolist(),
        weights,
        row_upper=np.floor(weights.sum(axis=1) / 2),
        upper=1,
        integral=True,
    )


def numbers(seed: int) -> Iterator[int]:
    """Yield pseudo-random integers of a linear congruential generator, independent of library versions."""
    while True:
        seed = (seed * 1103515245 + 12345) % 2**31
        yield seed >> 16


def _knows_a_bound(case: Case, run: Run) -> str | None:
    if Feature.DUAL_BOUND in run.features and run.answer.dual_bound is None:
        return "stopped without a dual bound"
    return None


def _monotone(case: Case, run: Run) -> str | None:
    if not run.incumbents:
        return "reported no incumbents"
    best = np.inf
    for seconds, objective, point in run.incumbents:
        verification = case.program.verify(np.asarray(point, float))
        if not verification.ok or verification.objective is None:
            return f"the incumbent at {seconds:.3f} s fails verification: {verification.summary()}"
        if abs(verification.objective - objective) > 1e-6 * max(1.0, abs(objective)):
            return f"an incumbent claims {objective!r} and has {verification.objective!r}"
        if not objective < best:
            return f"an incumbent of {objective!r} follows one of {best!r}"
        if not 0 <= seconds <= run.seconds + GRACE:
            return f"an incumbent came after {seconds:.3f} s of {run.seconds:.3f} s"
        best = objective
    final = run.answer.primal_bound
    if final is not None and final > best + 1e-6 * max(1.0, abs(best)):
        return f"returned {final!r}, worse than its incumbent {best!r}"
    return None


def _one_core(case: Case, run: Run) -> str | None:
    if run.cpu > 1.4 * run.seconds + 0.1:
        return (
            f"asked for one thread, used {run.cpu:.2f} s of processor time in {run.seconds:.2f} s"
        )
    return None


def same_seed_same_answer(case: Case, run: Run) -> str | None:
    """Return the difference between the answers to two equal requests; None if they agree."""
    first, second = run.answer, run.others[0]
    if first.point is None or second.point is None:
        return "has no two points to compare"
    if not np.array_equal(first.point, second.point):
        return "two runs with one seed found different points"
    if dict(first.statistics) != dict(second.statistics):
        return f"two runs with one seed differ: {first.statistics} and {second.statistics}"
    return None


def seeds_differ(case: Case, run: Run) -> str | None:
    """Return a fault if no seed changes the point or the statistics of a backend with seeds."""
    first = run.answer
    if all(
        np.array_equal(first.point, other.point)
        and dict(first.statistics) == dict(other.statistics)
        for other in run.others
    ):
        return "declares a seed, and no other seed changes anything"
    return None
