"""Microseconds a call of the kernels of Dubins paths, beside OMPL's in the same run.

Nothing fails because it is slow. OMPL is called from Python, so its figure holds the call and the
loop around it, which is shown apart. Run with ``make bench``, or::

    pytest tests/benchmarks/messenger/test_kernel_speed.py -s
"""

from __future__ import annotations

import importlib.util
import math
import time
from statistics import median
from typing import Any

import numpy as np
import pytest
from numba import njit

from crosstrack.models.messenger.dubins import relaxed_length, shortest
from crosstrack.models.messenger.elongation import elongated
from crosstrack.models.messenger.interception import intercept, intercept_heading

COUNT, REPEATS = 20_000, 7

OMPL = """
import time
from statistics import median
from ompl import base
space = base.DubinsStateSpace(1.0)
start, end = space.allocState(), space.allocState()
start.setXY(0.0, 0.0), start.setYaw(0.0), end.setXY(3.0, 2.0), end.setYaw(1.0)
spent, empty = [], []
for _ in range(7):
    begin = time.perf_counter()
    for _ in range(20_000): space.distance(start, end)
    spent.append(time.perf_counter() - begin)
    begin = time.perf_counter()
    for _ in range(20_000): start.getX()
    empty.append(time.perf_counter() - begin)
print(median(spent) / 20_000, median(empty) / 20_000)
"""


@njit
def run_shortest(rows):
    total = 0.0
    for i in range(len(rows)):
        a, b, c, _ = shortest(0.0, 0.0, 0.0, rows[i, 0], rows[i, 1], rows[i, 2], 1.0)
        total += a + b + c
    return total


@njit
def run_relaxed(rows):
    total = 0.0
    for i in range(len(rows)):
        total += relaxed_length(0.0, 0.0, 0.0, rows[i, 0], rows[i, 1], 1.0)
    return total


@njit
def run_elongated(rows):
    total = 0.0
    for i in range(len(rows)):
        a, b, c, _, _, _, _ = elongated(0.0, 0.0, 0.0, rows[i, 0], rows[i, 1], 1.0, rows[i, 5])
        total += a + b + c
    return total


@njit
def run_intercept(rows):
    total = 0.0
    for i in range(len(rows)):
        x, y, _, vx, vy, _ = rows[i]
        total += intercept(0.0, 0.0, 0.0, 0.0, x, y, vx, vy, 1.0, 1.0)
    return total


@njit
def run_heading(rows):
    total = 0.0
    for i in range(len(rows)):
        x, y, h, vx, vy, _ = rows[i]
        total += intercept_heading(0.0, 0.0, 0.0, 0.0, x, y, vx, vy, h, 1.0, 1.0)[0]
    return total


KERNELS = {
    "shortest": run_shortest,
    "relaxed_length": run_relaxed,
    "elongated": run_elongated,
    "intercept": run_intercept,
    "intercept_heading": run_heading,
}


def microseconds(call: Any, rows: Any) -> float:
    """Return the median time a row, once compiled."""
    assert not math.isnan(call(rows[:2]))
    spent = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        call(rows)
        spent.append(time.perf_counter() - begin)
    return median(spent) / len(rows) * 1e6


def test_microseconds_a_call(run_python: Any, tmp_path: Any, capsys: Any) -> None:
    rng = np.random.default_rng(0)
    theirs = None
    if importlib.util.find_spec("ompl") is not None:
        theirs, empty = (float(one) * 1e6 for one in run_python("-c", OMPL, cwd=tmp_path).split())
    with capsys.disabled():
        print("\nmicroseconds a call; targets within 3 and within 30 turning radii")
        if theirs is not None:
            print(
                f"  {'OMPL, from Python':20} {theirs:8.3f}  (a call that does nothing: {empty:.3f})"
            )
    for name, call in KERNELS.items():
        cells = []
        for size in (3.0, 30.0):
            rows = rng.uniform(-size, size, (COUNT, 6))
            rows[:, 3:5] = rng.uniform(-0.3, 0.3, (COUNT, 2))
            rows[:, 5] = rng.uniform(2 * size, 10 * size, COUNT)
            cells.append(microseconds(call, rows))
        with capsys.disabled():
            ratio = f"   {cells[0] / theirs:.2f} of OMPL" if theirs and name == "shortest" else ""
            print(f"  {name:20} {cells[0]:8.3f} {cells[1]:8.3f}{ratio}")


@pytest.mark.parametrize("name", KERNELS)
def test_kernels_sum_to_a_number(name: str) -> None:
    """The timed kernels are not optimised away and give plausible lengths."""
    rows = np.array([[3.0, 2.0, 1.0, 0.1, -0.2, 9.0]])
    assert 3.6 < KERNELS[name](rows) < 12
