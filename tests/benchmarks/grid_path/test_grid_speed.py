"""Exact searches on MovingAI's maps beside four peers from PyPI, in one run.

Problems solved by the peers:

* pyastar2d (C++) solves an easier problem: it cuts corners, and a diagonal step costs no more than a
  straight one, consistent with its lower bound, the larger of the two differences. Its weights are 4-byte
  floats, and an infinite one blocks a cell.
* scikit-image's ``route_through_array`` cuts corners too, and is Dijkstra's algorithm.
* networkx gets a graph of the very steps that ours may take, whose building is not timed, and the
  octile distance.
* python-pathfinding refuses to cut corners as ours do, and gets the octile distance.

All give a list of cells. Ours is timed as ``Backend.run``, which makes the plan in metres and its
answer, and as the bare search with its path. Nothing fails because it is slow; everything fails that is
wrong. Run with ``make bench``, or::

    pytest tests/benchmarks/grid_path/test_grid_speed.py -s
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any

import numpy as np
import pytest
from grid_path.grids import SCENARIOS, as_printed, graph, movingai
from scipy.sparse.csgraph import dijkstra

from crosstrack.models import GridPath
from crosstrack.models.grid_path import GridMap, distances
from crosstrack.models.grid_path.search_kernels import sweep, trace
from crosstrack.solvers.contract.backend import Request
from crosstrack.solvers.grid_path.exact import AStar, Dijkstra, JumpPoint
from crosstrack.solvers.grid_path.jump_kernels import jump, unroll

#: Scenarios of each map for compiled code, and for peers in plain Python.
MANY, FEW = 100, 7
#: The least time of so many counts, for compiled code.
REPEATS = 3
#: Peers that solve another problem, whose paths have other lengths.
OTHERS = ("pyastar2d", "scikit-image")
ROOT2 = np.sqrt(2.0)

Cells = Any
Search = Callable[[tuple[int, int], tuple[int, int]], Cells]


def octile(a: tuple[int, int], b: tuple[int, int]) -> float:
    """Return the distance between two cells were none blocked."""
    down, across = abs(a[0] - b[0]), abs(a[1] - b[1])
    return float(max(down, across) + (ROOT2 - 1) * min(down, across))


def ours(grid: GridMap, cases: Sequence[Any]) -> dict[str, Search]:
    """Return the backends, and the bare searches below them."""
    flag, width = np.zeros(1, np.int8), grid.shape[1] + 2
    models = {(start, goal): GridPath(grid, start, goal) for start, goal, _ in cases}
    numbers = {cell: int(grid.numbers_of(cell)) for case in cases for cell in case[:2]}

    def of(backend: Any) -> Search:
        def run(start: Any, goal: Any) -> Cells:
            return backend.run(models[start, goal], Request()).point.paths[0]

        return run

    def bare(guided: bool) -> Search:
        def run(start: Any, goal: Any) -> Cells:
            first, last = numbers[start], numbers[goal]
            goals = np.array([last])
            left = sweep(grid.walls, width, first, goals, False, True, guided, flag)[1]
            return trace(grid.walls, width, left, last, True)

        return run

    def bare_jump(start: Any, goal: Any) -> Cells:
        last = numbers[goal]
        parents = jump(grid.walls, width, numbers[start], np.array([last]), flag)[3]
        return unroll(parents, width, last)

    return {
        "a-star": of(AStar()),
        "a-star, bare": bare(True),
        "dijkstra": of(Dijkstra()),
        "dijkstra, bare": bare(False),
        "jump-point": of(JumpPoint()),
        "jump-point, bare": bare_jump,
    }


def peers(grid: GridMap) -> tuple[dict[str, Search], dict[str, Search]]:
    """Return the compiled peers and those in plain Python, as far as they are installed."""
    blocked = grid.blocked
    compiled: dict[str, Search] = {}
    plain: dict[str, Search] = {}
    try:
        import pyastar2d

        floats = np.where(blocked, np.inf, 1.0).astype(np.float32)
        compiled["pyastar2d"] = lambda a, b: pyastar2d.astar_path(floats, a, b, allow_diagonal=True)
    except ImportError:
        print("pyastar2d is not installed")
    try:
        from skimage.graph import route_through_array

        costs = np.where(blocked, -1.0, 1.0)
        plain["scikit-image"] = lambda a, b: route_through_array(costs, a, b)[0]
    except ImportError:
        print("scikit-image is not installed")
    try:
        import networkx

        steps = graph(grid).tocoo()
        cells = list(map(tuple, np.argwhere(np.ones(grid.shape)).tolist()))
        known = networkx.Graph()
        tails, heads = steps.coords
        known.add_weighted_edges_from(
            (cells[i], cells[j], c)
            for i, j, c in zip(tails.tolist(), heads.tolist(), steps.data.tolist(), strict=True)
        )
        plain["networkx"] = lambda a, b: networkx.astar_path(known, a, b, heuristic=octile)
    except ImportError:
        print("networkx is not installed")
    try:
        from pathfinding.core.diagonal_movement import DiagonalMovement
        from pathfinding.core.grid import Grid
        from pathfinding.core.heuristic import octile as theirs
        from pathfinding.finder.a_star import AStarFinder

        walkable = Grid(matrix=(~blocked).astype(int).tolist())
        finder = AStarFinder(
            heuristic=theirs, diagonal_movement=DiagonalMovement.only_when_no_obstacle
        )

        def find(a: tuple[int, int], b: tuple[int, int]) -> Cells:
            walkable.cleanup()
            path, _ = finder.find_path(
                walkable.node(a[1], a[0]), walkable.node(b[1], b[0]), walkable
            )
            return [(node.y, node.x) for node in path]

        plain["python-pathfinding"] = find
    except ImportError:
        print("python-pathfinding is not installed")
    return compiled, plain


def length_of(path: Cells, grid: GridMap) -> float:
    """Return the length of a path in cells, given as their numbers, as cells or as points."""
    points = np.asarray(path, float)
    if points.ndim == 1:
        points = grid.cells_at(np.asarray(path)).astype(float)
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


@pytest.mark.timeout(0)
@pytest.mark.parametrize("name", SCENARIOS)
def test_medians_by_map(name: str, capsys: Any) -> None:
    """Print medians and ratios to pyastar2d; every length of ours is the known one."""
    grid, cases = movingai(name)
    hard = [case for case in cases if float(case[2]) > 0]
    compiled, plain = peers(grid)
    many = hard[:: max(1, len(hard) // MANY)]
    few = many[:: max(1, len(many) // FEW)]
    searches = {**ours(grid, many), **compiled}
    spent: dict[str, dict[Any, float]] = {label: {} for label in (*searches, *plain)}
    other = dict.fromkeys(spent, 0)
    for search in (*searches.values(), *plain.values()):
        search(*few[0][:2])  # compiles, and fills what is kept of a map
    for case in many:
        start, goal, printed = case
        for label, search in {**searches, **(plain if case in few else {})}.items():
            best = np.inf
            for _ in range(1 if label in plain else REPEATS):
                begin = time.perf_counter()
                path = search(start, goal)
                best = min(best, time.perf_counter() - begin)
            spent[label][start, goal] = best
            length = length_of(path, grid)
            right = as_printed(length, printed)
            other[label] += not right
            assert right or label in OTHERS, (label, start, goal, length, printed)
    first = spent["pyastar2d" if "pyastar2d" in spent else "a-star"]
    with capsys.disabled():
        print(
            f"\n{name}: {grid.shape[0]} × {grid.shape[1]} cells; ratios to pyastar2d, if installed"
        )
        for label, times in spent.items():
            same = [first[key] for key in times]
            print(
                f"  {label:20} median {median(times.values()) * 1e3:9.3f} ms, "
                f"ratio of medians {median(times.values()) / median(same):8.2f}, "
                f"of sums {sum(times.values()) / sum(same):8.2f}, {len(times)} scenarios"
                + (f", {other[label]} of another length" if label in OTHERS else "")
            )


@pytest.mark.parametrize("share", [0.0, 0.2])
def test_distances_of_76_nodes(share: float, capsys: Any) -> None:
    """As many as on the paper's map, beside SciPy's Dijkstra on the same steps."""
    rng = np.random.default_rng(0)
    grid = GridMap(rng.random((200, 200)) < share)
    free = np.argwhere(~grid.blocked)
    cells = free[rng.integers(len(free), size=76)]
    places = cells @ [200, 1]

    def theirs() -> Any:
        return dijkstra(graph(grid), directed=False, indices=places)[:, places]

    spent = {}
    for name, call in (("distances", lambda: distances(grid, cells)), ("SciPy", theirs)):
        times, found = [], []
        for _ in range(REPEATS + 1):
            begin = time.perf_counter()
            found.append(call())
            times.append(time.perf_counter() - begin)
        spent[name] = (min(times[1:]), found[-1])
    np.testing.assert_allclose(spent["distances"][1], spent["SciPy"][1], rtol=1e-12)
    with capsys.disabled():
        print(f"\n76 nodes, 200 × 200 cells, {share:.0%} blocked")
        for name, (best, _) in spent.items():
            print(f"  {name:12} {best:7.3f} s, ratio {best / spent['SciPy'][0]:.3f}")
