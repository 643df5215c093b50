"""Maps of polygons: blocked cells and validation of polygons."""

import dataclasses
import math
import pickle

import numpy as np
import pytest
import shapely
from hypothesis import assume, example, given, settings, strategies as st

from crosstrack.errors import InvalidData
from crosstrack.instances.grid_path import random_polygons
from crosstrack.models.declaration import Declared
from crosstrack.models.fields import declared
from crosstrack.models.grid_path import GridMap, Polygons, as_shapely


@dataclasses.dataclass(frozen=True, eq=False)
class Held(Declared):
    """Class with a field of polygons."""

    obstacles: tuple = declared(Polygons())


def boxes(grid, cells=None):
    """Cells of a map, all by default, smaller on every side by a part of theirs."""
    cells = np.moveaxis(np.indices(grid.shape), 0, -1) if cells is None else cells
    low = grid.origin + cells[..., ::-1] * grid.cell
    less = 1e-9 * grid.cell
    return shapely.box(*np.moveaxis(low + less, -1, 0), *np.moveaxis(low + grid.cell - less, -1, 0))


def brute_force(grid, polygons, radius):
    """Every cell against every polygon, as the docstring of the map says it."""
    cells = boxes(grid)[..., None]
    obstacles = as_shapely(Polygons().coerce("polygons", polygons, {}))
    if radius:
        return (shapely.distance(cells, obstacles) < radius).any(axis=-1)
    return shapely.intersects(cells, obstacles).any(axis=-1)


def box(a, b, c, d):
    return [(a, b), (c, b), (c, d), (a, d)]


#: Corners on the lattice of cells and half cells test contact, others test general positions.
places = st.one_of(st.integers(-4, 24).map(lambda k: k / 2), st.floats(-3, 12))


@st.composite
def obstacles(draw):
    """Boxes, triangles thin or not, stars, rings: they touch, overlap, nest and leave the map."""
    found = []
    for _ in range(draw(st.integers(0, 5))):
        kind = draw(st.sampled_from(["box", "triangle", "star", "ring"]))
        x, y = draw(places), draw(places)
        size = draw(st.sampled_from([1e-6, 0.3, 0.5, 1.0, 2.0, 3.5, 1e6]))
        if kind == "box":
            found.append(box(x, y, x + size, y + draw(st.sampled_from([0.5, 1.0, 2.0]))))
        elif kind == "triangle":
            found.append([(x, y), (x + size, y + draw(places)), (draw(places), draw(places))])
        elif kind == "star":
            number = draw(st.integers(5, 9))
            reach = draw(st.lists(st.floats(0.2, 1.0), min_size=number, max_size=number))
            turn = np.arange(number) * 2 * np.pi / number
            ring = np.stack([np.cos(turn), np.sin(turn)], axis=1) * np.array(reach)[:, None]
            found.append([(x, y)] + ring * min(size, 5.0))
        else:
            found.append({
                "shell": box(x, y, x + 4, y + 4),
                "holes": [box(x + 1, y + 1, x + 3, y + draw(st.sampled_from([1.25, 2.0, 3.0])))],
            })  # fmt: skip
    return found


def keep_valid(polygons):
    """Return polygons without flat or self-intersecting ones, which maps reject."""
    kept = []
    for one in polygons:
        try:
            Polygons().coerce("polygons", [one], {})
        except InvalidData:
            continue
        kept.append(one)
    return kept


@settings(deadline=None, max_examples=25)
@given(obstacles(), st.sampled_from([0.0, 1e-3, 0.5, 1.0, math.sqrt(2), 5.0]), places, places)
@example([box(2, 2, 4, 4), box(4, 4, 6, 6), box(4, 2, 6, 3), box(2.5, 2.5, 3, 3)], 0.0, 0.0, 0.0)
@example([box(2, 2, 4, 4), box(7, 2, 9, 4)], 1.0, 0.0, 0.0)
@example([box(0, 0, 3, 4)], 5.0, 0.0, 0.0)
def test_cells_are_blocked_exactly_where_brute_force_says(polygons, radius, x, y):
    polygons = keep_valid(polygons)
    try:
        grid = GridMap.from_polygons(polygons, (x, y, x + 9, y + 6), 1.0, radius)
    except InvalidData:
        everything = GridMap(np.zeros((6, 9), bool), 1.0, (x, y))
        assert brute_force(everything, polygons, radius).all()
        return
    assert grid.shape == (6, 9)
    assert np.array_equal(grid.blocked, brute_force(grid, polygons, radius))


@settings(deadline=None, max_examples=20)
@given(
    obstacles(), st.floats(0.05, 4), st.floats(0, 3), st.floats(0.5, 12), st.floats(0.5, 12),
    st.integers(0, 99),
)  # fmt: skip
def test_wherever_a_free_cell_is_the_robot_is_safe(polygons, cell, radius, wide, high, seed):
    polygons = keep_valid(polygons)
    try:
        grid = GridMap.from_polygons(polygons, (-1, 1, wide - 1, high + 1), cell, radius)
    except InvalidData:
        assume(False)
    free = np.argwhere(~grid.blocked)
    rng = np.random.default_rng(seed)
    chosen = free[rng.integers(0, len(free), 200)]
    corner = grid.origin + chosen[:, ::-1] * grid.cell
    points = corner + rng.choice([0, 0.5, 1, rng.random()], (200, 2)) * grid.cell
    assert (points <= np.array([wide - 1, high + 1]) + 1e-8 * cell).all(), "within the bounds"
    for one in as_shapely(Polygons().coerce("polygons", polygons, {})):
        if radius:
            with np.errstate(divide="ignore", invalid="ignore"):  # GEOS's, beside edges of 1e-272
                assert shapely.distance(one, shapely.points(points)).min() >= radius - 1e-8 * cell
        else:
            inside = shapely.contains_xy(one, points)
            edge = shapely.distance(shapely.boundary(one), shapely.points(points[inside]))
            assert not inside.any() or edge.max() <= 1e-8 * max(cell, 1e-7 * one.length)


def test_contact_does_not_block():
    walls = [box(2, 0, 4, 3), box(4, 3, 6, 5)]
    grid = GridMap.from_polygons(walls, (0, 0, 7, 5), 1)
    assert grid.data() == {
        "blocked": ["..@@...", "..@@...", "..@@...", "....@@.", "....@@."],
        "cell": 1.0, "origin": [0.0, 0.0], "upward": True,
    }  # fmt: skip
    joined = GridMap.from_polygons([box(2, 0, 3, 3), box(3, 0, 4, 3), walls[1]], (0, 0, 7, 5), 1)
    assert joined.data() == grid.data(), "polygons that share an edge are as one"
    nested = GridMap.from_polygons([*walls, box(2.5, 0.5, 3, 1), walls[0]], (0, 0, 7, 5), 1)
    assert nested.data() == grid.data()


def test_a_hole_is_free_until_the_robot_is_too_large():
    ring = {"shell": box(0, 0, 7, 7), "holes": [box(2, 2, 5, 5)]}
    lines = GridMap.from_polygons([ring], (0, 0, 9, 7), 1).data()["blocked"]
    assert lines == ["@@@@@@@.."] * 2 + ["@@...@@.."] * 3 + ["@@@@@@@.."] * 2
    lines = GridMap.from_polygons([ring], (0, 0, 9, 7), 1, 1.0).data()["blocked"]
    assert lines == ["@@@@@@@@."] * 3 + ["@@@.@@@@."] + ["@@@@@@@@."] * 3
    assert not GridMap.from_polygons([ring], (0, 0, 10, 7), 1, 1.000001).holds((3, 3))


@pytest.mark.parametrize("cell", [0.1, 0.3, 1 / 3, 1.0, 1e-3, 7e5])
@pytest.mark.parametrize("corner", [(0.0, 0.0), (-0.7, 1e3 / 3), (1e5, -1e5)])
@pytest.mark.parametrize("cells", [0, 1, 2.5, 30])
def test_a_passage_exactly_as_wide_as_the_robot(cell, corner, cells):
    """Walls apart by the robot's width and one cell leave one row of cells despite rounding."""
    if max(map(abs, corner)) > 1e6 * cell:
        corner = (0.0, 0.0)
    x, y = corner
    radius = cells * cell
    low, high = y + 40 * cell - radius, y + 41 * cell + radius
    walls = [
        box(x + 3 * cell, y - 60 * cell, x + 5 * cell, low),
        box(x + 3 * cell, high, x + 5 * cell, y + 160 * cell),
    ]
    bounds = (x, y, x + 90 * cell, y + 81 * cell)
    grid = GridMap.from_polygons(walls, bounds, cell, radius)
    assert grid.shape == (81, 90)
    assert np.flatnonzero(~grid.blocked[:, 4]).tolist() == [40]
    wider = GridMap.from_polygons(walls, bounds, cell, radius + 1e-4 * cell)
    assert wider.blocked[:, 4].all()
    assert not wider.blocked[:, 89].any()


def test_cells_beyond_the_bounds_are_blocked():
    grid = GridMap.from_polygons([], (0, 0, 2.5, 2), 1)
    assert grid.data()["blocked"] == ["..@", "..@"]
    grid = GridMap.from_polygons([], (-0.1, -0.1, 0.2, 0.5), 0.1)
    assert grid.data()["blocked"] == ["..."] * 6, "0.3 / 0.1 is a whole number but for rounding"
    assert grid.origin.tolist() == [-0.1, -0.1]
    assert grid.upward
    far = [box(50, 50, 60, 60), box(-9, -9, -1, 99), box(2, -1e9, 1e9, 1e9)]
    grid = GridMap.from_polygons(far, (0, 0, 4, 2), 1, 1)
    assert grid.data()["blocked"] == [".@@@", ".@@@"]


def test_scale_and_place_change_nothing():
    polygons = [one.shell for one in random_polygons(12, 5, (0, 0, 64, 64))]
    grid = GridMap.from_polygons(polygons, (0, 0, 64, 64), 1, 2.5)
    for factor in (2.0**-20, 2.0**20):
        for shift in (0.0, 2.0**16):
            moved = [ring * factor + shift * factor for ring in polygons]
            bounds = np.array([0, 0, 64, 64]) * factor + shift * factor
            again = GridMap.from_polygons(moved, bounds, factor, 2.5 * factor)
            assert np.array_equal(again.blocked, grid.blocked)


@pytest.mark.parametrize("side", [400, pytest.param(1000, marks=pytest.mark.slow)])
def test_many_polygons(side):
    rng, count = np.random.default_rng(1), side**2 // 100
    corners = rng.random((count, 1, 2)) * side
    triangles = corners + [[0, 0], [5, 1], [2, 6]] * rng.uniform(0.2, 1, (count, 1, 1))
    grid = GridMap.from_polygons(triangles, (0, 0, side, side), 1, 0.25)
    sample = rng.integers(0, side, (4000, 2))
    tree = shapely.STRtree(shapely.polygons(triangles))
    near = tree.query(boxes(grid, sample), predicate="dwithin", distance=0.25)[0]
    met = np.zeros(len(sample), bool)
    met[near] = True
    assert np.array_equal(grid.blocked[tuple(sample.T)], met)
    assert 0.1 < grid.blocked.mean() < 0.9


def test_an_outline_of_many_points():
    turn = np.linspace(0, 2 * np.pi, 5_001)[:-1]
    reach = 60 + 30 * np.sin(150 * turn)
    ring = 100 + reach[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    grid = GridMap.from_polygons([ring], (0, 0, 200, 200), 2, 0.25)
    cells = boxes(grid)
    whole = shapely.Polygon(ring)
    shapely.prepare(whole)
    assert np.array_equal(grid.blocked, shapely.dwithin(whole, cells, 0.25))


@pytest.mark.parametrize("radius", [0.0, 0.4, 0.5, 0.75, 1.2])
def test_an_inflated_map_blocks_the_cells_nearer_than_the_radius(radius):
    grid = GridMap(np.random.default_rng(3).random((9, 12)) < 0.06, 0.5, (3.0, -2.0))
    cells = np.moveaxis(np.indices(grid.shape), 0, -1)
    apart = np.abs(cells[:, :, None] - np.argwhere(grid.blocked)) - 1
    away = grid.cell * np.hypot(*np.moveaxis(apart.clip(0), -1, 0)).min(axis=-1)
    inflated = grid.inflated(radius)
    np.testing.assert_array_equal(inflated.blocked, grid.blocked | (away < radius))
    assert (inflated.cell, *inflated.origin) == (grid.cell, *grid.origin)
    with pytest.raises(InvalidData, match="blocked must leave at least one cell free"):
        grid.inflated(10.0)


def test_a_free_space_of_one_cell():
    frame = {"shell": box(0, 0, 5, 5), "holes": [box(2, 2, 3, 3)]}
    grid = GridMap.from_polygons([frame], (0, 0, 5, 5), 1)
    assert np.argwhere(~grid.blocked).tolist() == [[2, 2]]
    with pytest.raises(InvalidData, match="at least one cell free, got 5 × 5 cells of which none"):
        GridMap.from_polygons([frame], (0, 0, 5, 5), 1, 0.01)


@pytest.mark.parametrize(
    ("change", "message", "field"),
    [
        ({"bounds": (0, 0, 0, 5)}, "bounds must be least x, .* with an area > 0", "bounds"),
        ({"bounds": (5, 0, 0, 5)}, "bounds must be least x", "bounds"),
        ({"bounds": (0, 0, 5)}, r"bounds must have shape \(4,\)", "bounds"),
        ({"bounds": (0, 0, math.inf, 5)}, r"bounds\[2\] must be finite", "bounds"),
        ({"bounds": (0, 0, 1e9, 1e9)}, "cell must give at most 67108864 cells", "cell"),
        ({"bounds": (-1e308, 0, 1e308, 1)}, "cell must give at most", "cell"),
        ({"cell": 0}, "cell must be > 0 m", "cell"),
        ({"cell": math.nan}, "cell must be finite", "cell"),
        ({"radius": -1}, "radius must be >= 0 m", "radius"),
        ({"cell": 99}, "blocked must leave at least one cell free", "blocked"),
        ({"bounds": (1e12, 0, 1e12 + 1, 1), "cell": 0.5}, "cell must be large enough", "cell"),
    ],
)
def test_maps_that_are_refused(change, message, field):
    with pytest.raises(InvalidData, match=message) as caught:
        GridMap.from_polygons(
            **{"polygons": [box(1, 1, 2, 2)], "bounds": (0, 0, 5, 5), "cell": 1, **change}
        )
    assert caught.value.field == field


# -- polygons ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (3, "obstacles must be a list of polygons, got 3"),
        ("box", "obstacles must be a list"),
        ({"shell": box(0, 0, 1, 1)}, "obstacles must be a list"),
        (box(0, 0, 1, 1), r"obstacles\[0\] must have shape \(k, 2\)"),
        ([None], r"obstacles\[0\] must"),
        ([[]], r"obstacles\[0\] must have at least 3 different points, got 0"),
        ([[(0, 0), (1, 1), (0, 0), (1, 1)]], "at least 3 different points, got 2"),
        ([box(0, 0, 1, 1), [(0, 0), (1, 1), (2, 2)]], r"obstacles\[1\] must have an area > 0"),
        ([[(0, 0), (1, 1), (1, 0), (0, 1)]], r"obstacles\[0\].*do not cross, got Self-inters"),
        ([[(0, 0), (4, 0), (4, 4), (2, 0), (0, 4)]], "got Ring Self-intersection"),
        ([[(0, 0), (4, math.nan), (4, 4)]], r"obstacles\[0\]\[1, 1\] must be finite"),
        ([[(0, 0), (1e300, 0), (0, 1e300)]], "an area that a float can hold"),
        ([[(0, 0), ("1", 0), (0, 1)]], r"obstacles\[0\]\[1, 0\] must be a number"),
        ([{"shell": box(0, 0, 1, 1), "hole": []}], "the keys shell and holes"),
        ([{"holes": []}], "the keys shell and holes"),
        ([{"shell": box(0, 0, 1, 1), "holes": 3}], r"obstacles\[0\].holes must be a list"),
        ([{"shell": box(0, 0, 1, 1), "holes": [box(5, 5, 6, 6)]}], "Hole lies outside shell"),
        ([{"shell": box(0, 0, 9, 9), "holes": [[(1, 1), (2, 2)]]}], r"holes\[0\] must have at"),
    ],
)  # fmt: skip
def test_polygons_that_are_refused(value, message):
    with pytest.raises(InvalidData, match=message) as caught:
        Held(value)
    assert caught.value.field == "obstacles"


def test_polygons_travel_and_nobody_changes_them():
    ring = np.array(box(0, 0, 4, 4), float)
    hole = box(1, 1, 2, 2)
    held = Held([ring, {"shell": [*box(9, 9, 19, 19), (9, 9)], "holes": [[(10, 10), (11, 10), (10, 11)]]},
                 (ring + 50, [np.array(hole) + 50]), shapely.box(70, 70, 71, 71)])  # fmt: skip
    ring[0] = 99
    assert held.obstacles[0].shell.tolist() == [list(point) for point in box(0, 0, 4, 4)]
    assert len(held.obstacles[1].shell) == 4, "the last point, which was the first, is left out"
    assert [len(one.holes) for one in held.obstacles] == [0, 1, 1, 0]
    again = Held.from_data(held.data())
    sent = pickle.loads(pickle.dumps(held))
    spec = Polygons()
    for other in (again, sent, Held(held.obstacles)):
        assert other.data() == held.data()
        assert list(spec.feed(other.obstacles)) == list(spec.feed(held.obstacles))
        with pytest.raises(ValueError, match="read-only"):
            other.obstacles[1].holes[0][0] = 1
        with pytest.raises(ValueError, match="WRITEABLE"):
            other.obstacles[0].shell.flags.writeable = True
    assert shapely.area(as_shapely(held.obstacles)).tolist() == [16.0, 99.5, 15.0, 1.0]
    moved = Held([held.obstacles[0], *held.obstacles[2:]])
    assert list(spec.feed(moved.obstacles)) != list(spec.feed(held.obstacles))
    assert as_shapely(Held([]).obstacles).tolist() == []
