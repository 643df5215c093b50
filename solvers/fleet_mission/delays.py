"""Departure times that keep the robots separated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...models.fleet_mission.curves import nearest
from ...models.fleet_mission.model import FleetMission
from ...models.minimum_snap.trajectory import Trajectory

__all__ = ["departures"]

#: Number of departure steps per total flight time of all robots.
TRIED = 200


def departures(
    problem: FleetMission, flights: Sequence[Trajectory], slack: float
) -> list[Trajectory]:
    """Return the trajectories, delayed so that the robots keep their separation.

    Each robot in turn departs as early as the previous ones allow. Departing after all of them have
    returned is always feasible, as robots then wait in the depot's queue.

    Parameters
    ----------
    problem : FleetMission
        The mission with its required separation.
    flights : sequence of Trajectory
        One trajectory per robot, from time 0.
    slack : float
        Accuracy of the least distance, m.
    """
    if problem.separation == 0.0 or len(flights) < 2:
        return list(flights)
    # The longest trajectory first, as the shorter ones are easier to fit in.
    order = sorted(range(len(flights)), key=lambda k: -flights[k].duration)
    step = sum(entry.duration for entry in flights) / TRIED
    fine = step / max(1, int(np.ceil(step / max(flights[order[-1]].duration / 200, 1e-12))))
    placed: dict[int, Trajectory] = {}
    for k in order:
        latest = max((float(entry.times[-1]) for entry in placed.values()), default=0.0)
        for delay in (*np.arange(0.0, latest, step).tolist(), latest):
            moved = Trajectory(flights[k].times + delay, flights[k].coefficients)
            if all(
                _apart(problem, moved, other, fine, slack)
                for other in placed.values()
                if delay < other.times[-1]
            ):
                placed[k] = moved
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
