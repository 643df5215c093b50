"""Checks of data whose best durations would be 0."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...errors import InvalidData

__all__ = ["check_limits", "check_movement"]


def check_limits(model: Any) -> None:
    """Reject a minimum of the time alone that is 0 or that other fields fix."""
    for name in ("time_weight", "total_time"):
        if getattr(model, name):
            raise InvalidData(
                f"{name} must be left out with minimise='time', got {getattr(model, name):g}",
                field=name,
            )
    limited = any(bound.derivative for bound in model.bounds)
    if not limited and (model.vehicle is None or not model.vehicle.limits):
        raise InvalidData(
            "minimise='time' needs a vehicle with limits or a limit of velocity, acceleration or "
            "jerk: otherwise the shorter, the better, and no duration > 0 is the best",
            field="minimise",
        )
    _check_rest(model)


def _check_rest(model: Any) -> None:
    """Reject a time that has no minimum above 0, because a path at rest meets every condition."""
    table = model.conditions
    confined = model.halfspaces is not None or any(not b.derivative for b in model.bounds)
    if confined or np.any(np.isfinite(table[:, 1:]) & (table[:, 1:] != 0.0)):
        return
    low = np.where(np.isfinite(model.waypoints), model.waypoints, np.inf).min(axis=0)
    high = np.where(np.isfinite(model.waypoints), model.waypoints, -np.inf).max(axis=0)
    for point in [np.zeros(model.dimensions), *(gate.frame.centre for gate in model.gates)]:
        rest = np.where(np.isfinite(low), low, point)
        inside = all((gate.excess(rest) <= 0.0).all() for gate in model.gates)
        if (low >= high).all() and inside:
            raise InvalidData(
                f"waypoints and gates allow a path at rest at {rest.tolist()}: the shorter, the "
                "better, and no duration > 0 is the best",
                field="waypoints",
            )


def check_movement(model: Any) -> None:
    """Reject a segment without motion: its objective has no minimum over positive durations."""
    table = model.conditions
    still = np.all((table[:, 1:] == 0.0) | ~np.isfinite(table[:, 1:]), axis=(1, 2))
    before, after = model.waypoints[:-1], model.waypoints[1:]
    known = np.isfinite(before) & np.isfinite(after)
    same = np.where(known, before == after, True).all(axis=1) & known.any(axis=1)
    idle = np.flatnonzero(same & still[:-1] & still[1:])
    if idle.size:
        knot = int(idle[0]) + 1
        shown = [float(x) if np.isfinite(x) else None for x in model.waypoints[knot]]
        raise InvalidData(
            f"waypoints[{knot}] = {shown} repeats waypoints[{knot - 1}]: the shorter that "
            "segment, the better, and no duration > 0 is the best",
            field="waypoints",
        )
