"""Export of runs on unknown grids as tables."""

from __future__ import annotations

import os
from pathlib import Path

from ...models.fields import required
from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.plan import NavigationRuns
from ..exports import ExportFormat
from ..tables import write_rows

__all__ = ["CSV", "write_runs_csv"]

_COLUMNS = ("scene", "step", "action", "row", "column", "collided")


def write_runs_csv(
    plan: NavigationRuns, path: str | os.PathLike[str], *, model: UnknownGridNavigation
) -> Path:
    """Write the runs as CSV with one row per step, atomically.

    The columns are the scene (from 0), the step (from 1), the action (U, D, L or R), row and column after
    the step (from 0), and 1 for a collision or 0. Each scene begins with a row of step 0 without an action:
    the start.

    Parameters
    ----------
    plan, path, model
        Runs of all scenes, file to write, and model of the plan.

    Returns
    -------
    pathlib.Path
        Path of the file.

    Raises
    ------
    InvalidData
        The numbers of runs and scenes differ, or the file cannot be written.
    """
    required("plan", plan, NavigationRuns)
    replays = required("model", model, UnknownGridNavigation).replays(plan)
    rows = []
    for scene, (actions, run) in enumerate(zip(plan.actions, replays, strict=True)):
        hits = [0, *run.collided.astype(int).tolist()]
        for step, (action, (row, column), hit) in enumerate(
            zip(["", *actions], run.positions.tolist(), hits, strict=True)
        ):
            rows.append((scene, step, action, row, column, hit))
    return write_rows(path, _COLUMNS, rows)


CSV = ExportFormat("one row per step (CSV)", ".csv", write_runs_csv)
