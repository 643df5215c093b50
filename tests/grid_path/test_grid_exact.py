"""Exact searches along neighbours: equality with SciPy on small maps and on large mazes."""

import itertools
import threading

import numpy as np
import pytest
from grid_path.grids import costs, graph, keeps_the_rules, maze, optimum, serpentine, small
from hypothesis import given, settings, strategies as st
from scipy.sparse.csgraph import dijkstra

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.models import GridPath
from crosstrack.models.grid_path import GridMap, distances, path_between, search_kernels
from crosstrack.models.grid_path.search_kernels import (
    DIAGONAL,
    STOPPED,
    STRAIGHT,
    sweep,
    sweep_in,
    trace,
)
from crosstrack.solvers.contract.backend import Request
from crosstrack.solvers.contract.registry import find_backend
from crosstrack.solvers.grid_path import heap_kernels, jump_kernels, native
from crosstrack.solvers.grid_path.exact import AStar, Dijkstra, JumpPoint
from crosstrack.solvers.grid_path.heap_kernels import back, weighted
from crosstrack.solvers.grid_path.jump_kernels import jump, jump_in

EXACT = ["a-star", "dijkstra", "jump-point"]


def backends_for(model):
    """Return the names of the exact backends that accept `model`."""
    plain = model.connectivity == "8" and model.weights is None
    return EXACT if plain else EXACT[:2]


def holds(model, solution, best):
    """Assert that a solution is the optimum, proven and verified."""
    if best == np.inf:
        assert solution.termination == "infeasible", solution
        return
    assert solution.termination == "optimal", solution
    assert solution.verification.ok, solution.summary()
    assert solution.primal_bound == pytest.approx(best, rel=1e-12, abs=1e-15)
    assert solution.gap <= 1e-9
    for path in solution.plan.paths:
        assert keeps_the_rules(
            model.map.blocked, model.map.cells_of(path), model.connectivity == "8"
        )


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_all_equal_scipy_on_small_maps(seed):
    model = small(seed)
    best = optimum(model)
    for name in backends_for(model):
        holds(model, ct.solve(model, name), best)


def test_random_models_cover_all_cases():
    models = [small(seed) for seed in range(300)]
    bests = np.array([optimum(model) for model in models])
    assert 30 < np.isinf(bests).sum() < 150
    assert sum(best == 0 for best in bests) > 10
    assert sum((~model.map.blocked).sum() == 1 for model in models) > 5
    assert sum(len(model.goals) > len(np.unique(model.goals, axis=0)) for model in models) > 30
    for reach in ("nearest", "each"):
        for connectivity in ("4", "8"):
            wanted = [m for m in models if (m.reach, m.connectivity) == (reach, connectivity)]
            assert sum(m.weights is not None for m in wanted) > 10


@pytest.mark.parametrize("side", [300, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("loops", [0.0, 0.1])
def test_large_mazes(loops, side):
    """From corner to corner, through corridors one cell wide."""
    blocked = maze(side, 7, loops)
    model = GridPath(GridMap(blocked), (0, 0), np.subtract(blocked.shape, 1))
    best = optimum(model)
    assert np.isfinite(best) and best > 1.4 * side
    for backend in (AStar(), Dijkstra(), JumpPoint()):
        answer = backend.run(model, Request())
        assert answer.primal_bound == answer.dual_bound == pytest.approx(best, rel=1e-12)
        cells = model.map.cells_of(answer.point.paths[0])
        assert keeps_the_rules(blocked, cells)
        assert (cells[0] == model.start).all() and (cells[-1] == model.goals[0]).all()
        length = np.hypot(*np.diff(answer.point.paths[0], axis=0).T).sum()
        assert length == pytest.approx(best, rel=1e-12)


@pytest.mark.parametrize("connectivity", ["4", "8"])
def test_a_corridor_to_and_fro(connectivity):
    """No lower bound helps: the path leads through every corridor."""
    blocked = serpentine(61)
    model = GridPath(GridMap(blocked), (0, 0), (60, 60), connectivity=connectivity)
    best = optimum(model)
    assert best > 900
    for name in backends_for(model):
        holds(model, ct.solve(model, name), best)


def test_open_maps_where_every_path_ties():
    """Millions of paths tie, and the searches still expand few cells."""
    model = GridPath(GridMap(np.zeros((300, 300), bool)), (0, 0), (299, 100))
    best = 199 + 100 * np.sqrt(2)
    for name in EXACT:
        holds(model, ct.solve(model, name), best)
    assert ct.solve(model, "a-star").statistics["cells expanded"] < 1000
    assert ct.solve(model, "jump-point").statistics["cells expanded"] < 10


def test_many_goals_from_one_search():
    rng = np.random.default_rng(3)
    blocked = rng.random((120, 90)) < 0.25
    blocked[60, 40] = False
    free = np.argwhere(~blocked)
    joined = np.isfinite(costs(GridPath(GridMap(blocked), (60, 40), free)))
    goals = free[joined][rng.integers(joined.sum(), size=15)]
    each = GridPath(GridMap(blocked, cell=0.2), (60, 40), goals, reach="each")
    near = GridPath(GridMap(blocked, cell=0.2), (60, 40), goals)
    one = ct.solve(each, "dijkstra")
    for name in EXACT:
        holds(each, ct.solve(each, name), optimum(each))
        holds(near, ct.solve(near, name), optimum(near))
    assert len(one.plan.paths) == 15
    assert one.statistics["cells expanded"] <= free.shape[0]
    lengths = [np.hypot(*np.diff(path, axis=0).T).sum() for path in one.plan.paths]
    np.testing.assert_allclose(lengths, costs(each), rtol=1e-12)


def test_corners_are_not_cut():
    """A path does not pass between two blocked cells that touch, and detours around one."""
    beside = GridPath(GridMap(["..", "@."]), (0, 0), (1, 1))
    closed = GridPath(GridMap([".@", "@."]), (0, 0), (1, 1))
    for name in EXACT:
        holds(beside, ct.solve(beside, name), 2.0)
        holds(closed, ct.solve(closed, name), np.inf)


@pytest.mark.parametrize("ratio", [1e6, 1e12, 1e300])
def test_weights_far_apart(ratio):
    """A detour over light cells costs less than one heavy cell, however heavy."""
    weights = np.ones((5, 9))
    weights[:4, 4] = ratio
    for connectivity in ("4", "8"):
        model = GridPath(
            GridMap(np.zeros((5, 9), bool)),
            (0, 0),
            (0, 8),
            connectivity=connectivity,
            weights=weights,
        )
        for name in EXACT[:2]:
            holds(model, ct.solve(model, name), optimum(model))
        assert optimum(model) == pytest.approx(16 if connectivity == "4" else 8 * np.sqrt(2))


def test_integer_costs_compare_as_lengths():
    """Sums of both costs have the order and the ties of the true lengths."""
    from fractions import Fraction

    assert abs(DIAGONAL**2 - 2 * STRAIGHT**2) == 1  # a convergent, by Pell's equation
    assert STRAIGHT > 2**26
    assert 2**26 * DIAGONAL < 2**53
    # The nearest that a + b √2 comes to 0 for |b| up to STRAIGHT is at earlier convergents.
    p, q = 1, 1
    while q < STRAIGHT:
        exact = (p * p > 2 * q * q) - (p * p < 2 * q * q)  # the sign of p - q √2
        scaled = p * STRAIGHT - q * DIAGONAL
        assert (scaled > 0) - (scaled < 0) == exact
        p, q = p + 2 * q, p + q
    assert Fraction(p, q) == Fraction(DIAGONAL, STRAIGHT)


def test_rejects_unsupported_models():
    free = GridMap(["...", "..."])
    any_angle = GridPath(free, (0, 0), (1, 2), connectivity="any")
    four = GridPath(free, (0, 0), (1, 2), connectivity="4")
    heavy = GridPath(free, (0, 0), (1, 2), weights=np.ones((2, 3)))
    for name, model, word in [
        *((name, any_angle, "'any'") for name in EXACT),
        ("jump-point", four, "'4'"),
        ("jump-point", heavy, "weights"),
    ]:
        with pytest.raises(UnsupportedFormulation, match=f"{name}.*{word}"):
            ct.solve(model, name)


def test_they_stop_when_asked():
    """Every kernel polls the flag between cells."""
    grid = GridMap(np.zeros((60, 60), bool))
    flag = np.ones(1, np.int8)
    start, goals = int(grid.numbers_of((0, 0))), grid.numbers_of([(59, 59)])
    assert sweep(grid.walls, 62, start, goals, False, True, True, flag)[0] == STOPPED
    assert jump(grid.walls, 62, start, goals, flag)[0] == STOPPED
    ones = np.ones(grid.walls.size)
    assert weighted(grid.walls, ones, 62, start, goals, False, True, True, flag)[0] == STOPPED
    request = Request()
    request.control.stop("time")
    model = GridPath(grid, (0, 0), (59, 59))
    for backend in (AStar(), Dijkstra(), JumpPoint()):
        answer = backend.run(model, request)
        assert (answer.termination, answer.limit, answer.point) == ("no_solution", "time", None)


def test_a_time_limit_ends_a_long_search():
    blocked = np.zeros((2500, 2500), bool)
    blocked[-2:, -2:] = [[True, True], [True, False]]  # the goal in a pocket: all must be searched
    model = GridPath(GridMap(blocked), (0, 0), (2499, 2499))
    ct.solve(GridPath(GridMap(np.zeros((200, 200), bool)), (0, 0), (9, 9)), "dijkstra")
    solution = ct.solve(model, "dijkstra", time_limit=0.05)
    assert (solution.termination, solution.limit) == ("no_solution", "time")


def test_distances_equal_scipy():
    rng = np.random.default_rng(1)
    for diagonal, share, cell in ((True, 0.35, 0.5), (False, 0.2, 3.0), (True, 0.0, 1e-4)):
        grid = GridMap(rng.random((40, 70)) < share, cell=cell)
        free = np.argwhere(~grid.blocked)
        cells = free[rng.integers(len(free), size=30)]
        cells[5] = cells[3]  # at one place
        places = cells @ [70, 1]
        far = dijkstra(graph(grid, diagonal), directed=False, indices=places)[:, places]
        found = distances(grid, cells, diagonal=diagonal)
        np.testing.assert_allclose(found, far, rtol=1e-13)
        assert (found == found.T).all() and (np.diag(found) == 0).all()
        assert np.isinf(found).any() == (share == 0.35)


def test_paths_between_cells_have_their_distance():
    rng = np.random.default_rng(2)
    grid = GridMap(rng.random((30, 45)) < 0.35)
    free = np.argwhere(~grid.blocked)
    cells = free[rng.integers(len(free), size=12)]
    for diagonal in (True, False):
        far = distances(grid, cells, diagonal=diagonal)
        for i in range(12):
            for j in range(12):
                path = path_between(grid, cells[i], cells[j], diagonal=diagonal)
                assert (len(path) == 0) == np.isinf(far[i, j])
                if len(path):
                    assert keeps_the_rules(grid.blocked, path, diagonal)
                    assert (path[0] == cells[i]).all() and (path[-1] == cells[j]).all()
                    length = np.hypot(*np.diff(path, axis=0).T).sum()
                    assert length == pytest.approx(far[i, j], rel=1e-12)


def test_distances_name_the_cell_that_is_not_free():
    grid = GridMap(["..@"])
    with pytest.raises(InvalidData, match=r"cells.*\[0, 2\] in row 1"):
        distances(grid, [(0, 0), (0, 2)])
    with pytest.raises(InvalidData, match=r"goal.*\[1, 0\]"):
        path_between(grid, (0, 0), (1, 0))


def test_interpreted_kernels_equal_compiled():
    """Interpreted and compiled kernels return the same results."""
    blocked = maze(31, 2, 0.2)
    grid = GridMap(blocked)
    start, goals = int(grid.numbers_of((0, 0))), grid.numbers_of([(30, 30), (12, 4), (30, 30)])
    flag, weights = np.zeros(1, np.int8), np.random.default_rng(0).random(grid.walls.size) + 0.1
    for every, diagonal, guided in itertools.product((False, True), repeat=3):
        how = (33, start, goals, every, diagonal, guided, flag)
        for loop, maps in ((sweep, (grid.walls,)), (weighted, (grid.walls, weights))):
            for mine, theirs in zip(loop(*maps, *how), loop.py_func(*maps, *how), strict=True):
                np.testing.assert_array_equal(mine, theirs)
    _, left, _, _ = sweep(grid.walls, 33, start, goals, True, True, False, flag)
    path = trace.py_func(grid.walls, 33, left, goals[0], True)
    np.testing.assert_array_equal(path, trace(grid.walls, 33, left, goals[0], True))
    near = jump(grid.walls, 33, start, goals, flag)
    assert jump.py_func(grid.walls, 33, start, goals, flag)[:3] == near[:3]
    np.testing.assert_array_equal(back.py_func(near[3], near[1]), back(near[3], near[1]))


def test_threads_search_at_once():
    """Concurrent runs share only the map, which is read-only."""
    model = GridPath(GridMap(maze(101, 5, 0.1)), (0, 0), (100, 100))
    best, found = optimum(model), []
    AStar().run(model, Request())
    threads = [
        threading.Thread(target=lambda: found.append(AStar().run(model, Request()).primal_bound))
        for _ in range(4)
    ]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert found == pytest.approx([best] * 4, rel=1e-12)


class Countdown:
    """Stop flag that is set after a number of polls."""

    def __init__(self, polls):
        self.polls = polls

    def __getitem__(self, _):
        self.polls -= 1
        return self.polls < 0


@pytest.mark.parametrize("case", range(6))
def test_stopped_searches_return_a_first_path_and_a_bound(case, monkeypatch):
    """Whenever the search stops, the path is valid and the bound holds."""
    rng = np.random.default_rng(case)
    grid = GridMap(maze(41, case, 0.1), cell=0.5)
    free = np.argwhere(~grid.blocked)
    model = GridPath(
        grid,
        free[0],
        free[rng.integers(len(free) // 2, len(free), size=3)],
        connectivity="8" if case % 2 else "4",
        reach="each" if case % 3 == 0 else "nearest",
        weights=rng.uniform(1.0, 3.0, grid.shape) if case < 2 else None,
    )
    best = optimum(model)
    monkeypatch.setattr(native, "LARGE", 0)
    monkeypatch.setattr(search_kernels, "sweep_in", sweep_in.py_func)
    monkeypatch.setattr(jump_kernels, "jump_in", jump_in.py_func)
    kernels = (
        (search_kernels, "sweep", sweep),
        (heap_kernels, "weighted", weighted),
        (jump_kernels, "jump", jump),
    )
    for name in backends_for(model):
        bounds = []
        for polls in (0, 1, 8, 60, 700):
            for module, name_of_kernel, kernel in kernels:

                def stopping(*arguments, kernel=kernel, polls=polls):
                    return kernel.py_func(*arguments[:-1], Countdown(polls))

                monkeypatch.setattr(module, name_of_kernel, stopping)
            answer = find_backend(name, model).run(model, Request(time_limit=60.0))
            bounds.append(answer.dual_bound)
            assert answer.dual_bound <= best * (1 + 1e-12) <= answer.primal_bound * (1 + 2e-12)
            assert model.verify(answer.point).ok
            assert polls > 0 or answer.termination == "feasible"
        assert bounds == sorted(bounds)
        assert bounds[-1] > bounds[0] or bounds[0] == pytest.approx(best)
