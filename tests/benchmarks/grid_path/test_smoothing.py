"""Paths in any direction on MovingAI's maps: how much longer than the optimum, and how fast.

The optimum is that of ``any-angle``. Times are those of ``Backend.run``, the map's tables included, and
for the shortcuts A* too; RRT* has its 5000 points. Nothing fails because it is slow or long; everything
fails that is wrong, or shorter than the optimum. Run with ``make bench``, or::

    pytest tests/benchmarks/grid_path/test_smoothing.py -s
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from statistics import mean, median
from typing import Any

import pytest

from crosstrack.jit import compile_always
from crosstrack.models import GridPath
from crosstrack.solvers import Termination
from crosstrack.solvers.backend import Request
from crosstrack.solvers.grid_path.any_angle import AnyAngle
from crosstrack.solvers.grid_path.rrt_star import RRTStar
from crosstrack.solvers.grid_path.shortcut import ShortcutGreedy, ShortcutVisibility
from crosstrack.solvers.grid_path.theta_star import ThetaStar

sys.path.append(str(Path(__file__).resolve().parents[2]))
from grid_path.grids import SCENARIOS, movingai

#: Scenarios of each map.
COUNT = 40
BACKENDS = (ShortcutGreedy, ShortcutVisibility, ThetaStar, RRTStar)

_excess: dict[str, list[float]] = {one.name: [] for one in BACKENDS}


def timed(backend: Any, model: GridPath) -> tuple[Any, float]:
    """Return the answer of a run and its milliseconds."""
    request = Request(options=backend.checked_options({}))
    begin = time.perf_counter()
    answer = backend.run(model, request)
    return answer, (time.perf_counter() - begin) * 1e3


@pytest.mark.parametrize("name", SCENARIOS)
def test_excess_over_the_optimum(name: str, capsys: Any) -> None:
    compile_always()
    grid, cases = movingai(name)
    models = [
        GridPath(grid, start, goal, connectivity="any")
        for start, goal, _ in cases[:: max(len(cases) // COUNT, 1)]
        if start != goal
    ]
    timed(AnyAngle(), models[-1])  # compiles
    best = [timed(AnyAngle(), model) for model in models]
    assert all(answer.termination is Termination.OPTIMAL for answer, _ in best)
    spent = [one for _, one in best]
    lines = [
        f"{name}, {len(models)} scenarios{'mean excess':>20} {'worst':>8} {'median ms':>10} {'worst':>8}",
        f"  {'any-angle, the optimum':42} {'':8} {median(spent):10.2f} {max(spent):8.1f}",
    ]
    for kind in BACKENDS:
        timed(kind(), models[-1])
        excess, spent, none = [], [], 0
        for model, (known, _) in zip(models, best, strict=True):
            answer, one = timed(kind(), model)
            spent.append(one)
            if answer.point is None:
                none += 1
                continue
            assert model.verify(answer.point).ok
            assert answer.primal_bound >= known.primal_bound * (1 - 1e-12)
            excess.append(answer.primal_bound / known.primal_bound - 1)
        _excess[kind.name] += excess
        without = f"   none in {none}" if none else ""
        shown = f"{mean(excess):9.3%} {max(excess):8.2%}" if excess else f"{'':18}"
        lines.append(f"  {kind.name:33}{shown} {median(spent):10.2f} {max(spent):8.1f}{without}")
    with capsys.disabled():
        print("\n" + "\n".join(lines))


def test_mean_excess_over_all_maps(capsys: Any) -> None:
    """Over the scenarios of the maps above; asked of the path over lines of sight: 0.5 %."""
    if not all(_excess.values()):
        pytest.skip("runs after the maps")
    with capsys.disabled():
        print("\nall maps")
        for name, excess in _excess.items():
            print(f"  {name:33}{mean(excess):9.3%} {max(excess):8.2%}   of {len(excess)} paths")
    assert mean(_excess["shortcut-visibility"]) < 0.005
