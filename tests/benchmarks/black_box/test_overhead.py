"""Time per evaluation beside SciPy's own calls, and wall time with several workers.

The difference to SciPy is CPU time of the same search on the same points in one process; the goal is 20 us. With 8 workers on a function
that sleeps for 0.2 s the goal is a sixth of the time of one worker. Run with ``make bench``, or::

    pytest tests/benchmarks/black_box/test_overhead.py -s
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.optimize

import crosstrack as ct
from crosstrack.models import BlackBoxMinimisation
from crosstrack.models.black_box import PythonFunction

EVALUATIONS = 10_000
ENDLESS = 10**9


def sphere(x: Any) -> float:
    """Return the sum of squares of the distance to a point of the unit cube."""
    offset = x - 0.3
    return float(offset @ offset)


def direct(function: Any, bounds: Any) -> None:
    """Call DIRECT of SciPy."""
    limit = 10 * EVALUATIONS
    scipy.optimize.direct(function, bounds, maxfun=limit, maxiter=limit, vol_tol=0.0, len_tol=0.0)


def dual_annealing(function: Any, bounds: Any) -> None:
    """Call dual annealing of SciPy."""
    rng = np.random.default_rng(1)
    scipy.optimize.dual_annealing(function, bounds, maxiter=ENDLESS, maxfun=ENDLESS, rng=rng)


def differential_evolution(function: Any, bounds: Any) -> None:
    """Call differential evolution of SciPy again and again."""
    while True:
        scipy.optimize.differential_evolution(
            function, bounds, maxiter=ENDLESS, rng=1, updating="deferred"
        )


def seconds_of_scipy(search: Callable[[Any, Any], None], dimension: int) -> float:
    """Return CPU seconds per evaluation of SciPy's call, which an exception ends."""
    calls = [0]

    def counted(x: Any) -> float:
        calls[0] += 1
        if calls[0] > EVALUATIONS:
            raise StopIteration
        return sphere(x)

    begin = time.process_time()
    with contextlib.suppress(StopIteration, RuntimeError):  # differential evolution wraps it
        search(counted, [(0.0, 1.0)] * dimension)
    return (time.process_time() - begin) / EVALUATIONS


def seconds_of_ours(name: str, dimension: int) -> float:
    """Return CPU seconds per evaluation of a verified run in this process."""
    model = BlackBoxMinimisation(sphere, [(0.0, 1.0)] * dimension, budget=EVALUATIONS)
    begin = time.process_time()
    solution = ct.solve(model, name, seed=1)
    return (time.process_time() - begin) / int(solution.statistics["evaluations"])


@pytest.mark.parametrize("dimension", [2, 20])
@pytest.mark.parametrize("search", [direct, dual_annealing, differential_evolution])
def test_overhead(search: Any, dimension: int, capsys: Any) -> None:
    name = search.__name__.replace("_", "-")
    seconds_of_ours(name, dimension)  # imports
    theirs = min(seconds_of_scipy(search, dimension) for _ in range(3))
    ours = min(seconds_of_ours(name, dimension) for _ in range(3))
    with capsys.disabled():
        print(
            f"\n{name}, {dimension} variables: SciPy {theirs * 1e6:.1f} us, crosstrack {ours * 1e6:.1f} us, "
            f"difference {(ours - theirs) * 1e6:.1f} us"
        )


def simulation(x: Any) -> float:
    """Return a value after 0.2 s."""
    time.sleep(0.2)
    return float(((x - 0.3) ** 2).sum())


@pytest.mark.parametrize("name", ["random-search", "differential-evolution", "cma-es"])
def test_workers(name: str, capsys: Any) -> None:
    if name == "cma-es":
        pytest.importorskip("cma")
    seconds = []
    several = PythonFunction(simulation, workers=8)
    # The processes start in the second run and are ready in the third one.
    for function in (simulation, several, several):
        model = BlackBoxMinimisation(function, [[0, 1]] * 4, budget=240)
        begin = time.perf_counter()
        ct.solve(model, name, seed=1)
        seconds.append(time.perf_counter() - begin)
    with capsys.disabled():
        print(
            f"\n{name}: 240 evaluations of 0.2 s, 1 worker {seconds[0]:.1f} s; 8 workers with their start {seconds[1]:.1f} s, "
            f"{seconds[0] / seconds[1]:.1f} times as fast; without it {seconds[2]:.1f} s, {seconds[0] / seconds[2]:.1f} times"
        )
