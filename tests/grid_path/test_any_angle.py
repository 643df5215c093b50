"""Paths in any direction: comparison with brute force and geometry, and bounds on heuristics."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from grid_path.grids import maze
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

import crosstrack as ct
from crosstrack.errors import UnsupportedFormulation, UnsupportedOption
from crosstrack.models import GridPath
from crosstrack.models.grid_path import GridMap, Sight, line_of_sight
from crosstrack.models.grid_path.sight import convex_corners, sees
from crosstrack.solvers import Control, Limit, Termination
from crosstrack.solvers.contract.backend import Request
from crosstrack.solvers.grid_path.any_angle import STOPPED, AnyAngle, search
from crosstrack.solvers.grid_path.free_paths import line_tables

#: Maximum distance, in cells, between connected corners of mazes in brute force.
NEAR = 20
HEURISTICS = ("theta-star", "shortcut-greedy", "shortcut-visibility", "rrt-star")


class Walls:
    """Blocked cells as polygons; the region outside the map is blocked."""

    def __init__(self, blocked):
        padded = np.pad(blocked, 1, constant_values=True)
        rows, columns = np.nonzero(padded)
        cells = shapely.box(columns - 1, rows - 1, columns, rows)
        self.inner = shapely.buffer(shapely.union_all(cells), -1e-9, join_style="mitre")
        shapely.prepare(self.inner)
        a, b, c, d = padded[:-1, :-1], padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:]
        y, x = np.nonzero((a == d) & (b == c) & (a != b))
        self.pinches = shapely.multipoints(np.column_stack([x, y]))

    def clear(self, lines):
        """Return whether each line stays in free cells, and not between two that touch."""
        away = shapely.distance(lines, self.pinches)
        return ~shapely.intersects(lines, self.inner) & ~(away < 1e-7)


def drawn(rng, most=9):
    """Return blocked cells: noise, rooms, narrow strips, with at least one free cell."""
    shape = rng.integers(1, most + 1, 2)
    blocked = rng.random(shape) < rng.choice([0.0, 0.1, 0.3, 0.5])
    if rng.random() < 0.4:
        line = rng.integers(shape)
        blocked[line[0]] = True
        blocked[:, line[1]] = rng.random() < 0.5
        blocked[line[0], rng.integers(shape[1])] = False
    blocked[tuple(rng.integers(shape))] = False
    return blocked


def drawn_model(rng, **more):
    blocked = drawn(rng)
    free = np.argwhere(~blocked)
    start, goal = free[rng.integers(len(free), size=2)]
    return GridPath(GridMap(blocked), start, goal, connectivity="any", **more)


def by_brute_force(model):
    """Return the distance over all points of the lattice, with sight by geometry; inf if none."""
    blocked = model.map.blocked
    rows, columns = blocked.shape
    lattice = np.stack(np.meshgrid(np.arange(columns + 1), np.arange(rows + 1)), -1).reshape(-1, 2)
    points = np.vstack([model.start[::-1] + 0.5, model.goals[:, ::-1] + 0.5, lattice])
    tails, heads = np.triu_indices(len(points), 1)
    apart = np.hypot(*(points[heads] - points[tails]).T)
    lines = shapely.linestrings(np.stack([points[tails], points[heads]], axis=1))
    seen = (apart > 0) & Walls(blocked).clear(lines)
    graph = np.zeros((len(points), len(points)))
    graph[tails[seen], heads[seen]] = apart[seen]
    found = dijkstra(graph, directed=False, indices=0)[1 : 1 + len(model.goals)]
    found[(model.goals == model.start).all(axis=1)] = 0.0
    return found * model.map.cell


def assert_clear(model, plan):
    """Assert by independent geometry that the plan's paths stay in free cells."""
    walls = Walls(model.map.blocked)
    for path in plan.paths:
        cells = (path - model.map.origin) / model.map.cell
        if len(cells) > 1:
            assert walls.clear(shapely.linestrings(np.stack([cells[:-1], cells[1:]], 1))).all()


def test_sight_is_that_of_geometry():
    rng = np.random.default_rng(1)
    seen = []
    for _ in range(40):
        blocked = drawn(rng)
        sight, walls = Sight(GridMap(blocked)), Walls(blocked)
        ends = rng.integers(0, 2 * np.array(blocked.shape)[::-1] + 1, (60, 2, 2)) / 2
        ends = ends[(ends[:, 0] != ends[:, 1]).any(axis=1)]
        clear = walls.clear(shapely.linestrings(ends))
        found = [sees(sight.blocked, *(pair.ravel() + 1).tolist(), sight.slack) for pair in ends]
        assert found == clear.tolist()
        turned = [sees(sight.blocked, *(p[::-1].ravel() + 1).tolist(), sight.slack) for p in ends]
        assert turned == found
        seen += found
    assert 0.1 < np.mean(seen) < 0.9


def test_sight_between_any_points_is_that_of_geometry():
    rng = np.random.default_rng(2)
    for scale in (1e-3, 1.0, 1e6):
        blocked = drawn(rng)
        grid = GridMap(blocked, cell=scale, origin=rng.uniform(-3, 3, 2) * scale)
        ends = rng.uniform(0, 1, (200, 2, 2)) * np.array(blocked.shape)[::-1]
        clear = Walls(blocked).clear(shapely.linestrings(ends))
        metres = grid.origin + ends * scale
        assert [line_of_sight(grid, a, b) for a, b in metres] == clear.tolist()


@pytest.mark.parametrize(
    ("text", "a", "b", "expected"),
    [
        (".@\n..", (0, 0), (2, 2), True),  # touches a corner
        (".@\n@.", (0, 0), (2, 2), False),  # between two that touch
        ("..\n@@\n@@\n..", (0, 2), (2, 2), False),  # along the side between two
        ("..\n@@\n..", (0, 1), (2, 1), True),  # along a wall
        ("..@@\n@@..", (0, 1), (4, 1), False),  # along a wall, then between two
        ("..", (0, 0), (2, 0), True),  # along the border
        ("..", (0, 0), (2.5, 0), False),
        ("@", (0, 0), (0, 0), False),
        (".", (1, 1), (1, 1), True),
    ],
)
def test_sight_in_special_places(text, a, b, expected):
    blocked = [[c == "@" for c in line] for line in text.splitlines()]
    padded = np.pad(np.array(blocked), 1, constant_values=True)
    for turned in (False, True):
        cells = padded.T.copy() if turned else padded
        ends = [float(x) + 1 for end in (a, b) for x in (end[::-1] if turned else end)]
        assert sees(cells, *ends, 2e-9) is expected


@pytest.mark.parametrize("count", [35, pytest.param(60, marks=pytest.mark.slow)])
def test_optimum_is_that_of_brute_force(count):
    rng = np.random.default_rng(3)
    ended = []
    for _ in range(count):
        model = drawn_model(rng)
        known = float(by_brute_force(model)[0])
        found = ct.solve(model, "any-angle")
        ended.append(found.termination)
        if math.isinf(known):
            assert found.termination is Termination.INFEASIBLE
            continue
        assert found.termination is Termination.OPTIMAL
        assert found.primal_bound == pytest.approx(known, abs=1e-12)
        assert found.dual_bound == pytest.approx(known, abs=1e-12)
        assert_clear(model, found.plan)
    assert set(ended) == {Termination.OPTIMAL, Termination.INFEASIBLE}


@pytest.mark.parametrize("reach", ["nearest", "each"])
def test_several_goals(reach):
    rng = np.random.default_rng(4)
    for _ in range(8):
        blocked = drawn(rng)
        free = np.argwhere(~blocked)
        cells = free[rng.integers(len(free), size=5)]
        grid = GridMap(blocked, cell=0.25, origin=(-7.3, 1e3))
        model = GridPath(grid, cells[0], cells[1:], connectivity="any", reach=reach)
        known = by_brute_force(model)
        known = float(known.sum() if reach == "each" else known.min())
        found = ct.solve(model, "any-angle")
        if math.isinf(known):
            assert found.termination is Termination.INFEASIBLE
        else:
            assert found.primal_bound == pytest.approx(known, rel=1e-9, abs=1e-9)
        for name in HEURISTICS:
            other = ct.solve(model, name, backend_options={"steps": 50} if "rrt" in name else {})
            assert other.plan is None or other.primal_bound >= known * (1 - 1e-9)


@pytest.mark.parametrize("name", HEURISTICS)
def test_heuristics_are_no_better_than_the_optimum(name):
    rng = np.random.default_rng(5)
    options = {"steps": 300} if name == "rrt-star" else {}
    found = 0
    for _ in range(15):
        model = drawn_model(rng)
        best = ct.solve(model, "any-angle")
        other = ct.solve(model, name, backend_options=options)
        if best.plan is None:
            assert other.termination is Termination.NO_SOLUTION
        elif other.plan is None:
            assert name == "rrt-star"
        else:
            assert other.termination is Termination.FEASIBLE
            assert other.primal_bound >= best.primal_bound * (1 - 1e-12)
            assert_clear(model, other.plan)
            found += 1
    assert found >= 6


CASES = {
    "one free cell": (["@@@", "@.@", "@@@"], (1, 1), (1, 1), 0.0),
    "start is goal": (["...", "..."], (0, 2), (0, 2), 0.0),
    "one row": (["." * 50], (0, 0), (0, 49), 49.0),
    "wall one cell thick": ([".@.", ".@.", "..."], (0, 0), (0, 2), 1 + 2 * math.hypot(0.5, 1.5)),
    "diagonal gap": ([".@.", "@..", "..."], (0, 0), (2, 2), math.inf),
    "around a gap": ([".@.", "..@", "..."], (0, 0), (2, 2), math.sqrt(8)),
    "pocket": (
        ["......", ".@@@@.", ".@....", ".@@@@.", "......"],
        (2, 2),
        (2, 0),
        None,
    ),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("name", ["any-angle", *HEURISTICS])
def test_special_maps(case, name):
    lines, start, goal, known = CASES[case]
    model = GridPath(GridMap(lines), start, goal, connectivity="any")
    known = float(by_brute_force(model)[0]) if known is None else known
    found = ct.solve(model, name)
    if math.isinf(known):
        exact = name == "any-angle"
        assert found.termination is (Termination.INFEASIBLE if exact else Termination.NO_SOLUTION)
        assert found.plan is None
        return
    assert found.primal_bound >= known - 1e-12
    if name in ("any-angle", "shortcut-visibility"):
        assert found.primal_bound == pytest.approx(known, abs=1e-12)
    assert_clear(model, found.plan)


@pytest.mark.parametrize("loops", [pytest.param(0.0, marks=pytest.mark.slow), 0.05])
def test_mazes(loops):
    blocked = maze(25, 6, loops)
    model = GridPath(GridMap(blocked, cell=1e-3), (0, 0), (24, 24), connectivity="any")
    best = ct.solve(model, "any-angle")
    assert best.termination is Termination.OPTIMAL
    assert_clear(model, best.plan)
    # By SciPy over the corners, and geometry between those that are near each other.
    padded = np.pad(blocked, 1, constant_values=True)
    corners = np.argwhere(convex_corners(padded))[:, ::-1] - 1
    points = np.vstack([[0.5, 0.5], [24.5, 24.5], corners])
    apart = np.abs(points[:, None] - points).max(axis=-1)
    tails, heads = np.nonzero(np.triu(apart <= NEAR, 1))
    lines = shapely.linestrings(np.stack([points[tails], points[heads]], axis=1))
    seen = Walls(blocked).clear(lines)
    tails, heads = tails[seen], heads[seen]
    graph = coo_array(
        (np.hypot(*(points[heads] - points[tails]).T), (tails, heads)), (len(points), len(points))
    )
    known = dijkstra(graph.tocsr(), directed=False, indices=0)[1] * 1e-3
    steps = np.abs(np.diff(best.plan.paths[0], axis=0)).max()
    assert steps < NEAR * 1e-3  # so that longer edges would be of no use
    assert best.primal_bound == pytest.approx(known, rel=1e-12)
    for name in HEURISTICS[:3]:
        other = ct.solve(model, name)
        assert other.primal_bound >= best.primal_bound * (1 - 1e-12)
        assert_clear(model, other.plan)


@pytest.mark.slow
@pytest.mark.parametrize("loops", [0.0, 0.05])
def test_huge_mazes(loops):
    model = GridPath(GridMap(maze(1001, 7, loops)), (0, 0), (1000, 1000), connectivity="any")
    best = ct.solve(model, "any-angle")
    assert best.termination is Termination.OPTIMAL
    other = ct.solve(model, "shortcut-visibility")
    # Without loops, the path is unique. With loops, the shortest along neighbours may differ.
    worst = 1.02 if loops else 1 + 1e-9
    assert best.primal_bound * (1 - 1e-12) <= other.primal_bound <= best.primal_bound * worst


def test_interpreted_search_is_the_compiled_one():
    blocked = np.pad(maze(31, 8, 0.1), 1, constant_values=True)
    corners = convex_corners(blocked)
    runs, onward = line_tables(blocked, corners)
    ends = np.array([[1.5, 1.5], [31.5, 31.5]])
    for flag in (0, 1):
        given = (blocked, runs, corners, onward, *ends, np.inf, np.array([flag], np.int8))
        plain, compiled = search.py_func(*given), search.dispatcher(*given)
        assert plain[0] == compiled[0] and plain[1] == compiled[1] and plain[3] == compiled[3]
        assert plain[2].tolist() == compiled[2].tolist()
    assert plain[0] == STOPPED
    assert plain[1] == np.hypot(30, 30)


def test_a_stopped_search_keeps_its_bound():
    model = GridPath(GridMap(maze(31, 8)), (0, 0), [(30, 30), (0, 30)], connectivity="any")
    best = ct.solve(model, "any-angle").primal_bound
    control = Control()
    control.stop(Limit.INTERRUPTED)
    answer = AnyAngle().run(model, Request(control=control))
    assert answer.termination is Termination.NO_SOLUTION and answer.limit is Limit.INTERRUPTED
    assert 0 < answer.dual_bound <= best
    straight = GridPath(GridMap(["..."]), (0, 0), (0, 2), connectivity="any")
    assert AnyAngle().run(straight, Request()).termination is Termination.OPTIMAL


def test_a_search_stopped_after_the_first_goal_keeps_its_path():
    """The distance to the second goal is below the length of the path to the first."""
    lines = [".@.."] * 7 + ["...."]
    model = GridPath(GridMap(lines), (0, 0), [(7, 3), (0, 2)], connectivity="any")

    class Stopping(AnyAngle):
        def leg(self, ground, goal, ceiling, request):
            found = super().leg(ground, goal, ceiling, request)
            request.control.stop(Limit.INTERRUPTED)
            return found

    whole = AnyAngle().run(model, Request())
    answer = Stopping().run(model, Request())
    assert answer.termination is Termination.FEASIBLE and answer.limit is Limit.INTERRUPTED
    assert model.verify(answer.point).ok
    assert answer.dual_bound < whole.primal_bound < answer.primal_bound
    single = GridPath(GridMap(lines), (0, 0), (0, 2), connectivity="any")
    assert Stopping().run(single, Request()).termination is Termination.OPTIMAL


def test_sixteen_thousand_to_one():
    """A map much wider than high has the smallest differences between slopes."""
    rng = np.random.default_rng(9)
    blocked = rng.random((5, 16000)) < 0.02
    blocked[2, [0, -1]] = False
    blocked[:, 8000] = [True, True, False, True, True]
    model = GridPath(GridMap(blocked), (2, 0), (2, 15999), connectivity="any")
    best = ct.solve(model, "any-angle")
    assert best.termination is Termination.OPTIMAL
    assert 15999 <= best.primal_bound <= ct.solve(model, "theta-star").primal_bound
    turned = GridPath(GridMap(blocked.T.copy()), (0, 2), (15999, 2), connectivity="any")
    assert ct.solve(turned, "any-angle").primal_bound == pytest.approx(best.primal_bound, rel=1e-12)


@pytest.mark.parametrize("name", ["any-angle", *HEURISTICS])
def test_far_from_the_origin(name):
    """If coordinates leave four digits of a cell, plans equal those of the map at 0."""
    rng = np.random.default_rng(10)
    for cell in (1e-6, 1.0, 1e6):
        blocked = rng.random((12, 15)) < 0.2
        blocked[0, 0] = blocked[11, 14] = False
        near = GridPath(GridMap(blocked, cell=cell), (0, 0), (11, 14), connectivity="any")
        far = GridMap(blocked, cell=cell, origin=np.array([9e8, -9e8]) * cell)
        more = GridPath(far, (0, 0), (11, 14), connectivity="any")
        options = {"steps": 300} if name == "rrt-star" else {}
        here, there = (ct.solve(m, name, backend_options=options) for m in (near, more))
        assert here.termination is there.termination
        if here.plan is not None:
            assert there.primal_bound == pytest.approx(here.primal_bound, rel=1e-6)


def test_random_trees():
    blocked = np.zeros((20, 30), bool)
    blocked[4:, 10] = blocked[:15, 20] = True
    model = GridPath(GridMap(blocked), (19, 0), (0, 29), connectivity="any")
    best = ct.solve(model, "any-angle").primal_bound

    def solved(**more):
        return ct.solve(model, "rrt-star", **more)

    first, again = solved(seed=5), solved(seed=5)
    assert first.plan.paths[0].tolist() == again.plan.paths[0].tolist()
    assert first.plan.paths[0].tolist() != solved(seed=6).plan.paths[0].tolist()
    short = solved(seed=5, backend_options={"steps": 1000})
    assert best <= first.primal_bound <= short.primal_bound <= 1.2 * best
    assert first.primal_bound <= 1.05 * best
    reported = [one.objective for one in first.incumbents]
    assert len(reported) > 1 and reported == sorted(reported, reverse=True)
    assert solved(seed=5, target=1.3 * best).limit is Limit.TARGET
    with pytest.raises(UnsupportedOption, match="steps"):
        solved(backend_options={"steps": 0})


@pytest.mark.parametrize("name", ["any-angle", *HEURISTICS])
def test_paths_along_neighbours_are_refused(name):
    model = GridPath(GridMap(["..."]), (0, 0), (0, 2))
    with pytest.raises(UnsupportedFormulation, match="connectivity"):
        ct.solve(model, name)
