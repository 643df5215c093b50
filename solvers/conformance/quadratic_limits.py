"""Conformance cases: a quadratic program that takes a while, for limits, stops and warm starts."""

from __future__ import annotations

import functools

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.base import RowProgram
from ...models.programs.linear import QuadraticProgram
from ..backend import Feature, Limit, Termination
from .cases import Case, Expectation, Run
from .quadratic_larger import certified

__all__ = ["limit_cases_of", "quadratic_limit_cases"]

#: Columns and rows: dense, so that a fraction of a second is not enough for most solvers.
SIZE, ROWS = 400, 200
#: The same of what every solver shall finish.
SMALL = 60, 30


def quadratic_limit_cases() -> tuple[Case, ...]:
    """Return the cases."""
    program, start = _dense(SIZE, ROWS)
    small, solution = _dense(*SMALL)
    optimum = Expectation((Termination.OPTIMAL,), small.objective(solution))
    return (
        *limit_cases_of("quadratic", program, start),
        Case("quadratic: dense", small, optimum),
    )


def limit_cases_of(kind: str, program: RowProgram, start: NDArray[np.float64]) -> tuple[Case, ...]:
    """Return the cases of limits, stops and warm starts.

    Parameters
    ----------
    kind : str
        What their names begin with.
    program : RowProgram
        What takes more than a fraction of a second.
    start : ndarray
        Its optimum.
    """
    best = program.objective(start)
    ends = (Termination.OPTIMAL, Termination.FEASIBLE, Termination.NO_SOLUTION)

    def expect(limit: Limit, through: bool = True) -> Expectation:
        allowed = ends if through else ends[1:]
        return Expectation(allowed, best_known=best, floor=best, limit=limit, through=through)

    return (
        Case(
            f"{kind}, limit: time",
            program,
            expect(Limit.TIME),
            arguments={"time_limit": 0.2},
        ),
        Case(
            f"{kind}, limit: no time at all",
            program,
            expect(Limit.TIME, through=False),
            arguments={"time_limit": 0.0},
        ),
        Case(
            f"{kind}, stop: before it starts",
            program,
            expect(Limit.INTERRUPTED, through=False),
            arguments={"time_limit": 30.0},
            stop_after=0.0,
        ),
        Case(
            f"{kind}, stop: while it runs",
            program,
            expect(Limit.INTERRUPTED),
            frozenset({Feature.INTERRUPT}),
            {"time_limit": 30.0},
            stop_after=0.1,
        ),
        Case(
            f"{kind}, warm start: kept",
            program,
            expect(Limit.TIME),
            frozenset({Feature.WARM_START}),
            {"time_limit": 0.2, "warm_start": start},
            further=_no_worse,
        ),
    )


@functools.cache
def _dense(size: int, rows: int) -> tuple[QuadraticProgram, NDArray[np.float64]]:
    """Return a dense program with its optimum; its data are sines, which no library can change."""
    k, row = np.arange(size), np.arange(rows)[:, None]
    root = np.sin(1.0 + (k[:, None] * 7919 + k[None, : size // 2] * 104729) % 10007)
    hessian = root @ root.T + np.eye(size)
    hessian = (hessian + hessian.T) / 2
    matrix = np.sin(2.0 + (row * 611953 + k[None, :] * 1299709) % 10009)
    point = np.round(np.sin(3.0 + k * 31 % 1009), 3)
    duals = np.where(row[:, 0] % 2 == 0, np.sin(5.0 + row[:, 0] * 37 % 1013), 0.0)
    reduced = np.where(k % 3 == 0, np.sin(4.0 + k * 41 % 1019), 0.0)
    program = certified(hessian, sp.csr_array(matrix), point, duals, reduced, room=0.5)
    return program, point


def _no_worse(case: Case, run: Run) -> str | None:
    value, best = run.answer.primal_bound, case.expectation.best_known
    if best is not None and (value is None or value > best + 1e-6 * abs(best)):
        return f"started from the optimum {best!r}, ended with {value!r}"
    return None
