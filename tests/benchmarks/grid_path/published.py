"""MovingAI's scenarios beside the lengths printed with them, and paths in any direction beside the shortest.

``python tests/benchmarks/grid_path/published.py`` writes ``docs/measured/grid-path.json``; it needs the public
maps that the tests read.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from statistics import mean, median
from typing import Any

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parents[2])]

from benchmarks.measured import write  # noqa: E402
from grid_path.grids import SCENARIOS, as_printed, movingai  # noqa: E402

from crosstrack.jit import compile_always  # noqa: E402
from crosstrack.models import GridPath  # noqa: E402
from crosstrack.solvers.contract.backend import Request  # noqa: E402
from crosstrack.solvers.grid_path.any_angle import AnyAngle  # noqa: E402
from crosstrack.solvers.grid_path.exact import JumpPoint  # noqa: E402
from crosstrack.solvers.grid_path.rrt_star import RRTStar  # noqa: E402
from crosstrack.solvers.grid_path.smoothing import ShortcutGreedy, ShortcutVisibility  # noqa: E402
from crosstrack.solvers.grid_path.theta_star import ThetaStar  # noqa: E402

#: Scenarios of each map.
COUNT = 40
BACKENDS = (ShortcutGreedy, ShortcutVisibility, ThetaStar, RRTStar)


def timed(backend: Any, model: GridPath) -> tuple[Any, float]:
    """Return the answer of a run and its milliseconds, the tables of the map included."""
    request = Request(options=backend.checked_options({}))
    begin = time.perf_counter()
    answer = backend.run(model, request)
    return answer, (time.perf_counter() - begin) * 1e3


def lengths() -> None:
    """Compare the lengths of all scenarios with the printed ones."""
    rows = []
    for name in SCENARIOS:
        grid, cases = movingai(name)
        timed(JumpPoint(), GridPath(grid, *cases[-1][:2]))  # compiles
        apart, same, spent = [], 0, []
        for start, goal, printed in cases:
            model = GridPath(grid, start, goal)
            answer, milliseconds = timed(JumpPoint(), model)
            assert model.verify(answer.point).ok
            same += as_printed(answer.primal_bound, printed) if float(printed) else True
            apart.append(abs(answer.primal_bound - float(printed)) / max(float(printed), 1.0))
            spent.append(milliseconds)
        rows.append(
            (name, "{} x {}".format(*grid.shape), len(cases), same, max(apart), median(spent))
        )
        print(*rows[-1], flush=True)
    columns = {
        "map": "", "cells": "", "scenarios": "", "equal to the digits printed": "",
        "largest relative difference": ".0e", "median ms": ".2g",
    }  # fmt: skip
    write("grid-path", "movingai", __file__, columns, rows, ("numba",))


def smoothing() -> None:
    """Measure by how much paths in any direction exceed the shortest, over scenarios of all maps."""
    excess: dict[str, list[float]] = {one.name: [] for one in BACKENDS}
    spent: dict[str, list[float]] = {one.name: [] for one in (AnyAngle, *BACKENDS)}
    count = 0
    for name in SCENARIOS:
        grid, cases = movingai(name)
        models = [
            GridPath(grid, start, goal, connectivity="any")
            for start, goal, _ in cases[:: max(len(cases) // COUNT, 1)]
            if start != goal
        ]
        count += len(models)
        shortest: list[Any] = []
        for kind in (AnyAngle, *BACKENDS):
            timed(kind(), models[-1])  # compiles
            for number, model in enumerate(models):
                answer, milliseconds = timed(kind(), model)
                spent[kind.name].append(milliseconds)
                if kind is AnyAngle:
                    shortest.append(answer.primal_bound)
                elif answer.point is not None:
                    assert model.verify(answer.point).ok
                    excess[kind.name].append(answer.primal_bound / shortest[number] - 1)
        print(name, flush=True)
    rows = [("any-angle", count, 0.0, 0.0, median(spent["any-angle"]))]
    for name, found in excess.items():
        rows.append((name, len(found), mean(found), max(found), median(spent[name])))
    columns = {
        "backend": "", "paths found": "", "mean excess": ".2%", "worst": ".1%", "median ms": ".2g",
    }  # fmt: skip
    said = f"{count} scenarios of {len(SCENARIOS)} maps."
    write("grid-path", "smoothing", __file__, columns, rows, ("numba",), said)


if __name__ == "__main__":
    compile_always()
    lengths()
    smoothing()
