"""Runs on unknown grids as tables."""

from __future__ import annotations

import os
from pathlib import Path

from ...files import write_text
from ...models.fields import required
from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.plan import NavigationRuns
from ..exports import ExportFormat

__all__ = ["CSV", "write_runs_csv"]

_COLUMNS = "scene,step,action,row,column,collided"


def write_runs_csv(
    plan: NavigationRuns, path: str | os.PathLike[str], *, model: UnknownGridNavigation
) -> Path:
    """Write one row a step as CSV, in one step; return the path.

    The columns are the scene, the step from 1, the action (U, D, L or R), row and column after it, all
    counted from 0, and 1 where it was a collision, else 0. Each scene begins with a row of step 0,
    which has no action: the start.

    Parameters
    ----------
    plan : NavigationRuns
        The runs.
    path : path-like
        The file.
    model : UnknownGridNavigation
        What they are for, with its true maps.

    Raises
    ------
    InvalidData
        Runs of another number of scenes, or a file that cannot be written.
    """
    required("plan", plan, NavigationRuns)
    replays = required("model", model, UnknownGridNavigation).replays(plan)
    lines = [_COLUMNS]
    for scene, (actions, one) in enumerate(zip(plan.actions, replays, strict=True)):
        hits = [0, *one.collided.astype(int).tolist()]
        for step, (action, (row, column), hit) in enumerate(
            zip(["", *actions], one.positions.tolist(), hits, strict=True)
        ):
            lines.append(f"{scene},{step},{action},{row},{column},{hit}")
    return write_text(path, "\n".join(lines) + "\n")


CSV = ExportFormat("one row a step (CSV)", ".csv", write_runs_csv)
