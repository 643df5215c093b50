"""Corridors: no obstacle inside, the path inside, overlaps; every claim is checked apart from the construction."""

import itertools
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances.grid_path import random_polygons
from crosstrack.models import GridMap, MinimumSnap
from crosstrack.models.flight import Corridor, VoxelMap, corridor

ROOM = GridMap(["......", "..@@..", "......"])

SCALES = st.sampled_from([1e-3, 1.0, 1e6])


def excess(normals, offsets, point):
    """Return how far a point is beyond the faces, with fractions alone."""
    x = [Fraction(v) for v in point]
    return max(
        sum(Fraction(n) * v for n, v in zip(row, x, strict=True)) - Fraction(b)
        for row, b in zip(normals.tolist(), offsets.tolist(), strict=True)
    )


def position(path, stop):
    k = min(int(stop), max(len(path) - 2, 0))
    after = path[min(k + 1, len(path) - 1)]
    share = Fraction(stop) - k
    return [
        Fraction(a) + share * (Fraction(b) - Fraction(a))
        for a, b in zip(path[k], after, strict=True)
    ]


def check_chain(result, path):
    """The parts of the path join, are inside their polytopes, and overlaps are balls inside of both."""
    path = np.asarray(path, float)
    assert result.covers[0, 0] == 0 and result.covers[-1, 1] == len(path) - 1
    assert (result.covers[1:, 0] == result.covers[:-1, 1]).all()
    for (normals, offsets), (begin, end) in zip(
        result.polytopes, result.covers.tolist(), strict=True
    ):
        inner = range(math.ceil(begin), math.floor(end) + 1)
        for stop in (begin, *inner, end):
            assert excess(normals, offsets, position(path.tolist(), stop)) <= 0
        assert np.allclose((normals**2).sum(axis=1), 1, atol=1e-12)
    for (first, second), ball in zip(
        itertools.pairwise(result.polytopes), result.overlaps, strict=True
    ):
        assert ball[-1] > 0
        for normals, offsets in (first, second):
            assert (normals @ ball[:-1] + ball[-1] <= offsets).all()


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 10**6), SCALES, st.sampled_from([2, 3]), st.sampled_from(["firi", "one-pass"])
)
def test_cells_are_outside_and_the_path_is_inside(seed, scale, axes, method):
    rng = np.random.default_rng(seed)
    shape = (7, 9) if axes == 2 else (5, 6, 7)
    blocked = rng.random(shape) < 0.08
    blocked.flat[rng.integers(blocked.size)] = False
    origin = rng.integers(-3, 4, axes) * scale * 0.37
    map_ = (GridMap if axes == 2 else VoxelMap)(blocked, scale * 0.1, origin)
    free = np.argwhere(~map_.blocked)
    path = map_.centres(free[rng.integers(len(free), size=int(rng.integers(1, 4)))])
    radius = float(rng.choice([0.0, 0.012])) * scale
    try:
        result = corridor(
            map_, path, radius=radius, method=method, reach=scale * float(rng.choice([0.3, 0.8]))
        )
    except InvalidData as error:
        assert error.field == "path" and "blocked cells" in str(error)  # noqa: PT017
        assert distance_to_cells(map_, path) <= radius * (1 + 1e-9) + 1e-12 * scale
        return
    assert distance_to_cells(map_, path) > radius * (1 - 1e-9)
    check_chain(result, path)
    verification = result.verify(map_)
    assert verification.ok, str(verification)
    # Every face of a cell's box: the whole cell is beyond one face, in fractions.
    order = map_.blocked.T if axes == 2 else map_.blocked
    for normals, offsets in result.polytopes:
        for index in np.argwhere(order):
            low = [
                Fraction(o) + int(i) * Fraction(map_.cell)
                for o, i in zip(map_.origin.tolist(), index, strict=True)
            ]
            high = [x + Fraction(map_.cell) for x in low]
            assert any(
                sum(
                    Fraction(n) * (a if n > 0 else b)
                    for n, a, b in zip(row, low, high, strict=True)
                )
                - Fraction(o)
                >= Fraction(radius) * (1 - Fraction(1, 10**15))
                for row, o in zip(normals.tolist(), offsets.tolist(), strict=True)
            )
    assert (result.volumes > 0).all()


def distance_to_cells(map_, path):
    """Return the distance of a path from the nearest blocked cell, by shapely or by nested intervals."""
    order = map_.blocked.T if map_.blocked.ndim == 2 else map_.blocked
    low = np.asarray(map_.origin) + np.argwhere(order) * map_.cell
    if not len(low):
        return math.inf
    if low.shape[1] == 2:
        line = shapely.LineString(path) if len(path) > 1 else shapely.Point(path[0])
        return min(shapely.distance(line, shapely.box(*a, *(a + map_.cell))) for a in low)
    best = math.inf
    for begin, end in itertools.pairwise([*path, path[-1]]):

        def away(share, begin=begin, step=end - begin):
            x = begin + share[:, None] * step
            return np.linalg.norm(x - np.clip(x, low, low + map_.cell), axis=1)

        first, last = np.zeros(len(low)), np.ones(len(low))
        for _ in range(80):  # the distance is convex along the segment
            one, two = first + (last - first) / 3, last - (last - first) / 3
            lower = away(one) <= away(two)
            first, last = np.where(lower, first, one), np.where(lower, two, last)
        best = min(best, away(first).min())
    return best


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), SCALES, st.sampled_from([2, 3]))
def test_points_keep_the_radius(seed, scale, axes):
    rng = np.random.default_rng(seed)
    cloud = rng.random((60, axes)) * scale
    path = rng.random((int(rng.integers(1, 5)), axes)) * scale
    radius = float(rng.choice([0.0, 0.02])) * scale
    try:
        result = corridor(cloud, path, radius=radius)
    except InvalidData as error:
        assert error.field == "path" and "obstacles[" in str(error)  # noqa: PT017
        return
    check_chain(result, path)
    assert result.verify(cloud).ok
    for normals, offsets in result.polytopes:
        assert ((cloud @ normals.T - offsets).max(axis=1) >= radius * (1 - 1e-12)).all()


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), SCALES)
def test_polygons_are_outside(seed, scale):
    rng = np.random.default_rng(seed)
    shapes = random_polygons(8, seed % 1000, (0, 0, scale, scale))
    path = rng.random((int(rng.integers(1, 4)), 2)) * scale
    radius = float(rng.choice([0.0, 0.02])) * scale
    solid = shapely.union_all([shapely.Polygon(shape.shell) for shape in shapes])
    line = shapely.LineString(path) if len(path) > 1 else shapely.Point(path[0])
    away = shapely.distance(line, solid)
    try:
        result = corridor(shapes, path, radius=radius, bounds=[0, 0, scale, scale])
    except InvalidData as error:
        assert error.field == "path"  # noqa: PT017
        assert away <= radius * (1 + 1e-9)
        return
    assert away > radius * (1 - 1e-9)
    check_chain(result, path)
    verification = result.verify(shapes)
    assert verification.ok, str(verification)
    for corners in result.corners:
        region = shapely.convex_hull(shapely.MultiPoint(corners))
        assert shapely.distance(region, solid) >= radius - 1e-9 * scale
        assert shapely.intersection(region, solid).area <= 1e-9 * scale**2


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
def test_no_face_can_be_moved_outward(scale):
    rng = np.random.default_rng(5)
    cloud = rng.random((80, 3)) * scale
    path = np.array([[0.1, 0.12, 0.5], [0.5, 0.57, 0.5]]) * scale
    result = corridor(cloud, path, reach=0.9 * scale)
    assert result.verify(cloud).ok
    moved = 0
    for face, normal in enumerate(result.normals):
        if np.abs(normal).max() == 1.0:
            continue  # a face of the box
        offsets = np.array(result.offsets)
        offsets[face] += 1e-6 * scale
        checks = {
            check.name: check for check in replace(result, offsets=offsets).verify(cloud).checks
        }
        assert 0 < checks["obstacle"].worst <= 1.01e-6 * scale
        moved += 1
    assert moved > 5


def test_a_trajectory_inside_is_free_of_collision():
    shapes = random_polygons(6, 3, (0, 0, 10, 10), keep=[[0.5, 0.5], [9.5, 9.5]], gap=0.5)
    grid = GridMap.from_polygons(shapes, (0, 0, 10, 10), 0.25, 0.15)
    ends = grid.cells_of([[0.5, 0.5], [9.5, 9.5]])
    way = ct.solve(ct.models.GridPath(grid, ends[0], ends[1])).plan
    result = corridor(shapes, way.paths[0], radius=0.1, bounds=[0, 0, 10, 10])
    assert result.verify(shapes).ok
    # Few polytopes although the path has one waypoint per cell.
    assert len(result) < 15 < len(result.path)
    waypoints = np.full((len(result) + 1, 2), np.nan)
    waypoints[[0, -1]] = result.path[[0, -1]]
    model = MinimumSnap(
        np.where(np.isnan(waypoints), np.inf, waypoints),
        np.arange(len(result) + 1.0),
        **result.fields(),
    )
    solution = ct.solve(model, "clarabel")
    assert solution.verified, solution
    places = solution.plan(np.linspace(0, len(result), 5000))
    solid = shapely.union_all([shapely.Polygon(shape.shell) for shape in shapes])
    assert shapely.distance(shapely.LineString(places), solid) > 0.0999
    again = result.bounded(
        replace(model, polytope_segments=None, polytope_normals=None, polytope_offsets=None)
    )
    assert again == model


def test_fields_repeat_polytopes():
    result = corridor(ROOM, [[0.5, 0.5], [0.5, 2.5], [5.5, 2.5]])
    fields = result.fields([0, 0, len(result) - 1])
    assert set(fields["polytope_segments"].tolist()) == {0, 1, 2}
    with pytest.raises(InvalidData, match="polytopes"):
        result.fields([len(result)])


@pytest.mark.parametrize("path", [[[0.5, 0.5]], [[0.5, 0.5]] * 3])
def test_a_single_place_gives_one_polytope(path):
    result = corridor(ROOM, path)
    assert len(result) == 1 and result.verify(ROOM).ok
    assert result.covers.tolist() == [[0.0, len(path) - 1.0]]
    assert result.knots.shape == (2, 2)


def test_zero_length_segments_are_covered():
    path = [[0.5, 0.5], [0.5, 0.5], [0.5, 2.5], [0.5, 2.5], [5.5, 2.5], [5.5, 2.5]]
    result = corridor(ROOM, path)
    check_chain(result, path)
    assert result.verify(ROOM).ok


def test_the_path_may_touch_the_edge_of_the_map():
    """A vehicle on the ground is at the border of the map."""
    map_ = VoxelMap(np.zeros((8, 8, 8), bool), 0.1, (0.3, 0.0, 0.0))
    path = [[0.4, 0.4, 0.0], [0.8, 0.4, 0.0], [0.8, 0.4, 0.7]]
    result = corridor(map_, path, radius=0.3, reach=0.5)
    assert result.verify(map_).ok
    check_chain(result, path)
    with pytest.raises(InvalidData, match=r"path\[1\] must be within"):
        corridor(map_, [[0.4, 0.4, 0.0], [0.4, 0.4, -1e-9]])


@pytest.mark.parametrize(
    ("path", "radius", "segment", "distance"),
    [
        ([[0.5, 0.5], [0.5, 1.5], [5.5, 1.5]], 0.0, 1, "0 m"),  # crosses
        ([[2.5, 1.5]], 0.0, 0, "0 m"),  # starts inside
        ([[1.5, 0.5], [1.5, 1.5]], 0.75, 0, "0.5 m"),
        ([[0.5, 0.5], [5.5, 0.5]], 0.5, 0, "0.5 m"),  # touches
        ([[0.5, 1.0], [5.5, 1.0]], 0.0, 0, "0 m"),  # along the wall
        ([[1.5, 0.5], [2.0, 1.0], [2.5, 0.5]], 0.0, 0, "0 m"),  # at a corner
    ],
)
def test_names_the_segment_and_the_obstacle_in_contact(path, radius, segment, distance):
    with pytest.raises(InvalidData) as caught:
        corridor(ROOM, path, radius=radius)
    message = str(caught.value)
    assert f"segment {segment}," in message and "(row, column) (1, 2)" in message
    assert f"is at {distance} from" in message


def test_names_polygons_and_points_in_contact():
    square = [[1, 1], [2, 1], [2, 2], [1, 2]]
    far = [[5, 5], [6, 5], [6, 6], [5, 6]]
    with pytest.raises(InvalidData, match=r"segment 0.*polygons\[1\]"):
        corridor([far, square], [[0, 1.5], [3, 1.5]])
    with pytest.raises(InvalidData, match=r"path\[0\].*inside polygons\[0\]"):
        corridor([far, square], [[5.5, 5.5], [5.6, 5.5]])
    with pytest.raises(InvalidData, match=r"segment 1.*obstacles\[1\]"):
        corridor(np.array([[9.0, 9], [2, 1]]), [[0, 0], [1, 1], [3, 1]])


def test_a_hole_of_a_polygon_is_free():
    hole = [[1, 1], [8, 1], [8, 8], [1, 8]]
    frame = [{"shell": [[0, 0], [9, 0], [9, 9], [0, 9]], "holes": [hole]}]
    result = corridor(frame, [[2, 2], [7, 7]], reach=20)
    assert result.verify(frame).ok
    assert result.volumes.tolist() == pytest.approx([49.0])


def test_accepts_a_single_polygon_in_each_form():
    square = [[1, 1], [2, 1], [2, 2], [1, 2]]
    forms = [
        [square],
        {"shell": square, "holes": []},
        shapely.Polygon(square),
        [shapely.Polygon(square)],
    ]
    first, *others = (corridor(form, [[0, 0], [0, 3]]) for form in forms)
    for other in others:
        assert other.offsets.tolist() == first.offsets.tolist()


@pytest.mark.parametrize("size", [1e-300, 1e-3, 1e6, 1e154, 1e300])
def test_extreme_scales_give_a_corridor_or_an_error_that_names_a_field(size):
    cloud = np.array([[0.5, 0.2], [0.3, 0.9], [0.8, 0.7]]) * size
    try:
        result = corridor(cloud, np.array([[0.1, 0.1], [0.6, 0.6]]) * size)
        assert result.verify(cloud).ok
    except InvalidData as error:
        assert error.field and size not in (1e-3, 1e6)  # noqa: PT017


def test_no_obstacles_and_no_bounds():
    for obstacles in ([], np.empty((0, 2))):
        result = corridor(obstacles, [[0, 0], [3, 4]])
        assert result.verify(obstacles).ok
        check_chain(result, [[0, 0], [3, 4]])
    assert corridor(np.empty((0, 3)), [[1, 1, 1]]).volumes.tolist() == pytest.approx([1.0])


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"path": []}, "path", "at least 1 row"),
        ({"path": [[0.5, 0.5, 0.5]]}, "path", "must have 2 columns"),
        ({"path": [[0.5, float("nan")]]}, "path", "finite"),
        ({"radius": -1}, "radius", ">= 0"),
        ({"reach": 0}, "reach", "> 0"),
        ({"reach": 1e-7}, "reach", "at most 100000 parts"),
        ({"reach": 1e-9}, "reach", "between 2.5e-09 m"),
        ({"method": "iris"}, "method", "firi, one-pass"),
        ({"bounds": [0, 0, 0, 3]}, "bounds", "with a volume"),
        ({"bounds": [1, 0, 6, 3]}, "path", r"path\[0\] must be within"),
        ({"obstacles": [[0.0, 0.0, 0.0]]}, "path", "3 columns"),
    ],
)
def test_refuses_invalid_arguments(changes, field, words):
    arguments = {"obstacles": ROOM, "path": [[0.5, 0.5], [0.5, 2.5]], **changes}
    with pytest.raises(InvalidData, match=words) as caught:
        corridor(arguments.pop("obstacles"), arguments.pop("path"), **arguments)
    assert caught.value.field == field


def test_verification_finds_each_defect():
    path = [[0.5, 0.5], [0.5, 2.5], [5.5, 2.5]]
    result = corridor(ROOM, path, radius=0.2)
    assert len(result) > 1

    def violated(obstacles=ROOM, **changes):
        return {check.name for check in replace(result, **changes).verify(obstacles).violated}

    assert violated() == set()
    assert violated(GridMap(["......", "..@@..", "..@..."])) == {"obstacle"}
    assert violated(radius=0.2 + 1e-9) == {"obstacle"}
    assert violated(offsets=result.offsets + 1e-9) == {"obstacle", "bounds"}
    assert violated(path=np.add(path, [[0, 0], [-0.6, 0], [0, 0]])) == {"path"}
    assert violated(covers=result.covers - np.eye(len(result), 2, 1 - (len(result) - 1)) * 0.5) == {
        "path"
    }
    balls = np.array(result.overlaps)
    balls[0, -1] *= 1.01
    assert violated(overlaps=balls) == {"overlap"}
    assert violated(overlaps=0 * balls + [0.5, 2.0, 0.0]) == {"overlap"}
    assert violated(bounds=[0, 0, 5.9, 3]) == {"bounds"}
    assert "unit normals" in violated(normals=2 * result.normals, offsets=2 * result.offsets)


def test_json_keeps_every_digit():
    result = corridor(ROOM, [[0.5, 0.5], [0.5, 2.5], [5.5, 2.5]], radius=0.1, bounds=[0, 0, 6, 3])
    again = Corridor.from_data(result.data())
    assert tuple(again._feed()) == tuple(result._feed())
    assert again.verify(ROOM).ok
    single = corridor(ROOM, [[0.5, 0.5]])
    assert Corridor.from_data(single.data()).knots.tolist() == single.knots.tolist()
    with pytest.raises(InvalidData, match="owners"):
        replace(result, owners=result.owners + 10**12)
    with pytest.raises(InvalidData, match="overlaps"):
        replace(result, overlaps=np.empty((0, 3)))
