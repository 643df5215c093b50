"""Smoothing by lines of sight: no longer, in free cells by geometry, and near the optimum."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from grid_path.grids import maze, movingai
from scipy.sparse.csgraph import dijkstra

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import GridPath
from crosstrack.models.grid_path import GridMap, GridPlan, Sight, path_between
from crosstrack.models.grid_path.sight import sees
from crosstrack.solvers import Control, Limit
from crosstrack.solvers.contract.backend import Request
from crosstrack.solvers.grid_path.smoothing import ShortcutVisibility, farthest, shortest, smooth

GO = np.zeros(1, np.int8)


def length(path):
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def walks(seed, count, most=25):
    """Yield maps with a path along neighbours from one cell to another."""
    rng = np.random.default_rng(seed)
    while count:
        blocked = rng.random(rng.integers(1, most, 2)) < rng.choice([0.0, 0.1, 0.3])
        free = np.argwhere(~blocked)
        if not len(free):
            continue
        scale = 10.0 ** rng.choice([-6, 0, 6])
        grid = GridMap(blocked, cell=scale, origin=rng.uniform(-1, 1, 2) * scale * 100)
        start, goal = free[rng.integers(len(free), size=2)]
        cells = path_between(grid, start, goal)
        if not len(cells):
            continue
        count -= 1
        yield GridPath(grid, start, goal, connectivity="any"), grid.centres(cells)


@pytest.mark.parametrize("how", ["greedy", "visibility"])
def test_paths_get_shorter_and_stay_free(how):
    gains = []
    for model, path in walks(1, 25):
        grid = model.map
        found = smooth(grid, path, how)
        best = ct.solve(model, "any-angle").primal_bound
        assert model.verify(GridPlan((found,))).ok
        assert best * (1 - 1e-9) <= length(found) <= length(path) * (1 + 1e-9)
        np.testing.assert_allclose(found[[0, -1]], path[[0, -1]], rtol=1e-12)
        cells = (found - grid.origin) / grid.cell
        rows, columns = np.nonzero(np.pad(grid.blocked, 1, constant_values=True))
        walls = shapely.union_all(shapely.box(columns - 1, rows - 1, columns, rows))
        if len(cells) > 1:
            assert not shapely.linestrings(cells).intersects(walls.buffer(-1e-6))
        gains.append(length(found) / length(path) if length(path) else 1.0)
    assert np.mean(gains) < 0.97


def test_greedy_is_algorithm_4():
    """Each point is joined with the farthest later one in sight, here found from the front."""
    for model, path in walks(2, 30):
        sight = Sight(model.map)
        cells = sight.cells(path)
        kept = [0]
        while kept[-1] < len(path) - 1:
            seen = [
                k for k in range(kept[-1] + 1, len(path)) if sight.between(path[kept[-1]], path[k])
            ]
            kept.append(max(seen))
        assert farthest(sight.blocked, cells, sight.slack, GO).tolist() == kept
        np.testing.assert_allclose(smooth(model.map, path, "greedy"), path[kept], rtol=1e-12)


def test_shortest_path_over_lines_of_sight_is_that_of_dijkstra():
    for model, path in walks(3, 30):
        sight = Sight(model.map)
        points = sight.cells(path)
        n = len(points)
        graph = np.zeros((n, n))
        for i in range(n):
            for j in range(i + 1, n):
                if sees(sight.blocked, *points[i].tolist(), *points[j].tolist(), sight.slack):
                    graph[i, j] = np.hypot(*(points[j] - points[i]))
        known = dijkstra(graph, indices=0)[-1]
        kept = shortest(sight.blocked, points, sight.slack, GO)
        assert kept[0] == 0 and kept[-1] == n - 1
        assert length(points[kept]) == pytest.approx(known, abs=1e-9)


def test_between_any_points():
    """Points that are no centres, some of them the same, and one that leads back."""
    grid = GridMap(["....@...", "....@...", "........"], cell=0.3, origin=(0.1, -7.7))
    ends = np.array(
        [[0.2, 0.3], [0.2, 0.3], [3.7, 2.9], [5.2, 2.1], [3.9, 2.5], [5, 2.05], [7.9, 0.01]]
    )
    path = grid.origin + ends * 0.3
    model = GridPath(grid, (0, 0), (0, 7), connectivity="any")
    for how in ("greedy", "visibility"):
        found = smooth(grid, path, how)
        checks = {one.name: one for one in model.verify(GridPlan((found,))).checks}
        assert checks["keeps to free cells"].ok
        assert length(found) < length(path)
    corners = grid.origin + np.array([[0.2, 0.3], [4, 2], [5, 2], [7.9, 0.01]]) * 0.3
    np.testing.assert_allclose(found, corners, rtol=1e-12)


def test_mazes():
    """Without loops there is one way, and so the taut string is the optimum."""
    grid = GridMap(maze(101, 4))
    model = GridPath(grid, (0, 0), (100, 100), connectivity="any")
    path = grid.centres(path_between(grid, (0, 0), (100, 100)))
    best = ct.solve(model, "any-angle").primal_bound
    assert length(smooth(grid, path)) == pytest.approx(best, rel=1e-9)


def test_short_paths():
    grid = GridMap(["..", ".@"])
    for path in ([[0.5, 0.5]], [[0.5, 0.5], [1.5, 0.5]], [[0.5, 0.5], [0.5, 0.5]]):
        for how in ("greedy", "visibility"):
            assert length(smooth(grid, path, how)) == length(np.array(path))


def test_stopped_smoothing_keeps_the_path():
    for model, path in walks(4, 5):
        sight, stop = Sight(model.map), np.ones(1, np.int8)
        cells = sight.cells(path)
        assert farthest(sight.blocked, cells, sight.slack, stop).tolist() == list(range(len(path)))
        assert len(shortest(sight.blocked, cells, sight.slack, stop)) == (
            1 if len(path) == 1 else 0
        )
    control = Control()
    control.stop(Limit.TIME)
    answer = ShortcutVisibility().run(model, Request(control=control))
    assert answer.point is None and answer.limit is Limit.TIME


@pytest.mark.parametrize(
    ("path", "how", "words"),
    [
        ([[0.5, 0.5], [2.5, 0.5]], "greedy", "segment 0"),
        ([[0.5, 0.5], [0.5, 1.5], [9.5, 1.5]], "visibility", "segment 1"),
        ([], "greedy", "path"),
        ([[0.5, float("nan")]], "greedy", "path"),
        ([[0.5, 0.5]], "spline", "how"),
    ],
)
def test_bad_paths_are_refused(path, how, words):
    with pytest.raises(InvalidData, match=words):
        smooth(GridMap([".@.", "..."]), path, how)


@pytest.mark.parametrize("name", ["den312d", "random-64-64-20", "room-32-32-4", "maze-32-32-2"])
def test_mean_excess_over_the_optimum(name):
    """Within 0.5 % in the mean over scenarios of shared maps."""
    grid, cases = movingai(name)
    excess = []
    for start, goal, _ in cases[:: len(cases) // 8]:
        model = GridPath(grid, start, goal, connectivity="any")
        best = ct.solve(model, "any-angle").primal_bound
        found = ct.solve(model, "shortcut-visibility").primal_bound
        excess.append(found / best - 1 if best else 0.0)
    assert min(excess) > -1e-9
    assert np.mean(excess) < 0.005
