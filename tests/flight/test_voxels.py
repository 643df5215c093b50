"""Voxel maps: text, points, and exact enlargement."""

import itertools
from fractions import Fraction

import numpy as np
import pytest

from crosstrack.errors import InvalidData
from crosstrack.instances.flight import forest, noise_map
from crosstrack.models.flight import Corridor, VoxelMap


def test_json_has_lines_of_text_and_keeps_every_digit():
    blocked = np.random.default_rng(0).random((3, 4, 5)) < 0.4
    map_ = VoxelMap(blocked, 0.1, (0.1, -0.2, 1 / 3))
    data = map_.data()
    assert data["blocked"][0][0] == "".join(".@"[b] for b in blocked[0, 0].tolist())
    again = VoxelMap.from_data(data)
    assert (again.blocked == blocked).all() and again.cell == 0.1
    assert again.origin.tolist() == [0.1, -0.2, 1 / 3]
    assert VoxelMap(blocked.tolist()).blocked.tolist() == blocked.tolist()


@pytest.mark.parametrize("radius", [0.0, 0.1, 0.2, 0.25, 0.1 * 3**0.5, 0.3, 5.0])
def test_inflated_blocks_exactly_the_cubes_nearer_than_the_radius(radius):
    blocked = np.random.default_rng(1).random((5, 6, 4)) < 0.03
    blocked[0, 0, 0] = True
    map_ = VoxelMap(blocked, 0.1)
    limit = (Fraction(radius) / Fraction(0.1)) ** 2
    expected = blocked.copy()
    for cube in np.ndindex(blocked.shape):
        for other in np.argwhere(blocked):
            gaps = np.maximum(np.abs(other - cube) - 1, 0)
            expected[cube] |= int((gaps**2).sum()) < limit
    if expected.all():
        with pytest.raises(InvalidData, match="blocked"):
            map_.inflated(radius)
    else:
        assert (map_.inflated(radius).blocked == expected).all()


def test_from_points_blocks_the_cubes_that_contain_points():
    cloud = np.random.default_rng(2).random((40, 3)) * [2, 1, 3]
    map_ = VoxelMap.from_points(cloud, 0.3, (0, 0, 0, 2, 1, 3))
    assert map_.shape == (7, 4, 10)
    cubes = {tuple(cube) for cube in map_.cells_of(cloud).tolist()}
    assert {tuple(cube) for cube in np.argwhere(map_.blocked).tolist()} == cubes
    assert not map_.holds(map_.cells_of(cloud)).any()
    wide = VoxelMap.from_points(cloud, 0.3, (0, 0, 0, 2, 1, 3), radius=0.31)
    assert (wide.blocked == map_.inflated(0.31).blocked).all()


def test_a_point_on_a_face_blocks_both_sides():
    map_ = VoxelMap.from_points([[1, 1.5, 2]], 1.0, (0, 0, 0, 3, 3, 3))
    assert {tuple(c) for c in np.argwhere(map_.blocked).tolist()} == set(
        itertools.product((0, 1), (1,), (1, 2))
    )
    corner = VoxelMap.from_points([[0, 0, 0], [2, 2, 2]], 1.0)
    assert corner.shape == (2, 2, 2) and corner.blocked[1, 1, 1] and corner.blocked[0, 0, 0]


def test_the_outside_is_blocked():
    map_ = VoxelMap(np.zeros((2, 2, 2), bool), 0.5, (1, 1, 1))
    assert map_.holds([[0, 0, 0], [-1, 0, 0], [0, 2, 0]]).tolist() == [True, False, False]
    assert map_.centres([1, 1, 1]).tolist() == [1.75, 1.75, 1.75]


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: VoxelMap(np.ones((2, 2, 2), bool)), "blocked"),
        (lambda: VoxelMap(np.zeros((0, 2, 2), bool)), "blocked"),
        (lambda: VoxelMap([["..", "."], ["..", ".."]]), "blocked"),
        (lambda: VoxelMap([["..", ".."], [".."]]), "blocked"),
        (lambda: VoxelMap([["..", ".x"]]), "blocked"),
        (lambda: VoxelMap(np.zeros((2, 2), bool)), "blocked"),
        (lambda: VoxelMap(np.zeros((2, 2, 2), bool), 0.0), "cell"),
        (lambda: VoxelMap(np.zeros((2, 2, 2), bool), 1e-9, (1e6, 0, 0)), "cell"),
        (lambda: VoxelMap(np.zeros((2, 2, 2), bool), 1.0, (0, 0, np.nan)), "origin"),
        (lambda: VoxelMap(np.zeros((2, 2, 2), bool)).inflated(-1), "radius"),
        (lambda: VoxelMap(np.eye(2, dtype=bool)[None], 1e-3).inflated(1e300), "blocked"),
        (lambda: VoxelMap.from_points(np.empty((0, 3)), 1.0), "bounds"),
        (lambda: VoxelMap.from_points([[0, 0, 0]], 1e-6, (0, 0, 0, 9, 9, 9)), "bounds"),
        (lambda: VoxelMap.from_points([[0, 0]], 1.0), "points"),
        (lambda: VoxelMap.from_points([[0, 0, 0], [1e9, 1e9, 1e9]], 1.0), "cell"),
        (lambda: forest(-1), "seed"),
        (lambda: forest(0, (1, 1, 0)), "size"),
        (lambda: forest(0, (1e9, 1e9, 1e9)), "size"),
        (lambda: forest(0, width=(2, 1)), "width"),
        (lambda: noise_map(0, fill=1.5), "fill"),
        (lambda: noise_map(0, octaves=0), "octaves"),
    ],
)
def test_refuses_invalid_arguments(make, field):
    with pytest.raises(InvalidData) as caught:
        make()
    assert caught.value.field == field


@pytest.mark.parametrize("make", [forest, noise_map])
def test_generators_are_seeded_and_keep_points_free(make):
    size, keep = (10.0, 8.0, 4.0), [[1.0, 1.0, 2.0]]
    first, again, other = (make(seed, size, keep=keep, gap=1.0) for seed in (4, 4, 5))
    assert tuple(first._feed()) == tuple(again._feed()) != tuple(other._feed())
    assert first.shape == (40, 32, 16) and 0 < first.blocked.mean() < 0.9
    places = first.centres(np.argwhere(first.blocked))
    assert (np.linalg.norm(places - keep, axis=1) > 1.0).all()


def test_a_pillar_has_full_height_and_noise_fills_its_share():
    map_ = forest(1, (10, 10, 4), pillars=5, rings=0)
    assert (map_.blocked == map_.blocked[:, :, :1]).all() and map_.blocked.any()
    rings = forest(1, (10, 10, 4), pillars=0, rings=3)
    assert rings.blocked.any() and not (rings.blocked == rings.blocked[:, :, :1]).all()
    assert noise_map(0, (10, 10, 4), fill=0.25).blocked.mean() == pytest.approx(0.25, abs=1e-4)


@pytest.mark.parametrize("seed", range(6))
def test_a_corridor_is_verified_against_every_cell(seed):
    """The window of the verification omits no cell: brute force over all cells gives the same depth."""
    rng = np.random.default_rng(seed)
    map_ = VoxelMap(rng.random((8, 9, 7)) < 0.1, 0.1, rng.random(3))
    low, radius = map_.origin + 0.4 * rng.random(3), [0.0, 0.05, 0.1][seed % 3]
    low[seed // 3] = -np.inf  # no face
    offsets = np.concatenate([map_.origin + 0.4 + 0.3 * rng.random(3), -low])
    normals = np.concatenate([np.eye(3), -np.eye(3)])[np.isfinite(offsets)]
    offsets = offsets[np.isfinite(offsets)]
    box = Corridor(
        [offsets[:3]], [[0, 0]], 0 * offsets, normals, offsets, np.empty((0, 4)), radius=radius
    )
    corners = map_.origin + (np.argwhere(map_.blocked)[:, None] + list(np.ndindex(2, 2, 2))) * 0.1
    beyond = (corners @ normals.T - offsets).min(axis=1) - radius
    depth = max(-beyond.max(axis=1).min(), 0.0)
    assert depth > 0 and box.verify(map_).checks[0].worst == pytest.approx(depth, abs=1e-12)
