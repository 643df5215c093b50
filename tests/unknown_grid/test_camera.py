"""Camera: frames and their inverses, and contents of images."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.models.unknown_grid import Camera, World
from crosstrack.models.unknown_grid.camera import PIXELS, Pinhole, overlaps
from crosstrack.models.unknown_grid.rendering import render

ODD = st.integers(0, 30).map(lambda half: 2 * half + 1)
PINHOLES = st.builds(
    lambda m, n, row, column, side: Pinhole((m, n), (row, column), side),
    ODD, ODD, st.integers(-60, 1000), st.integers(-60, 1000), st.floats(0.01, 100.0),
)  # fmt: skip
MIDDLES = np.arange(PIXELS) + 0.5


def grid(rows, columns):
    """All pairs, shape (r, c, 2)."""
    return np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1)


# -- transforms -----------------------------------------------------------------------------------


@settings(deadline=None, max_examples=60)
@given(PINHOLES, st.integers(0, 2**32 - 1))
def test_each_transform_has_its_inverse(pinhole, seed):
    rng = np.random.default_rng(seed)
    scale = float(pinhole.view.max()) * pinhole.side
    world = rng.uniform(-scale, scale, (20, 3)) + pinhole.lens * (1, 1, 0)
    close = {"rtol": 0, "atol": 1e-12 * (scale + np.abs(pinhole.lens).max()) * 10}
    np.testing.assert_allclose(
        pinhole.camera_to_world(pinhole.world_to_camera(world)), world, **close
    )
    pixels = rng.uniform(0, PIXELS, (20, 2))
    for depth in (0.5 * pinhole.height, pinhole.height):
        seen = pinhole.pixels_to_camera(pixels, depth)
        assert (seen[:, 2] == depth).all()
        np.testing.assert_allclose(pinhole.camera_to_pixels(seen), pixels, rtol=0, atol=1e-11)
    places = rng.uniform(-100, 1000, (20, 2))
    there = pinhole.map_to_world(places, 0.25)
    assert (there[:, 2] == 0.25).all()
    np.testing.assert_allclose(pinhole.world_to_map(there), places, rtol=0, atol=1e-11)
    np.testing.assert_allclose(
        pinhole.view_to_map(pinhole.map_to_view(places)), places, rtol=0, atol=1e-11
    )


def test_equations_5_to_9_by_hand():
    """A lens 18 m above (4.5, -4.5) and the point (1, -2, 0); its cell is in row 2 and column 1."""
    pinhole = Pinhole((9, 9), (0, 0))
    point = np.array([1.0, -2.0, 0.0, 1.0])
    # -x + 4.5, y + 4.5 and -z + 18; then -y + 4.5, -x + 4.5 and -z + 18 of these.
    seen = pinhole.camera_from_world @ point
    assert seen.tolist() == [3.5, 2.5, 18.0, 1.0]
    assert (pinhole.map_from_camera @ seen).tolist() == [2.0, 1.0, 0.0, 1.0]
    assert (pinhole.map_from_world @ point).tolist() == [2.0, 1.0, 0.0, 1.0]
    back = np.linalg.inv(pinhole.map_from_world) @ [2.0, 1.0, 0.0, 1.0]
    np.testing.assert_allclose(back, point, atol=1e-12)
    # Rotations as printed: by pi about y, and of eq. 8 with cos(pi/2) = 0.
    assert pinhole.camera_from_world[:3, :3].tolist() == [[-1, 0, 0], [0, 1, 0], [0, 0, -1]]
    assert pinhole.map_from_camera[:3, :3].tolist() == [[0, -1, 0], [-1, 0, 0], [0, 0, -1]]
    assert pinhole.world_to_camera(point[:3]).tolist() == seen[:3].tolist()
    assert pinhole.world_to_map(point[:3]).tolist() == [2.0, 1.0]


@settings(deadline=None, max_examples=20)
@given(PINHOLES)
def test_cells_and_pixels_come_back(pinhole):
    """Every cell exactly, through all frames; the middle of every pixel to rounding."""
    m, n = pinhole.view
    cells = grid(np.arange(m), np.arange(n))
    there = pinhole.view_to_map(cells)
    assert there.dtype == np.int64 and (pinhole.map_to_view(there) == cells).all()
    pixels = pinhole.view_to_pixels(cells + 0.5)
    assert (np.floor(pinhole.pixels_to_view(pixels)) == cells).all()
    middles = grid(MIDDLES, MIDDLES)
    back = pinhole.view_to_pixels(pinhole.pixels_to_view(middles))
    # Corners of 1000 cells. With a view of one cell, 256 pixels span a cell.
    np.testing.assert_allclose(back, middles, rtol=0, atol=1e-9)
    assert (np.floor(back) == np.floor(middles)).all()


@settings(deadline=None, max_examples=40)
@given(PINHOLES)
def test_the_view_fills_the_image(pinhole):
    m, n = pinhole.view.tolist()
    corners = pinhole.view_to_pixels([[0, 0], [m, n], [m / 2, n / 2]])
    np.testing.assert_allclose(corners, [[0, 0], [PIXELS] * 2, [PIXELS / 2] * 2], atol=1e-8)
    # Each pixel is in the cell of the exact ratio: rounding moves no pixel over a border.
    seen = np.floor(pinhole.pixels_to_view(np.column_stack([MIDDLES, MIDDLES]))).astype(int).T
    pixels = np.arange(PIXELS)
    assert (seen == [(2 * pixels + 1) * m // 512, (2 * pixels + 1) * n // 512]).all()


def test_parallax_moves_high_points_outwards():
    pinhole = Pinhole((9, 9), (0, 0))
    ground, top = (pinhole.view_to_pixels([[1, 2], [4.5, 4.5], [8, 4.5]], z) for z in (0, 0.6))
    away = np.abs(top - PIXELS / 2) - np.abs(ground - PIXELS / 2)
    assert (away[0] > 0).all() and away[2, 0] > 0
    np.testing.assert_allclose(away[1], 0, atol=1e-9)


@settings(deadline=None, max_examples=40)
@given(st.integers(1, 61), st.sampled_from([64, PIXELS]))
def test_shares_of_pixels_in_cells_are_exact(parts, pixels):
    shares = overlaps(parts, pixels)
    np.testing.assert_allclose(shares.sum(axis=1), 1, atol=1e-12)
    # The mean of x over a cell is its centre.
    middles = (np.arange(pixels) + 0.5) / pixels
    whole = pixels % parts == 0
    found = shares @ middles
    np.testing.assert_allclose(
        found, (np.arange(parts) + 0.5) / parts, atol=1e-12 if whole else 0.5 / pixels
    )
    np.testing.assert_allclose(shares.sum(axis=0), parts / pixels, atol=1e-12)


# -- images ---------------------------------------------------------------------------------------

#: Map with a room, a wall and a block, with a side unlike those of the views.
BLOCKED = np.zeros((21, 23), bool)
BLOCKED[4, 3:15] = BLOCKED[9:13, 14:18] = BLOCKED[15:, 6] = True


def shot(corner=(2, 3), view=(9, 9), law="hard", seed=(1, 2, 3), blocked=BLOCKED, target=(0, 0)):
    return render(blocked, np.array(target), np.array(corner), np.array(view), law, seed)


@pytest.mark.parametrize("law", ["plain", "hard"])
@pytest.mark.parametrize("view", [(1, 1), (3, 3), (9, 9), (11, 5), (35, 35), (61, 3)])
def test_images_are_colours_and_the_same_again(law, view):
    image = shot(view=view, law=law, corner=(-view[0] // 2, 5))
    assert image.shape == (PIXELS, PIXELS, 3)
    assert image.min() >= 0 and image.max() <= 1 and image.std() > 0.005
    assert (image == shot(view=view, law=law, corner=(-view[0] // 2, 5))).all()


@pytest.mark.parametrize("law", ["plain", "hard"])
def test_only_the_noise_changes_from_look_to_look(law):
    first, later = shot(law=law), shot(law=law, seed=(1, 2, 4))
    noise = (first - later)[(first > 0.1) & (first < 0.9)]
    assert 0.005 < noise.std() < 0.08 and abs(noise.mean()) < 0.001
    if law == "hard":
        for other in ((1, 3, 3), (2, 2, 3)):
            assert np.abs(first - shot(seed=other)).mean() > 0.05


@pytest.mark.parametrize("law", ["plain", "hard"])
def test_a_cell_looks_alike_from_another_view(law):
    """Empty ground looks alike in two views that are three cells apart."""
    one, two = shot((10, 18), (5, 5), law), shot((10, 15), (5, 11), law)
    side, there = PIXELS / 5, PIXELS / 11
    pairs = []
    for row in (1, 3):
        for column in (1, 3):  # of the first view; 3 more in the second one
            low = int(column * side + 4), int((column + 3) * there + 2)
            high = int((column + 1) * side - 4), int((column + 4) * there - 2)
            rows = slice(int(row * side + 4), int((row + 1) * side - 4))
            pairs.append([one[rows, low[0] : high[0]], two[rows, low[1] : high[1]]])
    found, again = (
        np.array([x.mean(axis=(0, 1)) for x in some]) for some in zip(*pairs, strict=True)
    )
    np.testing.assert_allclose(found, again, atol=0.02)
    if law == "hard":
        assert found.std(axis=0).max() > 0.03, "cells have colours of their own"


@pytest.mark.parametrize("law", ["plain", "hard"])
def test_off_the_map_there_are_obstacles(law):
    """Images equal those of a larger map with a blocked margin, and hide the target."""
    wide = np.pad(BLOCKED, ((0, 8), (0, 8)), constant_values=True)
    for corner in ((16, 18), (5, 18)):
        assert (shot(corner, law=law) == shot(corner, law=law, blocked=wide)).all()
    nothing = shot((100, -100), law=law)
    assert (nothing == shot((100, -100), law=law, blocked=np.ones_like(BLOCKED))).all()
    assert np.abs(nothing - shot((100, -100), law=law, blocked=np.zeros((300, 9), bool))).max() == 0
    assert (shot(law=law) == shot(law=law, target=(7, 7))).all()


def test_colour_alone_does_not_tell_obstacles_by_the_hard_law():
    """Mean colours separate obstacles in the plain law, but not in the hard law."""
    apart = {}
    for law in ("plain", "hard"):
        gaps = []
        for scene in range(6):
            kinds = [
                shot((5, 5), law=law, seed=(5, scene, 0), blocked=np.full((40, 40), blocked))
                for blocked in (False, True)
            ]
            free, wall = (one.reshape(-1, 3) for one in kinds)
            spread = np.sqrt((free.std(axis=0) ** 2 + wall.std(axis=0) ** 2) / 2)
            gaps.append((np.abs(free.mean(axis=0) - wall.mean(axis=0)) / spread).max())
        apart[law] = gaps
    assert min(apart["plain"]) > 4
    assert max(apart["hard"]) < 0.6


def test_observations_equal_rendered_images():
    model = ct.load("unknown-grid/camera-hard")
    assert isinstance(model.camera, Camera)
    answers = World(model)(np.array([[3.0, -1.0]]))
    corner = model.starts[3] - model.view // 2
    image = render(
        model.blocked[3], model.targets[3], corner, model.view, model.camera.rendering,
        (model.camera.seed, 3, 0),
    )  # fmt: skip
    assert (answers[0, 6:] == image.ravel()).all()
