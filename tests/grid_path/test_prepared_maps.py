"""Prepared maps: equality with Dijkstra's algorithm, with fresh preparations after changes, and the checks."""

import threading

import numpy as np
import pytest
from grid_path.grids import SCENARIOS, as_printed, graph, keeps_the_rules, maze, movingai, optimum
from hypothesis import HealthCheck, given, settings, strategies as st
from scipy.sparse.csgraph import dijkstra

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.models import GridPath
from crosstrack.models.grid_path import GridMap, GridPlan
from crosstrack.models.grid_path.checks import length_along
from crosstrack.solvers.grid_path import prepared as module
from crosstrack.solvers.grid_path.query_kernels import points_along, repair

#: Scenarios of each map that are solved in every run of the tests.
SAMPLE = 150


@pytest.fixture(autouse=True)
def repairs_on_small_maps(monkeypatch):
    """Let small maps repair distances, too; on them the default always starts again."""
    monkeypatch.setattr(module, "SHARE", 0.5)
    monkeypatch.setattr(module, "CHANGED", 0.1)


def random_map(rng, largest=60):
    """Return a map of random cells or a maze, with at least two free cells."""
    rows, columns = rng.integers(2, largest, 2)
    blocked = rng.random((rows, columns)) < rng.choice([0.0, 0.15, 0.3, 0.42])
    if rng.random() < 0.2:
        blocked = maze(int(rows), int(rng.integers(2**31)), loops=0.1)
    blocked[0, 0] = blocked[-1, -1] = False
    return GridMap(blocked, cell=10.0 ** rng.integers(-3, 4), origin=rng.uniform(-9, 9, 2))


def lengths_from(grid, start, diagonal, weights=None):
    """Return the costs of all cells by SciPy, shape (rows, columns)."""
    number = int(np.asarray(start) @ [grid.shape[1], 1])
    far = dijkstra(graph(grid, diagonal, weights), directed=False, indices=number)
    return far.reshape(grid.shape)


@pytest.mark.parametrize("count", [400, pytest.param(10_000, marks=pytest.mark.slow)])
def test_random_queries_equal_dijkstra(count):
    rng = np.random.default_rng(5)
    queries = none = 0
    while queries < count:
        grid = random_map(rng)
        weights = rng.uniform(0.1, 9.0, grid.shape) if rng.random() < 0.25 else None
        prepared = ct.prepare(grid, weights=weights)
        free = np.argwhere(~grid.blocked)
        for start in free[rng.integers(len(free), size=8)]:
            kind = str(rng.choice(["4", "8"]))
            far = lengths_from(grid, start, kind == "8", weights)
            for goal in free[rng.integers(len(free), size=10)]:
                answer = prepared.path(start, goal, connectivity=kind)
                best = far[tuple(goal)]
                assert answer.objective == pytest.approx(best, rel=1e-11, abs=1e-12)
                assert answer.ok == np.isfinite(best)
                assert answer.termination == ("optimal" if answer.ok else "infeasible")
                queries += 1
                none += not answer.ok
                if queries % 100 == 0 and answer.ok:
                    verification = answer.verification()
                    assert verification.ok
                    assert verification.objective == pytest.approx(best, rel=1e-11, abs=1e-12)
                    cells = grid.cells_of(answer.plan.paths[0])
                    assert keeps_the_rules(grid.blocked, cells, kind == "8")
    assert 0.05 * count < none < 0.8 * count


@pytest.mark.parametrize("name", SCENARIOS)
def test_scenarios_have_their_published_lengths(name):
    grid, cases = movingai(name)
    prepared = ct.prepare(grid)
    for start, goal, printed in [*cases[:: max(1, len(cases) // SAMPLE)], cases[-1]]:
        answer = prepared.path(start, goal)
        assert as_printed(answer.objective, printed) if float(printed) else answer.objective == 0
    assert answer.verification().ok


@given(st.integers(0, 2**32 - 1))
@settings(
    max_examples=5, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_changed_maps_equal_fresh_preparations(seed):
    """Paths, distances and proofs of infeasibility are those of a new preparation."""
    rng = np.random.default_rng(seed)
    grid = random_map(rng, largest=16)
    radius = float(rng.choice([0.0, 0.0, 0.9, 2.1])) * grid.cell
    weights = rng.uniform(0.1, 9.0, grid.shape) if rng.random() < 0.2 else None
    try:
        prepared = ct.prepare(grid, radius=radius, weights=weights)
    except InvalidData:
        assert grid.blocked.any() and radius  # the radius left no cell free
        return
    given_cells = grid.blocked.copy()
    for _ in range(6):
        cells = rng.integers(grid.shape, size=(rng.integers(1, 2 + grid.blocked.size // 20), 2))
        states = rng.random(len(cells)) < rng.choice([0.0, 0.4, 1.0])
        wanted = given_cells.copy()
        wanted[tuple(cells.T)] = states
        try:
            fresh = ct.prepare(
                GridMap(wanted, grid.cell, grid.origin), radius=radius, weights=weights
            )
        except InvalidData:
            before = prepared.map.blocked.copy()
            with pytest.raises(InvalidData, match="at least one cell free"):
                prepared.change(cells, states)
            np.testing.assert_array_equal(prepared.map.blocked, before)
            continue
        before = prepared.map.blocked
        count = prepared.change(cells, states)
        given_cells = wanted
        np.testing.assert_array_equal(prepared.map.blocked, fresh.map.blocked)
        assert count == (before != prepared.map.blocked).sum()
        free = np.argwhere(~fresh.map.blocked)
        starts = [free[0], free[-1], free[rng.integers(len(free))]]
        for start, kind in zip(starts, ("8", "4", "8"), strict=True):
            far = fresh.distances(start, connectivity=kind)
            known = prepared.distances(start, connectivity=kind)
            np.testing.assert_array_equal(known, far)
            np.testing.assert_allclose(
                known, lengths_from(fresh.map, start, kind == "8", weights), rtol=1e-11
            )
        for _ in range(6):
            start, *goals = free[rng.integers(len(free), size=4)]
            how = {
                "connectivity": str(rng.choice(["4", "8"])),
                "reach": str(rng.choice(["each", "nearest"])),
            }
            answer, other = prepared.path(start, goals, **how), fresh.path(start, goals, **how)
            best = optimum(GridPath(fresh.map, start, goals, weights=weights, **how))
            assert answer.termination == other.termination
            assert answer.objective == pytest.approx(best, rel=1e-11, abs=1e-12)
            if answer.ok:
                assert answer.verification().ok
                assert len(answer.plan.paths) == (3 if how["reach"] == "each" else 1)


def test_paths_in_any_direction_equal_solve():
    rng = np.random.default_rng(2)
    grid = GridMap(rng.random((25, 30)) < 0.25, cell=0.5)
    prepared = ct.prepare(grid)
    for _ in range(15):
        free = np.argwhere(~prepared.map.blocked)
        start, goal = free[rng.integers(len(free), size=2)]
        answer = prepared.path(start, goal, connectivity="any")
        solution = ct.solve(GridPath(prepared.map, start, goal, connectivity="any"), "any-angle")
        assert answer.termination == solution.termination
        if answer.ok:
            assert answer.objective == pytest.approx(solution.primal_bound, rel=1e-12)
            assert answer.verification().ok
        prepared.change(rng.integers(grid.shape, size=(4, 2)), rng.random(4) < 0.5)


def test_old_answers_fail_on_a_map_that_blocks_them():
    prepared = ct.prepare(GridMap(["....", "....", "...."]))
    answer = prepared.path((1, 0), (1, 3))
    assert answer.ok and answer.verification().ok
    assert prepared.change((1, 2), True) == 1
    assert not answer.verification().ok
    assert prepared.path((1, 0), (1, 3)).objective > answer.objective
    assert prepared.change([(1, 2), (1, 2)], [True, False]) == 1  # the last state counts
    assert prepared.path((1, 0), (1, 3)).objective == answer.objective
    assert prepared.change((1, 2), False) == 0
    prepared.change((1, 3), True)
    with pytest.raises(InvalidData, match="goals"):
        answer.verification()


def test_an_answer_does_not_follow_the_arrays_of_its_query():
    prepared = ct.prepare(GridMap(["....", ".@@.", "...."]))
    start, goals = np.array([0, 0]), np.array([[2, 3], [0, 3]])
    answer = prepared.path(start, goals, reach="each")
    start[:], goals[:] = 2, 2
    assert answer.verification().ok


def test_components_prove_separation_until_cells_are_freed():
    prepared = ct.prepare(GridMap(["." * 20] * 9))
    ends = (4, 0), (4, 19)
    prepared.change([(row, 10) for row in range(9)], True)
    first, again = prepared.path(*ends), prepared.path(*ends)
    assert first.termination == again.termination == "infeasible"
    assert first.expanded > 0 == again.expanded
    prepared.change((0, 5), True)  # blocked cells join no components
    assert prepared.path(*ends).expanded == 0
    prepared.change((8, 10), False)
    assert prepared.path(*ends).ok


def test_a_wrong_search_is_rejected(monkeypatch):
    prepared = ct.prepare(GridMap(["....", ".@@.", "...."], cell=0.5))
    first, last = prepared.map.numbers_of([(0, 0), (2, 3)])
    true = prepared._search(int(first), np.array([last]), True)
    assert prepared.path((0, 0), (2, 3)).ok
    wrong = [
        (true[0] * (1 - 1e-6), true[1], 1),
        (true[0], true[1][::-1], 1),
        (true[0], true[1][:-1], 1),
        (np.sqrt(2) * 2 + 1, np.array([first, first + 14, last]), 1),
        (np.nan, true[1], 1),
    ]
    for result in wrong:
        monkeypatch.setattr(prepared, "_search", lambda *_, result=result: result)
        answer = prepared.path((0, 0), (2, 3))
        assert (answer.termination, answer.plan, answer.objective) == ("rejected", None, np.inf)


@given(st.integers(0, 2**32 - 1))
@settings(
    max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_the_fast_check_equals_the_check_of_the_model(seed):
    """Random walks, some of them valid, with points moved and steps changed."""
    rng = np.random.default_rng(seed)
    grid = random_map(rng, largest=7)
    free = np.argwhere(~grid.blocked)
    start = free[rng.integers(len(free))]
    steps = rng.integers(-1, 2, (rng.integers(0, 6), 2))
    if rng.random() < 0.5:
        steps = steps[np.abs(steps).sum(axis=1) > 0]
    cells = np.cumsum(np.vstack([start, steps]), axis=0)
    goal = cells[-1] if grid.holds(cells[-1]) and rng.random() < 0.9 else free[0]
    points = grid.centres(cells)
    if rng.random() < 0.3:
        points = points + grid.cell * rng.choice([1e-7, 1e-5, 0.1]) * rng.choice(
            [-1, 1], points.shape
        )
    weights = rng.uniform(0.5, 2.0, grid.shape) if rng.random() < 0.5 else None
    for kind in ("4", "8"):
        model = GridPath(grid, start, goal, connectivity=kind, weights=weights)
        verification = model.verify(GridPlan((points,)))
        arguments = (
            grid.blocked, np.empty((0, 0)) if weights is None else weights, points, grid.origin,
            grid.cell, np.array([start, goal]), kind == "8", 1.001e-6,
        )  # fmt: skip
        length = length_along(*arguments)
        assert length == length_along.py_func(*arguments)
        assert (length >= 0) == verification.ok
        if length >= 0:
            assert length * grid.cell == pytest.approx(verification.objective, rel=1e-5)


def test_the_fast_check_refuses_points_that_are_not_finite():
    for bad in (np.nan, np.inf, -np.inf, 1e300):
        points = np.array([[0.5, 0.5], [bad, 0.5]])
        how = (np.zeros(2), 1.0, np.array([[0, 0], [0, 1]]), True, 1e-6)
        assert length_along(np.zeros((1, 2), bool), np.empty((0, 0)), points, *how) == -1.0


def test_wild_maps():
    one = ct.prepare(GridMap(["."]))
    answer = one.path((0, 0), (0, 0))
    assert answer.ok and answer.objective == 0 and len(answer.plan.paths[0]) == 1
    assert one.distances((0, 0)).tolist() == [[0.0]]
    with pytest.raises(InvalidData, match="at least one cell free"):
        one.change((0, 0), True)
    assert one.path((0, 0), (0, 0)).ok
    with pytest.raises(InvalidData):
        ct.prepare(GridMap(["@"]))
    with pytest.raises(InvalidData):
        ct.prepare(GridMap([".@"]), radius=5.0)
    row = ct.prepare(GridMap(["." * 50 + "@" + "." * 9]))
    assert row.path((0, 0), (0, 49)).objective == 49
    assert row.path((0, 0), (0, 59)).termination == "infeasible"
    assert row.change((0, 50), False) == 1 and row.path((0, 0), (0, 59)).objective == 59
    assert row.change(np.empty((0, 2), int), True) == 0


@pytest.mark.parametrize("side", [700, pytest.param(2000, marks=pytest.mark.slow)])
def test_a_map_of_many_cells(side):
    grid = GridMap(np.random.default_rng(1).random((side, side)) < 0.2)
    prepared = ct.prepare(grid)
    free = np.argwhere(~grid.blocked)
    for start, goal in ((free[0], free[-1]), (free[7], free[900])):
        for kind in ("4", "8"):
            answer = prepared.path(start, goal, connectivity=kind)
            model = GridPath(grid, start, goal, connectivity=kind)
            assert answer.objective == pytest.approx(ct.solve(model).primal_bound, rel=1e-12)


def test_arrays_are_cleared_when_the_ceiling_is_reached(monkeypatch):
    grid = GridMap(maze(21, 3, 0.2))
    prepared = ct.prepare(grid)
    monkeypatch.setattr(module, "LARGEST", 5 * prepared._step)
    free = np.argwhere(~grid.blocked)
    rng = np.random.default_rng(0)
    for _ in range(60):
        start, goal = free[rng.integers(len(free), size=2)]
        for kind in ("4", "8"):
            best = lengths_from(grid, start, kind == "8")[tuple(goal)]
            answer = prepared.path(start, goal, connectivity=kind)
            assert answer.objective == pytest.approx(best, rel=1e-12)
            assert prepared._ceiling <= module.LARGEST


@pytest.mark.parametrize("share", [0.0, 0.02, 1.0])
def test_repaired_and_recomputed_distances_are_equal(share, monkeypatch):
    monkeypatch.setattr(module, "SHARE", share)
    monkeypatch.setattr(module, "CHANGED", share)
    rng = np.random.default_rng(8)
    prepared = ct.prepare(GridMap(rng.random((40, 40)) < 0.3))
    for _ in range(25):
        free = np.argwhere(~prepared.map.blocked)
        for start in (free[0], free[-1]):
            np.testing.assert_allclose(
                prepared.distances(start), lengths_from(prepared.map, start, True), rtol=1e-12
            )
        prepared.change(rng.integers(40, size=(5, 2)), rng.random(5) < 0.5)


def test_queries_from_the_start_of_a_distance_field_need_no_search():
    rng = np.random.default_rng(4)
    grid = GridMap(rng.random((30, 30)) < 0.3)
    prepared = ct.prepare(grid)
    free = np.argwhere(~grid.blocked)
    far = prepared.distances(free[3])
    for goal in free[::17]:
        answer = prepared.path(free[3], goal)
        assert answer.objective == pytest.approx(far[tuple(goal)], rel=1e-12)
        assert answer.expanded == 0


def test_bad_input_names_field_and_value():
    prepared = ct.prepare(GridMap(["..@", "..."]))
    for call, word in [
        (lambda: prepared.path((0, 2), (0, 0)), r"start.*\[0, 2\]"),
        (lambda: prepared.path((0, 0), [(0, 1), (5, 0)]), r"goals.*\[5, 0\]"),
        (lambda: prepared.path((-1, 0), (0, 0)), r"start.*\[-1, 0\]"),
        (lambda: prepared.path((0, 0.5), (0, 0)), "start"),
        (lambda: prepared.path((0, 0), []), "goals"),
        (lambda: prepared.path((0, 0), (0, 1), connectivity="6"), "connectivity"),
        (lambda: prepared.path((0, 0), (0, 1), reach="all"), "reach"),
        (lambda: prepared.path((0, 0), (0, 1), connectivity=8), "connectivity"),
        (lambda: prepared.distances((0, 0), connectivity="any"), "connectivity"),
        (lambda: prepared.distances((0, 2)), "start"),
        (lambda: prepared.change((0, 3), True), r"cells\[0\].*\[0, 3\]"),
        (lambda: prepared.change((0, 0), 0.5), "blocked"),
        (lambda: prepared.change([(0, 0), (0, 1)], [True]), "blocked"),
        (lambda: ct.prepare(GridMap([".."]), radius=-1), "radius"),
        (lambda: ct.prepare(GridMap([".."]), weights=[[1.0, 0.0]]), "weights"),
    ]:
        with pytest.raises(InvalidData, match=word):
            call()
    heavy = ct.prepare(GridPath(GridMap([".."]), (0, 0), (0, 1), weights=[[1.0, 3.0]]))
    assert heavy.path((0, 0), (0, 1)).objective == 2.0
    with pytest.raises(InvalidData, match="weights"):
        heavy.path((0, 0), (0, 1), connectivity="any")
    for options in ({"backend": "a-star"}, {"speed": 3}, {"time_limit": 1.0}):
        with pytest.raises(UnsupportedOption, match=f"weights and radius.*{next(iter(options))}"):
            ct.prepare(GridMap([".."]), **options)
    for bad in ([".."], np.zeros((2, 2)), None):
        with pytest.raises(
            InvalidData, match="grid maps and sideslip models: model must be a Model"
        ):
            ct.prepare(bad)


def test_threads_share_a_map():
    grid = GridMap(maze(61, 5, 0.1))
    prepared = ct.prepare(grid)
    best, results = optimum(GridPath(grid, (0, 0), (60, 60))), []

    def work():
        for _ in range(20):
            results.append(prepared.path((0, 0), (60, 60)).objective)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == pytest.approx([best] * 80, rel=1e-12)


def test_interpreted_kernels_equal_compiled():
    grid = GridMap(maze(15, 2, 0.3))
    prepared = ct.prepare(grid)
    prepared.distances((0, 0))
    left = prepared._fields[1 * 17 + 1, True][0]
    prepared.change([(0, 2), (3, 3), (6, 5)], [True, False, True])
    changed = prepared.map.numbers_of([(0, 2), (3, 3), (6, 5)])
    one, other = left.copy(), left.copy()
    how = (changed, 18, True, 10**6)
    count = repair(prepared.map.walls, 17, one, *how)
    assert count == repair.py_func(prepared.map.walls, 17, other, *how) > 0
    np.testing.assert_array_equal(one, other)
    turns = np.array([18, 18 + 3 * 18, 18 + 3 * 18 + 2])
    points = points_along(turns, 17, 0.5, np.array([1.0, -2.0]))
    np.testing.assert_array_equal(
        points, points_along.py_func(turns, 17, 0.5, np.array([1.0, -2.0]))
    )
    np.testing.assert_array_equal(
        points,
        GridMap(["."] * 1, 0.5, [1, -2]).centres([(0, 0), (1, 1), (2, 2), (3, 3), (3, 4), (3, 5)]),
    )


def test_inflation_weights_follow_the_formula():
    grid = GridMap(["." * 30 + "@"], cell=0.1)
    weights = grid.inflation_weights(radius=1.0, peak=11.0, decay=3.0, inscribed=0.25)
    for column in range(30):
        apart = 0.1 * (30 - column)
        wanted = 1 + 10 * np.exp(-3.0 * max(apart - 0.25, 0.0)) if apart <= 1.0 + 1e-9 else 1.0
        assert weights[0, column] == pytest.approx(wanted) or apart == pytest.approx(1.0)
    assert weights[0, 30] == 11.0 and weights[0, 28] == 11.0 and weights[0, 0] == 1.0
    assert (GridMap(["..."]).inflation_weights(5.0, 9.0, 1.0) == 1.0).all()
    for bad in ({"radius": -1.0}, {"peak": 0.5}, {"decay": np.nan}, {"inscribed": -0.1}):
        with pytest.raises(InvalidData, match=next(iter(bad))):
            grid.inflation_weights(**{"radius": 1.0, "peak": 2.0, "decay": 1.0, **bad})


def test_inflation_weights_keep_paths_away_from_walls():
    """The path of lowest cost is that of the linear program, and not the shortest one."""
    grid = GridMap(["." * 9, "..@@@@@..", "." * 9, "." * 9, "." * 9])
    weights = grid.inflation_weights(2.5, 30.0, 0.7)
    model = GridPath(grid, (2, 0), (2, 8), weights=weights)
    answer = ct.prepare(grid, weights=weights).path((2, 0), (2, 8))
    for backend in ("a-star", "dijkstra", "highs"):
        assert ct.solve(model, backend).primal_bound == pytest.approx(answer.objective, rel=1e-9)
    assert answer.plan.length > ct.prepare(grid).path((2, 0), (2, 8)).objective == 8.0
    assert answer.plan.paths[0][:, 1].max() == 4.5
