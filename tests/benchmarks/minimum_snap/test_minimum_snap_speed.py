"""Speed of the native minimum-snap solver beside SciPy's spline, and of its two kinds of kernels.

All solvers of a size are timed in turn within one run, so that what counts is their ratio. Nothing
fails because it is slow; everything fails that is wrong. Run with ``make bench``, or::

    pytest tests/benchmarks/minimum_snap/test_minimum_snap_speed.py -k "snap and 1000"
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import log
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pytest
from benchmarks.ledger import Ledger, Row, duration
from scipy.interpolate import make_interp_spline

from crosstrack.solvers.minimum_snap import banded
from crosstrack.solvers.minimum_snap.hermite import jets_to_coefficients

AXES = 3
SIZES = {10: 500, 100: 500, 1_000: 200, 10_000: 40, 100_000: 10, 1_000_000: 5}
NAMES = {2: "acceleration", 3: "jerk", 4: "snap", 5: "crackle"}
#: Shortest time (s) of the native solver by order and size. The minimum excludes other load from the growth.
FOUND: dict[tuple[int, int], float] = {}


@dataclass(frozen=True, eq=False)
class Path3:
    """Random walk from rest to rest, in the format of each solver."""

    order: int
    times: Any
    values: Any

    @property
    def durations(self) -> Any:
        return np.diff(self.times)

    def native(self, *, fused: bool = True, uneven: bool = False) -> Callable[[], Any]:
        """Return the call from durations and conditions to coefficients."""
        durations, values, weights = self.durations, self.values.copy(), np.eye(self.order)[-1]
        if uneven:
            steps = np.linalg.norm(np.diff(values[:, :, 0], axis=1), axis=0)
            durations = durations.mean() * steps / steps.mean()

        def call() -> Any:
            fixed = np.isfinite(values)
            found = banded.solve_hermite(durations, values, fixed, weights, self.order - 1)
            return found, jets_to_coefficients(durations, found.jets, found.moments)

        if not fused:
            # A velocity that is fixed where the optimum has it: the same path, by other kernels.
            values[:, 1, 1] = call()[0].jets[:, 1, 0, 1]
        return call

    def spline(self) -> Callable[[], Any]:
        """Return the call of SciPy's spline, which ends with B-spline coefficients."""
        points = np.ascontiguousarray(self.values[:, :, 0].T)
        rest = [(j, np.zeros(AXES)) for j in range(1, self.order)]
        degree = 2 * self.order - 1
        return lambda: make_interp_spline(self.times, points, k=degree, bc_type=(rest, rest))


@cache
def path(order: int, count: int) -> Path3:
    rng = np.random.default_rng(count)
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(1.0, 4.0, count))])
    values = np.full((AXES, count + 1, order), np.nan)
    values[:, :, 0] = np.cumsum(rng.normal(size=(AXES, count + 1)), axis=1)
    values[:, [0, -1], 1:] = 0.0
    return Path3(order, times, values)


@pytest.fixture(scope="module", autouse=True)
def compiled() -> None:
    """Compile beforehand, as the first call of a process does; see the cold starts."""
    for order in NAMES:
        path(order, 10).native(fused=False)()
        path(order, 100).native(uneven=True)()


@pytest.mark.parametrize("count", SIZES)
@pytest.mark.parametrize("order", NAMES)
def test_side_by_side(order: int, count: int, benchmark: Any, ledger: Ledger) -> None:
    own = path(order, count)
    calls = {
        "banded": own.native(),
        "durations by distance": own.native(uneven=True),
        "general kernels": own.native(fused=False),
        "make_interp_spline": own.spline(),
    }
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    answers: dict[str, Any] = {name: call() for name, call in calls.items()}

    def turn() -> None:
        for name, call in calls.items():
            begin = time.perf_counter()
            answers[name] = call()
            seconds[name].append(time.perf_counter() - begin)

    for _ in range(max(SIZES[count] // 10, 3)):
        turn()
    benchmark.group = f"minimum {NAMES[order]}, {count:,} segments"
    benchmark.pedantic(calls["banded"], rounds=SIZES[count])

    found, _ = answers["banded"]
    spline = answers["make_interp_spline"]
    for j in range(order):
        other = spline(own.times[:-1], j).T
        allowed = 1e-12 * max(count, 1000)  # what absolute times cost it grows with the path
        assert np.abs(found.jets[:, :, 0, j] - other).max() <= allowed * np.abs(other).max()
    assert found.objective == pytest.approx(answers["general kernels"][0].objective, rel=1e-11)

    title = f"minimum {NAMES[order]}, {count:,} segments, {AXES} axes"
    base = median(seconds["banded"])
    FOUND[order, count] = min(seconds["banded"])
    ledger.titles[title] = f"{title} (own: durations to coefficients)"
    for name, took in seconds.items():
        ratio = (
            f"{median(took) / base:.2f} × banded, {median(took) / count * 1e9:,.0f} ns a segment"
        )
        outcome = ""
        if name != "make_interp_spline":
            own_answer = answers[name][0]
            outcome = f"{own_answer.method}, correction {own_answer.correction:.0e}"
        ledger.rows.append(Row(title, name, took, took, ratio, outcome))
    benchmark.extra_info["ratio to make_interp_spline"] = base / median(
        seconds["make_interp_spline"]
    )


def test_growth(ledger: Ledger) -> None:
    """Slope of log time over log size, from 1,000 segments on."""
    title = "minimum derivative, growth"
    ledger.titles[title] = f"{title} from 1,000 to 1,000,000 segments (wanted: ≤ 1.1)"
    for order, name in NAMES.items():
        ends = [FOUND.get((order, count)) for count in (1_000, 1_000_000)]
        if None in ends:
            pytest.skip("the sizes were not run")
        slope = log(ends[1] / ends[0]) / log(1000)
        ledger.rows.append(Row(title, name, work=f"slope {slope:.2f}"))


# -- processes of their own -----------------------------------------------------------------------

CHILD = """
import json, resource, sys, time
marks = [time.perf_counter()]
import numpy as np
from crosstrack.solvers.minimum_snap.banded import solve_hermite
from crosstrack.solvers.minimum_snap.hermite import jets_to_coefficients
marks.append(time.perf_counter())
count, ratio = {count}, {ratio}
rng = np.random.default_rng(0)
durations = ratio ** rng.uniform(0.0, 1.0, count)
values = np.full((3, count + 1, 4), np.nan)
values[:, :, 0] = np.cumsum(rng.normal(size=(3, count + 1)), axis=1)
values[:, [0, -1], 1:] = 0.0
fixed, weights = np.isfinite(values), np.array([0.0, 0.0, 0.0, 1.0])
def call():
    found = solve_hermite(durations, values, fixed, weights, 3)
    powers = jets_to_coefficients(durations, found.jets, found.moments)
    return found
marks.append(time.perf_counter())
call()
marks.append(time.perf_counter())
found = call()
marks.append(time.perf_counter())
names = ("import", "data", "first solve", "second solve")
answer = {{name: after - before for name, before, after in zip(names, marks, marks[1:])}}
answer["peak"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
answer["method"] = found.method
print(json.dumps(answer))
"""


def start(folder: Path, count: int, ratio: float = 4.0) -> dict[str, Any]:
    """Solve in a process of its own, with its compiled kernels in `folder`."""
    done = subprocess.run(
        [sys.executable, "-c", CHILD.format(count=count, ratio=ratio)],
        env={**os.environ, "NUMBA_CACHE_DIR": str(folder)},
        cwd=folder.parent, capture_output=True, text=True, timeout=280, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


@pytest.mark.parametrize("ratio", [4.0, 400.0], ids=["fused", "general"])
@pytest.mark.parametrize("cache_state", ["empty", "filled"])
def test_cold_start(
    cache_state: str, ratio: float, benchmark: Any, ledger: Ledger, tmp_path: Path
) -> None:
    folder = tmp_path / "kernels"
    found: list[dict[str, Any]] = []
    if cache_state == "filled":
        start(folder, 10, ratio)
    benchmark.group = "minimum snap, cold start"
    benchmark.pedantic(lambda: found.append(start(folder, 10, ratio)), rounds=1)
    title = "minimum snap, cold start"
    ledger.titles[title] = f"{title} (processes of their own, 10 segments; own: the first solve)"
    took = [run["first solve"] for run in found]
    work = f"import {duration(found[0]['import'])}, then {duration(found[0]['second solve'])}"
    ledger.rows.append(
        Row(title, f"{cache_state} cache, ratio {ratio:g}", took, took, work, found[0]["method"])
    )


@pytest.mark.parametrize("ratio", [4.0, 400.0])
def test_a_million_segments(
    ratio: float, benchmark: Any, ledger: Ledger, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("kernels")
    start(folder, 10, ratio)
    found: list[dict[str, Any]] = []
    benchmark.group = "minimum snap, 1,000,000 segments alone"
    benchmark.pedantic(lambda: found.append(start(folder, 1_000_000, ratio)), rounds=1)
    title = "minimum snap, 1,000,000 segments, a process of its own"
    ledger.titles[title] = f"{title} (wanted: about 1 s, 16 GB)"
    took = [run["second solve"] for run in found]
    peak = f"peak {found[0]['peak'] / 1e9:.1f} GB"
    ledger.rows.append(Row(title, f"ratio {ratio:g}", took, took, peak, found[0]["method"]))
