"""Measure how many cells and whole views k-means and GMGN read from images, and what a planner makes of them.

The network was trained on other scenes and looks. ``python tests/benchmarks/unknown_grid/perception.py
[IMAGES]`` writes the tables ``perception`` and ``led-by-images`` to ``docs/measured/unknown-grid.json``.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.measured import write  # noqa: E402

from crosstrack.instances.unknown_grid import draw_scenes  # noqa: E402
from crosstrack.models.unknown_grid import Camera, Rendering, World  # noqa: E402
from crosstrack.solvers import Control, Request, find_backend  # noqa: E402
from crosstrack.solvers.unknown_grid.perception import METHODS, perceive  # noqa: E402

SEED = 2**20


def read(law: Rendering, view: int, count: int) -> list[Any]:
    """Return the shares of cells and of whole views that each method reads right, in percent."""
    model = draw_scenes(
        "mixed", obstacles=(2, 5), scenes=count, seed=SEED, view=(view, view),
        camera=Camera(law, SEED + view),
    )  # fmt: skip
    look = np.column_stack([np.arange(count), np.full(count, -1.0)])
    images = World(model)(look)[:, 6:].reshape(count, 256, 256, 3)
    world = World(dataclasses.replace(model, camera=None))
    cells = world(look)[:, 6:].reshape(count, view, view) == 1.0
    row: list[Any] = [f"{law}, {view} × {view}", 100.0 * float((~cells).mean())]
    for method in METHODS:
        right = perceive(images, (view, view), method) == cells
        row += [100.0 * float(right.mean()), 100.0 * float(right.all(axis=(1, 2)).mean())]
    return row


def led(law: Rendering | None, method: str, count: int) -> list[Any]:
    """Return what the planner that remembers its map does in scenes of Task 2 by the law paper."""
    camera = None if law is None else Camera(law, SEED)
    model = draw_scenes(
        "paper", obstacles=(2, 5), scenes=count, seed=SEED, view=(9, 9), steps=40, camera=camera
    )
    backend: Any = find_backend("d-star-lite")
    options = backend.checked_options({} if law is None else {"perception": method})
    plan = backend.run(
        model.blinded(), Request(options=options, control=Control(oracle=World(model)))
    ).point
    score = model.score(plan)
    name = "the true map" if law is None else f"{law} images, {method}"
    return [name, 100.0 * score.reached / count, score.collisions / count]


def main() -> None:
    """Measure both tables with the number of images on the command line, by default 100."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    heads = {"rendering, view": "", "free cells %": ".1f"}
    heads |= {f"{one}: {part} %": ".2f" for one in METHODS for part in ("cells", "views")}
    rows = [read(law, view, count) for law in Rendering for view in (9, 11)]
    said = f"{count} images per row, law mixed."
    write("unknown-grid", "perception", __file__, heads, rows, ("torch",), said)
    columns = {"cells from": "", "reached %": ".1f", "collisions a scene": ".2f"}
    ways = [(None, ""), *((law, one) for law in Rendering for one in METHODS)]
    found = [led(law, method, count // 2) for law, method in ways]
    said = f"d-star-lite in {count // 2} scenes of Task 2, law paper."
    write("unknown-grid", "led-by-images", __file__, columns, found, ("torch",), said)


if __name__ == "__main__":
    main()
