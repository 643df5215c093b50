"""Data of a mission's figure: sampled curves, distances over time and violations."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from ..minimum_snap import Trajectory
from ..plots import kit
from ..verification import Check, Verification
from .model import FleetMission
from .plan import MissionPlan

__all__ = ["apart_of", "broken_places", "sample_times"]

#: Minimum number of samples per segment, and approximate number per curve.
_FEWEST, _POINTS = 9, 1500
#: Patterns of the robots and of the time in the text of a check.
_WHO = re.compile(r"robots? (\d+)(?: and (\d+))?")
_WHEN = re.compile(r"\(t = (\S+) s\)")


def sample_times(trajectory: Trajectory | None) -> kit.Floats:
    """Return the sampling times of a curve, s, including its knots."""
    if trajectory is None:
        return np.empty(0)
    each = max(_FEWEST, _POINTS // trajectory.segments)
    shares = np.linspace(0.0, 1.0, each, endpoint=False)
    inner = trajectory.times[:-1, None] + shares * trajectory.durations[:, None]
    return np.append(inner.ravel(), trajectory.times[-1])


def apart_of(model: FleetMission, plan: MissionPlan, times: kit.Floats) -> kit.Floats:
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


def broken_places(plan: MissionPlan, found: Verification) -> kit.Floats:
    """Return the positions of the robots at the largest violation of each check, m, shape (k, 2)."""
    places = [place for check in found.violated for place in _places_of(plan, check)]
    broken = np.array(places).reshape(-1, 2)
    return broken[(np.abs(broken) < kit.FAR).all(axis=1)]


def _places_of(plan: MissionPlan, check: Check) -> Iterator[kit.Floats]:
    """Yield the positions of the robots named by a check, at its time or at their ends."""
    who, when = _WHO.search(check.where), _WHEN.search(check.where)
    for robot in map(int, filter(None, who.groups() if who else ())):
        entry = plan.trajectories[robot] if robot < len(plan.trajectories) else None
        if entry is None:
            continue
        if when is not None:
            yield entry(np.clip(float(when[1]), entry.times[0], entry.times[-1]))
        elif check.where.endswith((", start", ", end")):
            yield entry(entry.times[0 if check.where.endswith("start") else -1])
