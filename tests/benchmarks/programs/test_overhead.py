"""Overhead of ``ct.solve`` over CVXPY's own ``solve`` with the same solver.

Both run in turn on fresh problems, in rounds. The smallest processor times are compared, which other
processes of the machine do not change, with one thread for both. The time of the clock is printed beside.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import crosstrack as ct

cp: Any = pytest.importorskip("cvxpy", reason="CVXPY is not installed")
pytest.importorskip("clarabel", reason="Clarabel is not installed")

#: Largest ratio of the two times, and the seconds that are not counted.
RATIO, FREE = 1.3, 0.02
ROUNDS = 3
#: Class, columns and entries per row. The matrix has half as many rows as columns.
SIZES = [
    *[("linear", n, min(n, 10)) for n in (10, 100, 1000, 10_000)],
    ("linear", 400, 400),
    *[("quadratic", n, min(n, 10)) for n in (10, 100, 1000, 10_000, 100_000)],
    ("quadratic", 100_000, 20),
    *[("second-order", n, min(n, 10)) for n in (10, 100, 1000, 10_000)],
]


def _problem(kind: str, n: int, entries: int) -> Any:
    draw = np.random.default_rng(1)
    m = n // 2
    if entries == n:
        matrix: Any = draw.random((m, n))
    else:
        bands = [draw.random(n) for _ in range(entries)]
        matrix = sp.csr_array(sp.diags_array(bands, offsets=range(entries), shape=(m, n)))
    inside, cost, x = draw.random(n), draw.random(n), cp.Variable(n)
    rows = [matrix @ x >= matrix @ inside, x >= 0]
    if kind == "second-order":
        rows = [cp.norm(matrix @ x - matrix @ inside) <= 1, x >= 0]
    objective = cost @ x
    if kind == "quadratic":
        objective += cp.sum_squares(x)
    return cp.Problem(cp.Minimize(objective), rows)


def _timed(run: Callable[[Any], Any], problem: Any) -> tuple[float, float, float]:
    """Return the seconds of the processor, those of the clock, and the objective."""
    clock, processor = time.perf_counter(), time.process_time()
    value = run(problem)
    return time.process_time() - processor, time.perf_counter() - clock, value


def _cvxpy(problem: Any) -> float:
    return float(problem.solve(solver="CLARABEL", max_threads=1))


def _crosstrack(problem: Any) -> float:
    answer = ct.solve(problem, "clarabel")
    assert answer.termination == "optimal"
    assert answer.value is not None
    return answer.value


@pytest.mark.parametrize(("kind", "n", "entries"), SIZES)
def test_overhead(kind: str, n: int, entries: int) -> None:
    warnings.simplefilter("ignore")
    for run in (_cvxpy, _crosstrack):
        run(_problem(kind, 10, 5))  # imports and compiles
    times: dict[Any, list[tuple[float, float, float]]] = {_cvxpy: [], _crosstrack: []}

    for _ in range(ROUNDS):
        for run, found in times.items():
            found.append(_timed(run, _problem(kind, n, entries)))
    theirs, ours = (np.array(found).min(axis=0) for found in times.values())
    assert ours[2] == pytest.approx(theirs[2], rel=1e-6)
    text = f"{kind}, {n} columns, {entries} entries per row: "
    text += f"processor {theirs[0]:.3f} s and {ours[0]:.3f} s, ratio {ours[0] / theirs[0]:.2f}; "
    text += f"clock {theirs[1]:.3f} s and {ours[1]:.3f} s"
    print(text)
    assert ours[0] <= RATIO * theirs[0] + FREE, text
