"""Paths through waypoints: their values by other means, and refused data."""

import itertools
from fractions import Fraction
from math import floor, hypot

import numpy as np
import pytest
import shapely
from scipy.ndimage import label
from scipy.optimize import differential_evolution

import crosstrack as ct
from crosstrack.errors import InvalidData, UnknownName
from crosstrack.instances.black_box.paths import PATHS, path_grid, path_instance
from crosstrack.instances.grid_path import maze, random_cells, rooms
from crosstrack.models import BlackBoxMinimisation, GridPath
from crosstrack.models.black_box import WaypointPath, as_grid_plan, path_problem
from crosstrack.models.grid_path import GridMap
from crosstrack.models.model import Model

#: Two blocked cells that touch at (2, 2).
PINCH = GridMap(["....", "..@.", ".@..", "...."])


def path(grid, start, goal, *points, penalty=10.0):
    """Return the value of one path; coordinates in cells."""
    function = WaypointPath(grid, start, goal, len(points), penalty)
    return float(function.values(np.array(points, float).reshape(1, -1))[0])


def sides(grid, line):
    """Return what is counted as blocked of a polyline in whole or broken cells, by exact fractions."""

    def free(row, column):
        return bool(grid.holds((row, column)))

    def around(x, y):
        columns = {floor(x), floor(x) - (x == floor(x))}
        rows = {floor(y), floor(y) - (y == floor(y))}
        return [cell for cell in itertools.product(sorted(rows), sorted(columns)) if free(*cell)]

    def apart(cells):
        (a, b), (c, d) = cells
        return abs(a - c) == abs(b - d) == 1 and not free(a, d) and not free(c, b)

    points = [tuple(map(Fraction, point)) for point in line]
    last, total, inside, least = around(*points[0])[0], 0.0, 0.0, 0
    for (ax, ay), (bx, by) in itertools.pairwise(points):
        cuts = {Fraction(0), Fraction(1)}
        for a, b in ((ax, bx), (ay, by)):
            low, high = sorted((a, b))
            cuts |= {(n - a) / (b - a) for n in range(floor(low), floor(high) + 1) if a != b}
        length = hypot(bx - ax, by - ay)
        for t, u in itertools.pairwise(sorted(cut for cut in cuts if 0 <= cut <= 1)):
            middle = (t + u) / 2
            cells = around(ax + middle * (bx - ax), ay + middle * (by - ay))
            if cells:
                least |= apart((last, cells[0]))
                total, inside, least, last = total + max(inside, least), 0.0, 0, cells[0]
            else:
                inside += float(u - t) * length
        here = around(bx, by)
        least |= len(here) == 2 and apart(here)
    least |= apart((last, around(*points[-1])[0]))
    return total + max(inside, least)


def by_shapely(grid, line):
    """Return the length of a polyline within blocked cells or beyond the map, in cells."""
    rows, columns = grid.shape
    cells = [shapely.box(c, r, c + 1, r + 1) for r, c in np.argwhere(grid.blocked)]
    frame = shapely.box(-99, -99, columns + 99, rows + 99) - shapely.box(0, 0, columns, rows)
    solid = shapely.union_all([*cells, frame])
    found = 0.0
    for segment in itertools.pairwise(line):
        part = shapely.LineString(segment)
        found += part.intersection(solid).length - part.intersection(solid.boundary).length
    return found


def touching(blocked):
    """Whether two blocked cells touch at a corner alone."""
    a, b, c, d = blocked[:-1, :-1], blocked[:-1, 1:], blocked[1:, :-1], blocked[1:, 1:]
    return bool(((a == d) & (b == c) & (a != b)).any())


def small(seed):
    """Return a small map, two free cells of it, and paths between them: half of them on the lattice."""
    rng = np.random.default_rng(seed)
    rows, columns = rng.integers(1, 9, 2)
    blocked = rng.random((rows, columns)) < (0.0, 0.2, 0.45, 0.6, 1.0)[seed % 5]
    blocked[tuple(rng.integers(blocked.shape))] = False
    free = np.argwhere(~blocked)
    ends = free[rng.integers(len(free), size=2), ::-1] + 0.5
    points = rng.uniform(-2, [columns + 2, rows + 2], (24, 4, 2))
    points[::2] = np.round(2 * points[::2]) / 2
    points[::8, 1] = points[::8, 0]
    points[1::8] = np.clip(points[1::8], 0, [columns, rows])
    return GridMap(blocked), ends, points


@pytest.mark.parametrize("seed", range(15))
def test_values_by_exact_fractions_and_by_shapely(seed):
    grid, (start, goal), points = small(seed)
    function = WaypointPath(grid, start, goal, 4, 7.0)
    values = function.values(points.reshape(len(points), -1))
    for line, value in zip(function.polylines(points), values, strict=True):
        length = np.hypot(*np.diff(line, axis=0).T).sum()
        counted = (value - length) / 7.0
        assert counted == pytest.approx(sides(grid, line), abs=1e-9)
        # Corners between two blocked cells count besides.
        assert counted >= by_shapely(grid, line) - 1e-7
        if not touching(grid.blocked):
            assert counted == pytest.approx(by_shapely(grid, line), abs=1e-7)


@pytest.mark.parametrize("cell", [2.0**-20, 0.3, 1e6])
def test_values_grow_with_the_cells_wherever_they_lie(cell):
    for seed in range(1, 10):
        grid, ends, points = small(seed)
        rows = points.reshape(len(points), -1)
        values = WaypointPath(grid, *ends, 4, 7.0).values(rows)
        origin = cell * np.array([1e4, -3e3])
        moved = GridMap(grid.blocked, cell, origin)
        function = WaypointPath(moved, *(origin + cell * ends), 4, 7.0)
        found = function.values((origin + cell * points).reshape(len(points), -1))
        # Points on a side stay there, except at corners that a line meets only by chance.
        assert found / cell == pytest.approx(values, rel=1e-8, abs=1e-7)


def test_the_side_of_a_blocked_cell_is_free_and_the_one_between_two_is_not():
    grid = GridMap(["....", ".@@.", ".@@.", "...."])
    ends = (0.5, 1.0), (3.5, 1.0)
    assert path(grid, *ends, (2, 1)) == 3.0
    assert path(grid, (0.5, 2.0), (3.5, 2.0), (2, 2)) == 3.0 + 10 * 2.0
    assert path(grid, (0.5, 0.5), (0.5, 3.5), (0, 2)) == pytest.approx(2 * np.hypot(0.5, 1.5))
    # The border of the map is free where the cell beside it is, and nothing beyond.
    assert path(grid, (0.5, 0.5), (0.5, 3.5), (0, 0), (0, 4)) == pytest.approx(4 + 2 * 0.5**0.5)
    assert path(grid, (0.0, 0.0), (0.0, 4.0), (-1, 0), (-1, 4)) == 6 + 10 * 6
    tight = GridMap(["@@@", "@.@", "@@@"])
    assert path(tight, (1.0, 1.0), (2.0, 2.0), (2, 1)) == 2.0
    assert path(tight, (1.5, 1.5), (1.5, 1.5), (1.5, 1.5)) == 0.0


def test_between_two_that_touch_at_a_corner_there_is_no_way():
    ends = (1.5, 1.5), (2.5, 2.5)
    for points in [[(2, 2)], [(1.75, 1.75)], [(2, 2), (2, 2)], [(1.5, 1.5)]]:
        assert path(PINCH, *ends, *points) == pytest.approx(2**0.5 + 10)
    # Beside the corner it is as far as a side of a cell, and what is farther counts as it is.
    assert path(PINCH, *ends, (2 - 1e-6, 2 + 1e-6)) == pytest.approx(2**0.5 + 10)
    assert path(PINCH, *ends, (1.5, 2.5)) == pytest.approx(2 + 10)
    assert path(PINCH, *ends, (1.0, 3.0)) > 2 + 10
    # To turn there is none either.
    assert path(PINCH, (1.5, 1.5), (1.5, 1.5), (2, 2)) == pytest.approx(2**0.5 + 10)
    assert path(PINCH, (1.5, 1.5), (1.5, 1.5), (1.99, 1.99)) < 1.5


def far_apart(grid):
    """Return a path model between free cells that can be reached from one another."""
    regions, _ = label(~grid.blocked)
    largest = np.argwhere(regions == 1 + np.bincount(regions.ravel())[1:].argmax())
    return GridPath(grid, largest[0], largest[-1], connectivity="any", name="there")


@pytest.mark.parametrize(
    "grid",
    [
        PINCH,
        random_cells(24, 24, 0.3, 9),
        random_cells(12, 12, 0.4, 3),
        maze(15, 15, 2),
        rooms(25, 25, 1),
        GridMap([".@.", ".@.", ".@.", ".@.", ".@.", "..."], cell=0.3, origin=(-7, 1e3)),
        GridMap(["@@@", "@.@"], cell=1e6),
        GridMap(["....", "....", "....", "...."], cell=1e-6),
    ],
)
def test_no_path_is_better_than_the_shortest_in_any_direction(grid):
    """Random paths, straight ones, and the best one with its turns moved by little and by much."""
    model = far_apart(grid)
    found = ct.solve(model, "any-angle")
    best, turns = found.primal_bound, found.plan.paths[0][1:-1]
    count = max(len(turns), 4)
    function = path_problem(model, count).function
    kept = np.vstack([turns, np.tile(function.goal, (count - len(turns), 1))]).reshape(1, -1)
    assert function.values(kept) == pytest.approx(best, rel=1e-9)
    rng = np.random.default_rng(1)
    reach = grid.cell * 10.0 ** rng.uniform(-8, 1.5, (3000, 1))
    near = kept + reach * rng.normal(size=(3000, 2 * count))
    # All but one turn stays, so that many of these paths are good.
    near = np.where(rng.random(near.shape) < 0.7, kept, near)
    box = grid.origin, grid.origin + grid.cell * np.array(grid.shape[::-1])
    anywhere = rng.uniform(*box, (3000, count, 2)).reshape(3000, -1)
    straight = function.start + np.linspace(0, 1, count)[:, None] * (function.goal - function.start)
    values = function.values(np.vstack([near, anywhere, straight.reshape(1, -1)]))
    assert values.min() >= best * (1 - 1e-9)


def test_a_free_path_is_what_the_grid_says_and_a_blocked_one_is_not():
    grid = random_cells(16, 16, 0.04, 4)
    model = far_apart(grid)
    problem = path_problem(model, 3)
    rng = np.random.default_rng(0)
    points = rng.uniform(problem.lows, problem.highs, (4000, 6))
    values = problem.function.values(points)
    lengths = np.hypot(*np.diff(problem.function.polylines(points), axis=1).T).sum(axis=0)
    free = values <= lengths * (1 + 1e-12)
    for k in [*np.flatnonzero(free)[:20], *np.flatnonzero(~free)[:20]]:
        plan = problem.as_plan({"x": points[k].tolist()})
        assert problem.verify(plan).objective == pytest.approx(values[k])
        found = model.verify(as_grid_plan(problem, plan))
        assert found.objective == pytest.approx(lengths[k], rel=1e-12)
        assert found.ok == free[k]
    assert 20 <= free.sum() < len(free) - 20


@pytest.mark.parametrize("name", PATHS)
def test_the_waypoints_of_an_instance_are_enough_for_the_shortest_path(name):
    problem = path_instance(name, 5000)
    assert problem.budget == 5000
    assert problem.digest == path_instance(name, 5000).digest
    model = path_grid(name)
    found = ct.solve(model, "any-angle")
    if name == "enclosed":
        assert found.plan is None
        return
    turns = found.plan.paths[0][1:-1]
    end = problem.function.goal
    x = np.vstack([turns, np.tile(end, (problem.function.waypoints - len(turns), 1))])
    held = problem.verify(problem.as_plan({"x": x.ravel().tolist()}))
    assert held.ok
    assert held.objective == pytest.approx(found.primal_bound, rel=1e-12)
    assert model.verify(as_grid_plan(problem, {"x": x.ravel().tolist()})).ok
    rng = np.random.default_rng(2)
    points = np.clip(x.ravel() + rng.normal(size=(500, x.size)), problem.lows, problem.highs)
    assert problem.function.values(points).min() >= found.primal_bound * (1 - 1e-9)


def test_there_is_no_other_map():
    with pytest.raises(UnknownName, match="'gap'"):
        path_instance("gapp")


@pytest.mark.parametrize(
    ("grid", "waypoints"),
    [
        (GridMap(["." * 20] * 20), 2),
        (GridMap(["." * 9 + "@" + "." * 10] * 14 + ["." * 20] * 6), 2),
        (random_cells(20, 20, 0.08, 5), 3),
    ],
)
def test_a_search_comes_near_the_optimum_on_easy_maps(grid, waypoints):
    model = far_apart(grid)
    problem = path_problem(model, waypoints)
    found = differential_evolution(
        lambda x: problem.function.values(np.ascontiguousarray(x.T)), problem.bounds, popsize=20,
        maxiter=150, rng=1, vectorized=True, updating="deferred", polish=False,
    )  # fmt: skip
    best = ct.solve(model, "any-angle").primal_bound
    assert best * (1 - 1e-9) <= found.fun <= 1.01 * best
    checked = model.verify(as_grid_plan(problem, {"x": found.x.tolist()}))
    assert checked.ok
    assert checked.objective == pytest.approx(found.fun)


def test_backends_see_no_map_and_their_path_is_verified():
    model = far_apart(rooms(17, 17, 3))
    problem = path_problem(model, 2, budget=3000)
    assert problem.name == "there"
    assert problem.bounds.tolist() == [[0, 17]] * 4
    assert "map" not in repr(vars(problem.blinded()))
    found = ct.solve(problem, "random-search", seed=1)
    assert found.verification.ok
    assert found.primal_bound >= ct.solve(model, "any-angle").primal_bound * (1 - 1e-9)
    assert as_grid_plan(problem, found).paths[0].shape == (4, 2)


def test_written_and_read():
    problem = path_problem(far_apart(random_cells(9, 9, 0.2, 1)), 3, budget=70)
    again = Model.from_json(problem.to_json())
    assert again.digest == problem.digest
    assert again.function.penalty == problem.function.penalty >= 1
    x = np.random.default_rng(0).uniform(-2, 11, (9, 6))
    assert again.function.values(x).tolist() == problem.function.values(x).tolist()
    other = path_problem(far_apart(random_cells(9, 9, 0.2, 1)), 3, budget=70, penalty=2.5)
    assert other.function.penalty == 2.5
    assert other.digest != problem.digest


def test_the_default_penalty_is_the_way_around():
    line = WaypointPath({"blocked": ["....."]}, (0.5, 0.5), (4.5, 0.5))
    assert line.penalty == 1.0
    wall = GridMap([".@.", ".@.", ".@.", "..."], cell=2.0)
    assert WaypointPath(wall, (1, 1), (5, 1)).penalty == pytest.approx(1 + (16 - 4) / 2)
    cut = GridMap([".@."])
    assert np.isfinite(WaypointPath(cut, (0.5, 0.5), (2.5, 0.5)).penalty)


def test_points_far_away_have_large_values_or_none():
    function = WaypointPath(GridMap(["..."]), (0.5, 0.5), (2.5, 0.5), 1, 3.0)
    for far in (1e3, 1e8, 1e12, 1e15):
        value = float(function.values(np.array([[far, far]]))[0])
        assert value == pytest.approx(4 * 2 * far * 2**0.5, rel=0.02)
    assert not np.isfinite(function.values(np.array([[1e308, -1e308]]))).any()
    assert function.values(np.empty((0, 2))).shape == (0,)


@pytest.mark.parametrize(
    ("start", "why"),
    [
        (
            (1.5, 0.5),
            r"start must lie in a free cell or on its border, got \[1.5, 0.5\], which is bl",
        ),
        ((9.0, 0.5), "which lies outside of the map"),
        ((1.0, 1.0), "which lies where two blocked cells touch"),
        ((0.5, np.nan), "start.* must be finite"),
        ((0.5,), "start must have shape"),
    ],
)
def test_ends_where_no_robot_can_be(start, why):
    grid = GridMap([".@", "@."])
    with pytest.raises(InvalidData, match=why):
        WaypointPath(grid, start, (0.5, 0.5))
    assert WaypointPath(grid, (1.0, 0.5), (0.5, 1.0), 1).values(np.array([[0.5, 0.5]])) == 1.0


def test_what_else_is_refused():
    grid = GridMap(["....", "...."])
    for waypoints in (0, 1.5, "two", 5001):
        with pytest.raises(InvalidData, match="waypoints must"):
            WaypointPath(grid, (0.5, 0.5), (1.5, 1.5), waypoints)
    with pytest.raises(InvalidData, match="penalty must be >= 0"):
        WaypointPath(grid, (0.5, 0.5), (1.5, 1.5), 1, -1.0)
    function = WaypointPath(grid, (0.5, 0.5), (1.5, 1.5), 2)
    with pytest.raises(InvalidData, match="2 waypoints has 4 variables, got bounds of 5"):
        BlackBoxMinimisation(function, [[0, 1]] * 5)
    with pytest.raises(InvalidData, match="got 2 with connectivity 'any'"):
        path_problem(GridPath(grid, (0, 0), [(1, 1), (0, 1)], connectivity="any"))
    with pytest.raises(InvalidData, match="got 1 with connectivity '8'"):
        path_problem(GridPath(grid, (0, 0), (1, 1)))
    with pytest.raises(InvalidData, match="grid must be a GridPath"):
        path_problem(grid)
    named = BlackBoxMinimisation("sphere", [[0, 1]] * 2)
    with pytest.raises(InvalidData, match="function must be a WaypointPath"):
        as_grid_plan(named, {"x": [0, 0]})
    with pytest.raises(InvalidData, match="x must have 4 entries, got 3"):
        as_grid_plan(BlackBoxMinimisation(function, [[0, 1]] * 4), {"x": [0, 0, 0]})
