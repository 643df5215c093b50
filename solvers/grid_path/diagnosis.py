"""Diagnosis of unreachable goals by the connected free cells around the start."""

from __future__ import annotations

import numpy as np

from ...models.grid_path.model import GridPath, Reach
from ..run.diagnosis import Diagnosis, Finding

__all__ = ["diagnose_path"]

_METHOD = "the free cells that are joined to the start"


def diagnose_path(model: GridPath, time_limit: float | None = None) -> Diagnosis:
    """Return the unreachable goals, with the nearest reachable cell of each, the nearest goal first.

    Diagonal steps without cutting corners and straight segments within free cells reach the same cells as
    steps along rows and columns. One labelling therefore applies to every connectivity. The time limit is not used,
    because the diagnosis takes one pass over the map.
    """
    from scipy.ndimage import distance_transform_edt, label

    grid = model.map
    parts, count = label(~grid.blocked)
    reachable = parts == parts[tuple(model.start)]
    reached = reachable[tuple(model.goals.T)]
    size = f"{np.count_nonzero(reachable)} of {np.count_nonzero(~grid.blocked)} free cells"
    each = model.reach is Reach.EACH
    if reached.all() or (reached.any() and not each):
        goals = (
            f"{np.count_nonzero(reached)} of {len(reached)} goals"
            if len(reached) > 1
            else "the goal"
        )
        summary = f"a path exists: {goals} can be reached, and {size} in all"
        return Diagnosis(model.name, True, _METHOD, summary)
    nearest = distance_transform_edt(~reachable, return_distances=False, return_indices=True)
    findings = []
    for k in np.flatnonzero(~reached).tolist():
        goal = model.goals[k]
        cell = nearest[:, goal[0], goal[1]]
        away = float(np.hypot(*(cell - goal))) * grid.cell
        text = (
            f"goals[{k}] at row {goal[0]}, column {goal[1]} cannot be reached; the nearest cell that "
            f"can is at row {cell[0]}, column {cell[1]}, {away:.6g} m away"
        )
        data = {"goal": k, "cell": goal.tolist(), "nearest": cell.tolist(), "distance": away}
        findings.append(Finding(text, "", f"goals[{k}]", data))
    findings.sort(key=lambda finding: (finding.data or {})["distance"])
    which = f"{len(findings)} of {len(reached)} goals" if len(reached) > 1 else "the goal"
    summary = (
        f"no path: {which} cannot be reached; {size} are joined to the start, and the map falls into "
        f"{count} parts"
    )
    return Diagnosis(model.name, False, _METHOD, summary, tuple(findings))
