"""Departure times that keep the robots separated."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ...models.fleet_mission.curves import nearest
from ...models.fleet_mission.model import FleetMission
from ...models.minimum_snap.trajectory import Trajectory
from .schedule import is_clear

__all__ = ["departures"]

#: Number of departure steps per total flight time of all robots.
TRIED = 200
#: Maximum number of departures per robot, if moving obstacles stop late.
LATER = 60
#: Latest departure in total flight times: later times have too few digits for the segments.
LATEST = 1e6


def departures(
    problem: FleetMission, flights: Sequence[Trajectory], slack: float,
    stopped: Callable[[], object] = lambda: False,
) -> list[Trajectory]:  # fmt: skip
    """Return the trajectories, delayed so that the robots keep their separation.

    Each robot in turn departs as early as the previous ones and moving obstacles allow. Departing after all of
    them have returned or stopped is the last attempt. Until then robots wait in the depot's queue. `flights`
    begin at time 0, and `slack` is the accuracy of the least distance, m. Once `stopped` returns true, the
    remaining robots depart one after another.
    """
    if not problem.moving and (problem.separation == 0.0 or len(flights) < 2):
        return list(flights)
    # The longest trajectory first, as the shorter ones are easier to fit in.
    order = sorted(range(len(flights)), key=lambda k: -flights[k].duration)
    step = sum(entry.duration for entry in flights) / TRIED
    still = max(0.0, *(float(item.times[-1]) for item in problem.moving), 0.0)
    still = min(still, LATEST * TRIED * step)
    fine = step / max(1, int(np.ceil(step / max(flights[order[-1]].duration / 200, 1e-12))))
    placed: dict[int, Trajectory] = {}
    for k in order:
        latest = max(still, *(float(entry.times[-1]) for entry in placed.values()), 0.0)
        coarse = max(step, latest / LATER)
        for delay in (*np.arange(0.0, latest, coarse).tolist(), latest):
            if delay < latest and stopped():
                continue
            placed[k] = moved = Trajectory(flights[k].times + delay, flights[k].coefficients)
            near = [e for other, e in placed.items() if other != k and delay < e.times[-1]]
            is_apart = all(_apart(problem, moved, entry, fine, slack) for entry in near)
            if is_apart and is_clear(problem, [moved], slack):
                break
    return [placed[k] for k in range(len(flights))]


def _apart(
    problem: FleetMission, one: Trajectory, other: Trajectory, step: float, slack: float
) -> bool:
    """Return whether two robots keep their distance: a fast test at samples, then a proof."""
    begin, end = max(one.times[0], other.times[0]), min(one.times[-1], other.times[-1])
    times = np.arange(begin, end, step)
    if times.size and (np.hypot(*(one(times) - other(times)).T) < problem.separation).any():
        return False
    return bool(nearest([one, other], slack).distance >= problem.separation)
