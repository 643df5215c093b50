"""Computation of this project's values in the paper's result tables."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from ...models.unknown_grid.camera import Camera
from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.scenes import TASKS
from ..paper import Run, Trials
from .laws import SceneArrays, draw_scenes
from .listing import OBSTACLES, STEPS
from .paper import POLICIES

__all__ = ["figure_8", "policies", "table_6", "times"]

#: Scenes per block, equal to the paper's scenes per table cell.
_BLOCK = 100


@cache
def _scenes(task: int, blocks: int) -> UnknownGridNavigation:
    """Return the scenes of a task: `blocks` times 100 for each number of obstacles in turn."""
    shape, view = TASKS[task - 1]
    parts = [
        draw_scenes("paper", shape=shape, obstacles=number, scenes=blocks * _BLOCK, seed=task)
        for number in OBSTACLES
    ]
    arrays = (
        np.concatenate([getattr(part, name) for part in parts]) for name in SceneArrays._fields
    )
    return SceneArrays(*arrays).pose(view=view, steps=STEPS, name=f"task {task}")


def _successes(run: Run) -> Any:
    """Return the share of targets reached in each block of 100 scenes, percent, shape (obstacles, blocks)."""
    reached = np.array([outcome == "reached" for outcome in run.plan.outcomes])
    return 100.0 * reached.reshape(len(OBSTACLES), -1, _BLOCK).mean(axis=2)


def table_6(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return the success rates of a method in all scenes of a task, percent."""
    task, method = int(row[0]), row[1].lower()
    model = _scenes(task, 2)
    (run,) = trials.run(model, method, runs=1)
    if run.plan is None:
        return {f"{number} obstacles": run.message for number in OBSTACLES}
    blocks = _successes(run)
    return {
        **{
            f"{n} obstacles": float(block.mean())
            for n, block in zip(OBSTACLES, blocks, strict=True)
        },
        "deviation": float(blocks.std(axis=1, ddof=1).mean()),
        "reachable in 40": 100.0 * float(np.mean(model.fewest_steps() <= STEPS)),
    }


def figure_8(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return the reason why the runs of a scene cannot be repeated."""
    return dict.fromkeys(("MCGN", "MACN"), "map only in the picture")


def times(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return the seconds per image or per command of a single vehicle."""
    shape, view = TASKS[0]
    camera = Camera() if row[0].startswith("GMGN") else None
    model = draw_scenes(
        "paper", shape=shape, obstacles=3, scenes=1, seed=2, view=view, camera=camera
    )
    backend = "mcgn" if camera is None else "d-star-lite"
    options = {} if camera is None else {"perception": "gmgn"}
    (run,) = trials.run(model, backend, runs=1, options=options)
    if run.plan is None:
        return {"seconds": run.message}
    name = "ms a decision" if camera is None else "ms an image"
    return {"seconds": run.statistics[name] / 1e3}


def policies(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return the performance of a policy in the scenes of Task 2."""
    backend, options = POLICIES[row[0]]
    model = _scenes(2, 1)
    (run,) = trials.run(model, backend, runs=1, options=options)
    if run.plan is None:
        return {"reached %": run.message}
    shares = _successes(run)
    reached = np.array([outcome == "reached" for outcome in run.plan.outcomes])
    steps = np.array([len(actions) for actions in run.plan.actions])
    ratios = (steps / model.fewest_steps())[reached]
    return {
        "reached %": float(shares.mean()),
        "deviation": float(shares.std(ddof=1)),
        "steps / fewest": float(ratios.mean()) if len(ratios) else "no target reached",
        "collisions a scene": model.score(run.plan).collisions / model.scenes,
    }
