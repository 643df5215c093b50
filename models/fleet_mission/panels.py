"""Panels of a mission over time: limited quantities, distances between robots, and the timeline."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ..minimum_snap import Trajectory
from ..plots import kit
from ..verification import Check
from .model import FleetMission
from .plan import MissionPlan

__all__ = ["curve_of", "panels_of", "sample_times"]

#: Minimum number of samples per segment, and approximate number per curve.
_FEWEST, _POINTS = 9, 1500
_AXIS = re.compile(r"robot (\d+), axis (\d)")


def panels_of(
    model: FleetMission, plan: MissionPlan, parts: list[str], tolerance: float, *, named: bool
) -> Iterable[kit.Panel]:
    """Yield the panels; `named` labels the curves by robot for figures without a map."""
    ends = np.array([0.0, plan.end or 1.0])
    flown = [(k, item) for k, item in enumerate(plan.trajectories) if item is not None]
    if "timeline" in parts:
        away = [np.hypot(*(item(sample_times(item)) - model.depot).T) for _, item in flown]
        curves = [
            kit.Curve(f"robot {k}" if named else "robot", k, sample_times(item), values, 1.1)
            for (k, item), values in zip(flown, away, strict=True)
        ]
        yield kit.Panel("distance from the depot", "m", curves, [])
    limits = {"velocity": model.velocity_limit, "acceleration": model.acceleration_limit}
    for order, (part, limit_values) in enumerate(limits.items(), start=1):
        if part not in parts:
            continue
        tables = [(k, sample_times(item), item(sample_times(item), order)) for k, item in flown]
        for axis, bound in enumerate(limit_values.tolist()):
            curves = [
                kit.Curve(f"robot {k}" if named else part, k, times, values[:, axis], 1.1)
                for k, times, values in tables
            ]
            limit = kit.Limit(ends, -bound, bound, tolerance=tolerance * bound)
            unit = "m/s" if order == 1 else "m/s²"
            yield kit.Panel(f"{part} {'xy'[axis]}", unit, curves, [limit])
    if "distance" in parts:
        knots = [item.times for _, item in flown]
        times = np.unique(np.concatenate([np.linspace(ends[0], ends[1], 3001), *knots]))
        curve = kit.Curve("least distance", 6, times, _apart_of(model, plan, times))
        separation = kit.Limit(ends, model.separation, np.inf, tolerance=tolerance * model.cell)
        yield kit.Panel("distance of robots", "m", [curve], [separation] * (model.separation > 0))


def curve_of(
    check: Check, places: Sequence[Any], panels: Sequence[kit.Panel]
) -> tuple[Any, kit.Curve, float] | None:
    """Return axes, curve and time of a check of a limit or of the distance; None for other checks."""
    time, limited = kit.time_of(check), _AXIS.match(check.where)
    if time is None or not (limited or check.name == "distance between robots"):
        return None
    title, robot = "distance of robots", 6
    if limited:
        title, robot = f"{check.name.split()[0]} {'xy'[int(limited[2])]}", int(limited[1])
    for axes, panel in zip(places, panels, strict=True):
        for curve in panel.curves:
            if panel.title == title and curve.colour == robot:
                return axes, curve, time
    return None


def sample_times(trajectory: Trajectory | None) -> kit.Floats:
    """Return the sampling times of a curve, s, including its knots."""
    if trajectory is None:
        return np.empty(0)
    each = max(_FEWEST, _POINTS // trajectory.segments)
    shares = np.linspace(0.0, 1.0, each, endpoint=False)
    inner = trajectory.times[:-1, None] + shares * trajectory.durations[:, None]
    return np.append(inner.ravel(), trajectory.times[-1])


def _apart_of(model: FleetMission, plan: MissionPlan, times: kit.Floats) -> kit.Floats:
    """Return the least distance of two robots under way at each of `times`, m.

    The distance is NaN if fewer than two robots are under way.
    """
    places = np.full((len(plan.trajectories), len(times), 2), np.nan)
    for k, entry in enumerate(plan.trajectories):
        if entry is not None:
            under_way = (times >= entry.times[0]) & (times <= entry.times[-1])
            places[k, under_way] = entry(times[under_way])
    least = np.full(len(times), np.inf)
    for k in range(len(places) - 1):
        distances = np.hypot(*np.moveaxis(places[k + 1 :] - places[k], -1, 0))
        least = np.minimum(least, np.where(np.isnan(distances), np.inf, distances).min(axis=0))
    # The least distance jumps when a robot departs or returns, so the line is interrupted.
    counted = np.isfinite(places[..., 0]).sum(axis=0)
    least[1:][np.diff(counted) != 0] = np.inf
    return np.where(np.isfinite(least), least, np.nan)
