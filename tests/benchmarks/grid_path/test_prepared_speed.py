"""Queries of a prepared map beside pyastar2d, networkx, SciPy and ``ct.solve``, in one process.

All times are CPU seconds of this process. pyastar2d solves an easier problem, see ``test_grid_speed.py``. SciPy
searches from the start to all cells. networkx and ``ct.solve`` get few scenarios. The overhead of a query is its time
without the search. Every length is compared with the published one. The first test writes the table "prepared" of
``docs/measured/grid-path.json``. Run with ``make bench``, or::

    pytest tests/benchmarks/grid_path/test_prepared_speed.py -s
"""

from __future__ import annotations

import itertools
import time
from typing import Any

import numpy as np
import pytest
from benchmarks.measured import write
from grid_path.grids import SCENARIOS, as_printed, graph, movingai
from scipy.sparse.csgraph import dijkstra

import crosstrack as ct
from crosstrack.models import GridPath

#: Scenarios of each map, and those of slow peers.
MANY, FEW = 200, 8
#: Columns of the table.
PEERS = ("prepared", "ct.solve", "pyastar2d", "SciPy", "networkx")


def per_query(call: Any, cases: Any) -> float:
    """Return the mean CPU time of a query in milliseconds; the first one is not timed."""
    call(*cases[0][:2])
    begin = time.process_time()
    for start, goal, _ in cases:
        call(start, goal)
    return (time.process_time() - begin) / len(cases) * 1e3


@pytest.mark.timeout(0)
@pytest.mark.parametrize("name", SCENARIOS)
def test_queries_by_map(name: str, capsys: Any) -> None:
    """Print times, ratios to the prepared map, and its overhead beyond the search."""
    grid, cases = movingai(name)
    hard = [case for case in cases if float(case[2]) > 0]
    many = hard[:: max(1, len(hard) // MANY)]
    few = many[:: max(1, len(many) // FEW)]
    prepared = ct.prepare(grid)
    for start, goal, printed in many:
        assert as_printed(prepared.path(start, goal).objective, printed)
    times = {"prepared": per_query(prepared.path, many)}
    # The searches alone, with the arguments of the same queries.
    ends = {
        (start, goal): (*map(int, grid.numbers_of([start])), grid.numbers_of([goal]), True)
        for start, goal, _ in many
    }
    search = per_query(lambda a, b: prepared._search(*ends[a, b]), many)
    overhead = times["prepared"] - search
    times["ct.solve"] = per_query(lambda a, b: ct.solve(GridPath(grid, a, b), "jump-point"), few)
    try:
        import pyastar2d

        floats = np.where(grid.blocked, np.inf, 1.0).astype(np.float32)
        times["pyastar2d"] = per_query(
            lambda a, b: pyastar2d.astar_path(floats, a, b, allow_diagonal=True), many
        )
    except ImportError:
        print("pyastar2d is not installed")
    steps, columns = graph(grid), grid.shape[1]
    times["SciPy"] = per_query(
        lambda a, b: dijkstra(steps, directed=False, indices=a[0] * columns + a[1])[b[0] * columns + b[1]],
        few,
    )  # fmt: skip
    try:
        import networkx

        known = networkx.from_scipy_sparse_array(steps)
        times["networkx"] = per_query(
            lambda a, b: networkx.dijkstra_path_length(
                known, a[0] * columns + a[1], b[0] * columns + b[1]
            ),
            few[:3],
        )
    except ImportError:
        print("networkx is not installed")
    with capsys.disabled():
        print(f"\n{name}: {grid.shape[0]} × {grid.shape[1]} cells, overhead {overhead:.3f} ms")
        for label, value in times.items():
            print(f"  {label:10} {value:9.3f} ms, ratio {value / times['prepared']:8.2f}")
    row = [name, grid.blocked.size, overhead, *(times.get(peer) for peer in PEERS)]
    columns = {"map": "", "cells": "d", "beyond the search": ".3f"} | dict.fromkeys(PEERS, ".3f")
    said = "CPU time per query in milliseconds."
    write("grid-path", "prepared", __file__, columns, [row], ("numba", "scipy"), said, merge=True)


@pytest.mark.parametrize("name", ["den520d", "maze512-8-0"])
def test_distances_after_changes(name: str, capsys: Any) -> None:
    """Print the time to block and free cells and to repair the distances, relative to a new search."""
    grid, _ = movingai(name)
    prepared = ct.prepare(grid)
    free = np.argwhere(~grid.blocked)
    start, rng = free[len(free) // 2], np.random.default_rng(0)
    other = free[(free != start).any(axis=1)]
    prepared.distances(start)
    lines = []
    for count in (1, 10, 100):
        spent = {"new": 0.0, "repaired": 0.0}
        drawn = [other[rng.integers(len(other), size=count)] for _ in range(10)]
        for cells, blocked in itertools.product(drawn, (True, False)):
            begin = time.process_time()
            prepared.change(cells, blocked)
            repaired = prepared.distances(start)
            spent["repaired"] += time.process_time() - begin
            prepared._fields.clear()
            begin = time.process_time()
            new = prepared.distances(start)
            spent["new"] += time.process_time() - begin
            np.testing.assert_array_equal(repaired, new)
        lines.append((count, spent["new"] / 20 * 1e3, spent["repaired"] / spent["new"]))
    with capsys.disabled():
        print(f"\n{name}")
        for count, new, ratio in lines:
            print(f"  {count:4} changed cells: new {new:.3f} ms, with repair {ratio:.2f} of it")
