"""Cells read from images: how many are right, how long it takes, and what a planner makes of them.

For each law of rendering and each of the paper's views: the share of cells and of whole maps that are right, with
milliseconds an image, read one by one as in a run of one scene and many at once. Then the planner that remembers
its map is led by true cells, by k-means and by the network, in scenes of the walls law; shown are the targets
reached within the steps, with Wilson's intervals at 95 % confidence, collisions, and ways that were wrongly said not
to be there. Scenes and looks are none that the network was trained on. Only milliseconds depend on the machine. Run
with ``make bench``, or with fewer images::

    CROSSTRACK_UNKNOWN_GRID_IMAGES=100 pytest tests/benchmarks/unknown_grid/test_perception.py -s
"""

from __future__ import annotations

import dataclasses
import os
import time
from typing import Any

import numpy as np
import pytest
from scipy.stats import binomtest

from crosstrack.instances.unknown_grid import draw_scenes
from crosstrack.instances.unknown_grid.settings import OBSTACLES, STEPS, TASKS
from crosstrack.models import UnknownGridNavigation
from crosstrack.models.unknown_grid import Camera, Rendering, World
from crosstrack.solvers import Control, Request, find_backend
from crosstrack.solvers.unknown_grid.perception import METHODS, perceive

IMAGES = int(os.environ.get("CROSSTRACK_UNKNOWN_GRID_IMAGES", "400"))
#: Scenes that the planner is led through, by each law and way to read images.
SCENES = 100
#: Images that are read one by one, for milliseconds.
ALONE = 20
SEED = 2**20
#: What is asked of the network by the hard law.
LEAST = 0.98


def shown(law: Rendering, view: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return images of scenes at their starts, and which cells are blocked."""
    model = draw_scenes(
        "mixed", obstacles=(2, 5), scenes=count, seed=SEED, view=(view, view),
        camera=Camera(law, SEED + view),
    )  # fmt: skip
    look = np.column_stack([np.arange(count), np.full(count, -1.0)])
    images = World(model)(look)[:, 6:].reshape(count, 256, 256, 3)
    cells = World(dataclasses.replace(model, camera=None))(look)[:, 6:].reshape(count, view, view)
    return images, cells == 1.0


@pytest.mark.timeout(0)
def test_cells_and_maps(capsys: Any) -> None:
    """The share of cells and of maps that are right."""
    pytest.importorskip("torch", reason="the network needs PyTorch, which is an extra")
    found: dict[tuple[str, str, int], float] = {}
    with capsys.disabled():
        print(f"\n{IMAGES} images each, mixed law of scenes")
        print("| law | view | method | cells % | maps % | ms an image | one alone |")
        print("|---|---|---|---|---|---|---|")
        for law in Rendering:
            for view in (9, 11):
                images, cells = shown(law, view, IMAGES)
                free = 100 * float((~cells).mean())
                print(f"| {law} | {view} | all free | {free:.2f} | | | |")
                for method in METHODS:
                    perceive(images[:1], (view, view), method)
                    begin = time.perf_counter()
                    right = perceive(images, (view, view), method) == cells
                    many = 1e3 * (time.perf_counter() - begin) / len(images)
                    begin = time.perf_counter()
                    for one in images[:ALONE]:
                        perceive(one[None], (view, view), method)
                    alone = 1e3 * (time.perf_counter() - begin) / len(images[:ALONE])
                    found[law, method, view] = float(right.mean())
                    maps = 100 * float(right.all(axis=(1, 2)).mean())
                    print(
                        f"| {law} | {view} | {method} | {100 * right.mean():.2f} | {maps:.1f} | {many:.1f} "
                        f"| {alone:.1f} |",
                        flush=True,
                    )
    for view in (9, 11):
        assert found["hard", "gmgn", view] >= LEAST
        assert found["hard", "gmgn", view] > found["hard", "k-means", view]


def led(model: UnknownGridNavigation, method: str) -> tuple[int, int, int]:
    """Return targets that the planner reached, collisions, and ways that it said there were not."""
    backend: Any = find_backend("d-star-lite")
    options = backend.checked_options({} if model.camera is None else {"perception": method})
    request = Request(options=options, control=Control(oracle=World(model)))
    plan = backend.run(model.blinded(), request).point
    score = model.score(plan)
    return score.reached, score.collisions, plan.outcomes.count("no way")


@pytest.mark.timeout(0)
def test_a_planner_that_is_led_by_images(capsys: Any) -> None:
    """Targets reached in scenes of the walls law, spread evenly over all cells of Table VI."""
    pytest.importorskip("torch", reason="the network needs PyTorch, which is an extra")
    share = -(-SCENES // (len(TASKS) * len(OBSTACLES)))
    cells = [
        draw_scenes(
            obstacles=obstacles, shape=(task.side, task.side), view=(task.view, task.view),
            steps=STEPS, scenes=share, seed=SEED + number,
        )
        for number, task in TASKS.items()
        for obstacles in OBSTACLES
    ]  # fmt: skip
    scenes = share * len(cells)
    reached: dict[str, int] = {}
    with capsys.disabled():
        print(f"\nd-star-lite, {scenes} scenes of the walls law")
        print(
            "| cells | targets reached % | collisions a scene | wrongly no way |\n|---|---|---|---|"
        )
        for law, method in ((None, "true"), *((law, one) for law in Rendering for one in METHODS)):
            camera = None if law is None else Camera(law, SEED)
            every = [led(dataclasses.replace(one, camera=camera), method) for one in cells]
            there, hits, lost = np.sum(every, axis=0).tolist()
            low, high = binomtest(there, scenes).proportion_ci(method="wilson")
            name = method if law is None else f"{method}, {law}"
            reached[name] = there
            print(
                f"| {name} | {100 * there / scenes:.1f} ({100 * low:.0f}–{100 * high:.0f}) | "
                f"{hits / scenes:.2f} | {lost} |",
                flush=True,
            )
    assert reached["gmgn, hard"] > reached["k-means, hard"]
