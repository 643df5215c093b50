"""Our solvers for trajectories, quadratic solvers and a peer from PyPI, compared in one run.

Wrong results fail the test, slowness does not. The output gives median times and
their ratios to our own solver. Run with ``make bench``, or::

    pytest tests/benchmarks/minimum_snap/test_trajectory_rivals.py -s
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.instances.minimum_snap import corridor, random_walk
from crosstrack.models import MinimumSnap, Trajectory

#: Quadratic solvers on the Legendre program, by the seconds that one run of them is worth.
QUADRATIC = ("piqp", "clarabel", "osqp", "cvxpy")


def seconds_of(call: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    """Return the median time of a call, and its last result."""
    spent, result = [], None
    for _ in range(repeats):
        begin = time.perf_counter()
        result = call()
        spent.append(time.perf_counter() - begin)
    return median(spent), result


def printed(capsys: Any, title: str, rows: Sequence[tuple[str, float | None, str]]) -> None:
    """Print seconds and ratios to the first row."""
    base = rows[0][1]
    with capsys.disabled():
        print(f"\n{title}")
        for name, spent, remark in rows:
            shown = "-" if spent is None else f"{spent * 1e3:.3f} ms"
            ratio = "" if spent is None or base is None else f"{spent / base:.1f}"
            print(f"  {name:28} {shown:>14} {ratio:>9}  {remark}")


def solved(model: MinimumSnap, backend: str, limit: float) -> tuple[float | None, Any, str]:
    """Return the solver's own seconds, its answer, and how it ended."""
    answer = ct.solve(model, backend, time_limit=limit)
    own = answer.seconds["solve"] + answer.seconds.get("polish", 0.0)
    ended = f"{answer.termination}" + (f", {answer.limit}" if answer.limit else "")
    return (own if answer.termination == "optimal" else None), answer, ended


def spline(model: MinimumSnap) -> Any:
    """Return SciPy's spline through the waypoints, at rest at both ends."""
    from scipy.interpolate import make_interp_spline

    rest = [(order, np.zeros(model.dimensions)) for order in (1, 2, 3)]
    return make_interp_spline(model.times, model.waypoints, k=7, bc_type=(rest, rest))


def peer(model: MinimumSnap) -> Any:
    """Return the trajectory of minsnap-trajectories, by its closed form."""
    minsnap = pytest.importorskip(
        "minsnap_trajectories", reason="minsnap_trajectories is not installed"
    )
    rest = np.zeros(model.dimensions)
    points = [
        minsnap.Waypoint(time=float(t), position=w)
        if 0 < k < model.segments
        else minsnap.Waypoint(
            time=float(t), position=w, velocity=rest, acceleration=rest, jerk=rest
        )
        for k, (t, w) in enumerate(zip(model.times, model.waypoints, strict=True))
    ]
    return minsnap.generate_trajectory(
        points, degree=7, idx_minimized_orders=4, num_continuous_orders=4, algorithm="closed-form"
    )


@pytest.mark.parametrize("count", [10, 100, 1000])
def test_waypoints(count: int, limit: float, capsys: Any) -> None:
    model = random_walk(count, seed=count)
    ct.solve(model, "banded")
    repeats = 50 if count <= 100 else 10
    runs = [ct.solve(model, "banded") for _ in range(repeats)]
    best = runs[0].primal_bound
    rows: list[tuple[str, float | None, str]] = [
        ("banded", median(r.seconds["solve"] for r in runs), "seconds.solve, plan included"),
        ("SciPy's spline", seconds_of(lambda: spline(model), repeats)[0], "make_interp_spline"),
    ]
    if count <= 100:  # its matrices are dense
        spent, found = seconds_of(lambda: peer(model), 3)
        coefficients = np.asarray(found.coefficients)
        rows.append(
            ("minsnap-trajectories", spent, f"closed form, {coefficients.shape} coefficients")
        )
    for name in QUADRATIC:
        spent, answer, ended = solved(model, name, limit)
        rows.append((name, spent, ended))
        if answer.termination == "optimal":
            assert answer.primal_bound == pytest.approx(best, rel=2e-6)
    printed(capsys, f"minimum snap through {count + 1} waypoints in 3-D", rows)


@pytest.mark.parametrize("count", [10, 100, 1000])
def test_corridor(count: int, limit: float, capsys: Any) -> None:
    model = corridor(count, seed=0)
    ct.solve(model, "interior-point")
    runs = [ct.solve(model, "interior-point") for _ in range(3)]
    best = runs[0]
    assert best.termination == "optimal"
    rows: list[tuple[str, float | None, str]] = [
        ("interior-point", median(r.seconds["solve"] for r in runs), f"gap {best.gap:.1e}")
    ]
    agreed = 0
    # A long corridor takes the others minutes: two of them are enough, and may take that long.
    rivals, patience = (QUADRATIC, limit) if count < 1000 else (QUADRATIC[:2], max(limit, 300.0))
    for name in rivals:
        spent, answer, ended = solved(model, name, patience)
        if answer.termination == "optimal":
            off = abs(answer.primal_bound / best.primal_bound - 1)
            ended += f", objective differs by {off:.1e}"
            agreed += off <= 1e-6
        rows.append((name, spent, ended))
    assert agreed >= 2
    printed(capsys, f"corridor of {count} boxes in 3-D with limits", rows)


def test_long_corridor(capsys: Any) -> None:
    model = corridor(10_000, seed=0)
    answer = ct.solve(model, "interior-point")
    assert answer.termination == "optimal"
    assert answer.gap is not None
    assert answer.gap <= 1e-6
    remark = f"gap {answer.gap:.1e}, {answer.statistics['iterations']} Newton steps in all"
    printed(
        capsys,
        "corridor of 10000 boxes in 3-D with limits",
        [("interior-point", answer.seconds["solve"], remark)],
    )


def test_cold_start(capsys: Any) -> None:
    """Time of the first call in a process, with compiled code in the cache."""
    rows: list[tuple[str, float | None, str]] = []
    for backend, name in (("banded", "random-10"), ("interior-point", "corridor-10")):
        code = (
            "import time; begin = time.perf_counter(); import crosstrack as ct; "
            f"answer = ct.solve(ct.load('minimum-snap/{name}'), '{backend}'); "
            "print(time.perf_counter() - begin, answer.seconds['compile'])"
        )
        subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
        out = subprocess.run(
            [sys.executable, "-c", code], check=True, capture_output=True, text=True
        ).stdout.split()
        rows.append((backend, float(out[0]), f"of which compilation {float(out[1]) * 1e3:.0f} ms"))
    printed(capsys, "cold start: import, load, first solve; code compiled before", rows)


def test_plans_are_the_same_curve() -> None:
    model = random_walk(30, seed=30)
    plan = ct.solve(model, "banded").plan
    assert isinstance(plan, Trajectory)
    t = np.linspace(model.times[0], model.times[-1], 500)
    assert np.abs(plan(t) - spline(model)(t)).max() <= 1e-10
