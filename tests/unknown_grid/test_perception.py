"""Cells from images: validation, k-means, and the network, with a small training."""

import dataclasses
import importlib.util

import numpy as np
import pytest
from unknown_grid.scenes import run

import crosstrack as ct
from crosstrack.errors import BackendMissing, InvalidData
from crosstrack.instances.unknown_grid import draw_scene_arrays, draw_scenes
from crosstrack.models.unknown_grid import Rendering
from crosstrack.models.unknown_grid.rendering import render
from crosstrack.solvers.contract.registry import find_backend
from crosstrack.solvers.learning.training import train
from crosstrack.solvers.unknown_grid.perception import METHODS, perceive

#: Room with a wall and a gap.
ROOM = np.zeros((9, 9), bool)
ROOM[3, :6] = ROOM[6:, 7] = True


@pytest.fixture(params=METHODS)
def method(request):
    """Return the methods available in this environment."""
    if request.param == "gmgn":
        pytest.importorskip("torch", reason="the network needs PyTorch, which is an extra")
    return request.param


def look(blocked, centre, view, law="plain", seed=(3, 4, 5)):
    """Return an image and the cells that it shows."""
    view = np.array(view)
    corner = np.array(centre) - view // 2
    image = render(blocked, np.array(centre), corner, view, Rendering(law), seed)
    wide = np.pad(blocked, 40, constant_values=True)
    (row, column), (m, n) = corner + 40, view
    return image[None], wide[row : row + m, column : column + n]


def drawn(number, view, law, seed):
    """Return images of drawn scenes around their starts, and their cells."""
    model = draw_scenes("mixed", scenes=number, obstacles=4, seed=seed)
    pairs = [
        look(one, start, view, law, (seed, k, 0))
        for k, (one, start) in enumerate(zip(model.blocked, model.starts, strict=True))
    ]
    images, cells = zip(*pairs, strict=True)
    return np.concatenate(images), np.array(cells)


# -- what is refused ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "limit"),
    [
        (np.nan, "be finite, got nan"), (np.inf, "be finite, got inf"),
        (-0.001, "be >= 0, got -0.001"), (1.5, "be <= 1, got 1.5"),
    ],
)  # fmt: skip
def test_a_value_that_is_no_colour_is_refused_by_its_place(value, limit):
    images = np.full((3, 256, 256, 3), 0.5)
    images[1, 17, 250, 2] = value
    message = rf"images\[1, 17, 250, 2\] must {limit}"
    for method in METHODS:  # before the network is loaded
        with pytest.raises(InvalidData, match=message):
            perceive(images, (9, 9), method)


@pytest.mark.parametrize(
    ("images", "view", "method", "message"),
    [
        (np.zeros((256, 256, 3)), (9, 9), "k-means", "images must have shape"),
        (np.zeros((1, 256, 255, 3)), (9, 9), "k-means", "images must have shape"),
        (np.zeros((1, 3, 256, 256)), (9, 9), "gmgn", "images must have shape"),
        ("image", (9, 9), "k-means", "images must be an array of numbers"),
        (
            np.zeros((1, 256, 256, 3)),
            (9, 8),
            "k-means",
            r"view must be two odd numbers of cells, got \(9, 8\)",
        ),
        (np.zeros((1, 256, 256, 3)), (-1, 9), "gmgn", r"view\[0\] must be >= 1, got -1"),
        (np.zeros((1, 256, 256, 3)), (9.5, 9), "k-means", r"view\[0\] must be whole"),
        (np.zeros((1, 256, 256, 3)), 9, "k-means", "view must have shape"),
        (np.zeros((1, 256, 256, 3)), (9, 9), "eyes", "perception must be one of k-means, gmgn"),
    ],
)
def test_rejects_invalid_images_and_views(images, view, method, message):
    with pytest.raises(InvalidData, match=message):
        perceive(images, view, method)


def test_without_pytorch_the_error_names_the_package(monkeypatch):
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util,
        "find_spec",
        lambda name, *rest: None if name == "torch" else found(name, *rest),
    )
    with pytest.raises(BackendMissing, match=r"pip install 'crosstrack\[learn\]'"):
        perceive(np.zeros((1, 256, 256, 3)), (9, 9), "gmgn")


# -- what both do ---------------------------------------------------------------------------------


@pytest.mark.parametrize("view", [(1, 1), (3, 3), (5, 13), (9, 9), (17, 17)])
def test_the_plain_law_is_read(method, view):
    image, cells = look(ROOM, (4, 4), view)
    found = perceive(image, view, method)
    assert found.dtype == bool and found.shape == (1, *view)
    if method == "k-means":
        assert (found[0] == cells).all()
    else:
        assert (found[0] == cells).mean() > 0.9


@pytest.mark.parametrize("view", [(1, 1), (9, 9), (7, 61)])
def test_noise_gets_an_answer_and_the_same_again(method, view):
    noise = np.random.default_rng(1).random((3, 256, 256, 3))
    flat = np.stack([np.zeros((256, 256, 3)), np.ones((256, 256, 3))])
    images = np.concatenate([noise, flat])
    found = perceive(images, view, method)
    assert found.shape == (5, *view) and found.dtype == bool
    assert (found == perceive(images, view, method)).all()
    assert perceive(images[:0], view, method).shape == (0, *view)
    if method == "k-means":
        assert not found[3:].any(), "one colour is the ground, for the vehicle stands on it"


def test_an_image_is_read_alike_alone_and_among_others(method):
    images, _ = drawn(18, (9, 9), "hard", 1)
    together = perceive(images, (9, 9), method)
    alone = np.concatenate([perceive(one[None], (9, 9), method) for one in images])
    # The order of sums differs, but no logit is close to 0.
    assert (together == alone).all()


def test_an_image_of_ground_alone_has_no_obstacle():
    empty = np.zeros((30, 30), bool)
    for seed in range(5):
        image, _ = look(empty, (15, 15), (9, 9), seed=(seed, 0, 0))
        assert not perceive(image, (9, 9)).any()


def test_the_vehicle_stands_on_free_ground():
    """The method also works if most cells of the view are blocked."""
    for blocked in (ROOM, ~ROOM):
        free = np.argwhere(~blocked)
        for centre in free[:: max(len(free) // 4, 1)]:
            image, cells = look(blocked, centre, (7, 7))
            found = perceive(image, (7, 7))[0]
            assert not found[3, 3]
            assert (found == cells).all()


# -- the network that is shipped ------------------------------------------------------------------


def test_the_network_detects_obstacles_that_colour_hides():
    pytest.importorskip("torch", reason="the network needs PyTorch, which is an extra")
    for view in ((9, 9), (11, 11)):
        images, cells = drawn(20, view, "hard", 77)
        right = {one: (perceive(images, view, one) == cells).mean() for one in METHODS}
        assert right["gmgn"] >= 0.9
        assert right["k-means"] < 0.8


def test_policies_work_on_images():
    """In the hard law, true cells and cells from the network lead to similar runs."""
    pytest.importorskip("torch", reason="the network needs PyTorch, which is an extra")
    model = draw_scenes(
        "walls",
        scenes=2,
        obstacles=4,
        seed=5,
        shape=(13, 13),
        view=(9, 9),
        camera={"rendering": "hard", "seed": 2},
    )
    planner = find_backend("d-star-lite")
    without = dataclasses.replace(model, camera=None)
    truth = model.score(run(planner, without).point).reached
    answer = run(planner, model, perception="gmgn")
    assert model.verify(answer.point).ok
    assert model.score(answer.point).reached == truth == 2
    assert answer.statistics["ms an image"] > 0


def test_a_run_with_k_means_of_the_plain_law_is_that_of_true_cells():
    model = ct.load("unknown-grid/camera-plain")
    few = {name: getattr(model, name)[:3] for name in ("blocked", "starts", "targets")}
    model = dataclasses.replace(model, **few)
    planner = find_backend("d-star-lite")
    found = run(planner, model, perception="k-means").point
    assert found == run(planner, dataclasses.replace(model, camera=None)).point


# -- training -------------------------------------------------------------------------------------


@pytest.mark.timeout(120)
def test_a_tiny_network_learns(tmp_path, monkeypatch):
    pytest.importorskip("torch", reason="the network needs PyTorch, which is an extra")
    from crosstrack.solvers.unknown_grid import gmgn
    from crosstrack.solvers.unknown_grid.networks import load_network

    monkeypatch.setattr(gmgn, "ARCHITECTURE", {"channels": 16, "inner": 16, "cells": 4})
    monkeypatch.setattr(gmgn, "VIEWS", {(3, 3): 1})
    for name, value in (("_HARD", 0.0), ("_SCENES", 4), ("_JUDGED", 1)):
        monkeypatch.setattr(gmgn, name, value)
    tiny = {"options": {"images": 2, "batches": 6, "rate": 0.01}, "epochs": 2, "seed": 4}
    files = tmp_path / "first.npz", tmp_path / "again.npz"
    done, again = (train("gmgn", file, examples=draw_scene_arrays, **tiny) for file in files)
    assert done.figures[1]["loss"] < 0.8 * done.figures[0]["loss"]
    assert done.figures == again.figures
    first, second = (load_network("gmgn", file) for file in files)
    for name, one in first.state_dict().items():
        assert (one == second.state_dict()[name]).all(), name
    with pytest.raises(InvalidData, match="examples must be a function"):
        train("gmgn", files[0], **tiny)
