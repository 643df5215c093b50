"""Whole calls of :func:`crosstrack.solve` over the bare kernel over SciPy's spline, in one run.

Nothing fails because it is slow; everything fails that is wrong. All calls of a size are timed in
turn, and the least time of each counts. Run with ``make bench``, or, the long path only with ``slow``::

    pytest tests/benchmarks/minimum_snap/test_whole_calls.py -s
    pytest tests/benchmarks/minimum_snap/test_whole_calls.py -s -m "slow or not slow"
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

import crosstrack as ct
from crosstrack.models import MinimumSnap
from crosstrack.solvers.minimum_snap import banded
from crosstrack.solvers.minimum_snap.hermite import jets_to_coefficients

#: Rounds by size.
ROUNDS = {10: 300, 100: 200, 1000: 60, 10_000: 15, 1_000_000: 2}
LONG = pytest.param(1_000_000, marks=pytest.mark.slow)


def path(count: int, durations: str) -> tuple[Any, Any]:
    """Return waypoints in 3-D and times: uniform durations, or some proportional to the distance."""
    rng = np.random.default_rng(count)
    waypoints = np.cumsum(rng.normal(size=(count + 1, 3)), axis=0)
    steps = np.linalg.norm(np.diff(waypoints, axis=0), axis=1)
    long = steps if durations == "by distance" else np.full(count, 2.0)
    return waypoints, np.concatenate([[0.0], np.cumsum(long)])


def least(calls: dict[str, Callable[[], Any]], rounds: int) -> tuple[dict[str, float], Any]:
    """Return the least seconds of each call, all called in turn, and what each returned last."""
    seconds, results = dict.fromkeys(calls, np.inf), {}
    for _ in range(rounds):
        for name, call in calls.items():
            begin = time.perf_counter()
            results[name] = call()
            seconds[name] = min(seconds[name], time.perf_counter() - begin)
    return seconds, results


@pytest.mark.parametrize("durations", ["uniform", "by distance"])
@pytest.mark.parametrize("count", [10, 100, 1000, 10_000, LONG])
def test_whole_calls(count: int, durations: str, capsys: Any) -> None:
    waypoints, times = path(count, durations)
    model = MinimumSnap(waypoints, times)
    plan = ct.solve(model, "banded").plan
    rest = [(order, np.zeros(3)) for order in (1, 2, 3)]
    values = np.full((3, count + 1, 4), np.nan)
    values[:, :, 0] = waypoints.T
    values[:, [0, -1], 1:] = 0.0
    fixed, long, weights = np.isfinite(values), np.diff(times), np.eye(4)[-1]

    def kernel() -> Any:
        found = banded.solve_hermite(long, values, fixed, weights, 3)
        return jets_to_coefficients(long, found.jets, found.moments)

    seconds, results = least(
        {
            "SciPy's spline": lambda: make_interp_spline(
                times, waypoints, k=7, bc_type=(rest, rest)
            ),
            "kernel": kernel,
            "MinimumSnap(…)": lambda: MinimumSnap(waypoints, times),
            "verify": lambda: ct.verify(model, plan),
            "solve": lambda: ct.solve(model),
            "solve, a new model": lambda: ct.solve(MinimumSnap(waypoints, times)),
        },
        ROUNDS[count],
    )
    answer = results["solve"]
    assert answer.termination == "optimal"
    t = np.linspace(times[0], times[-1], 1000)
    wanted = results["SciPy's spline"](t)
    assert np.abs(answer.plan(t) - wanted).max() <= 1e-9 * np.abs(wanted).max()
    with capsys.disabled():
        print(f"\n{count:,} segments, durations {durations}; least of {ROUNDS[count]}")
        for name, spent in seconds.items():
            ratios = [spent / seconds[other] for other in ("SciPy's spline", "kernel")]
            print(f"  {name:20} {spent * 1e3:12.4f} ms {ratios[0]:8.2f} {ratios[1]:8.2f}")
        own = {part: f"{spent * 1e3:.3f}" for part, spent in answer.seconds.items() if spent > 1e-6}
        print(f"  parts of the last one, ms: {own}")


def test_values(capsys: Any) -> None:
    """Values at one time and at many, beside SciPy's piecewise polynomial."""
    model = MinimumSnap(*path(1000, "uniform"))
    plan = ct.solve(model, "banded").plan
    other = plan.to_ppoly()
    many = np.linspace(model.times[0], model.times[-1], 100_000)
    with capsys.disabled():
        print("\nvalues of 1,000 segments: one time, µs; its acceleration, µs; 100,000 times, ms")
        for name, curve in (("plan", plan), ("PPoly", other)):
            # Apart: many times leave nothing else in the processor's cache.
            calls = {"one": partial(curve, 5.3), "bend": partial(curve, 5.3, 2)}
            one, bend = least(calls, 2000)[0].values()
            (long,) = least({"many": partial(curve, many)}, 20)[0].values()
            print(f"  {name:8} {one * 1e6:8.1f} {bend * 1e6:8.1f} {long * 1e3:8.1f}")
    np.testing.assert_allclose(plan(many), other(many), atol=1e-9)
