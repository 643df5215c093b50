"""When each robot leaves the depot, so that no two come too near to one another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...models.fleet_mission.curves import nearest
from ...models.fleet_mission.model import FleetMission
from ...models.minimum_snap.trajectory import Trajectory

__all__ = ["departures"]

#: Departures that are tried for a robot, between at once and after all others are back.
TRIED = 200


def departures(
    problem: FleetMission, flights: Sequence[Trajectory], slack: float
) -> list[Trajectory]:
    """Return the trajectories with departures that keep the robots apart.

    One after another, each robot leaves as early as those before it allow. It may always leave after
    all of them are back, as they wait in the depot's queue then.

    Parameters
    ----------
    problem : FleetMission
        Says how far apart.
    flights : sequence of Trajectory
        From time 0, one a robot.
    slack : float
        By how much the least distance may be misjudged, m.
    """
    if problem.separation == 0.0 or len(flights) < 2:
        return list(flights)
    # The longest way first: the others find room beside it.
    order = sorted(range(len(flights)), key=lambda k: -flights[k].duration)
    step = sum(one.duration for one in flights) / TRIED
    fine = step / max(1, int(np.ceil(step / max(flights[order[-1]].duration / 200, 1e-12))))
    placed: dict[int, Trajectory] = {}
    for k in order:
        latest = max((float(one.times[-1]) for one in placed.values()), default=0.0)
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
    """Return whether two robots keep their distance: at samples, and then for certain."""
    begin, end = max(one.times[0], other.times[0]), min(one.times[-1], other.times[-1])
    times = np.arange(begin, end, step)
    if times.size and (np.hypot(*(one(times) - other(times)).T) < problem.separation).any():
        return False
    return bool(nearest([one, other], slack).distance >= problem.separation)
