"""Plans of missions that need no planner: straight from stop to stop, with a rest at each."""

import math

import numpy as np
from fleet_mission.missions import legs

from crosstrack.models.fleet_mission import MissionPlan

#: Largest velocity and acceleration of a leg from 0 to 1 in a unit of time.
PEAKS = 35 / 16, 84 * math.sqrt(5) / 25


def stop_and_go(model, routes, ways=None, starts=None):
    """Return a plan for `routes`, on straight lines or along `ways`, polylines of shape (k, 2).

    Each robot leaves at its time in `starts`, by default at 0.
    """
    trajectories, visits = [], []
    for k, route in enumerate(routes):
        stops = np.concatenate([[model.depot], model.nodes[list(route)], [model.depot]])
        way = np.asarray(stops if ways is None else ways[k], float)
        steps = np.diff(way, axis=0)
        sizes = np.abs(steps)
        long = np.maximum(
            (PEAKS[0] * sizes / model.velocity_limit).max(axis=1),
            np.sqrt((PEAKS[1] * sizes / model.acceleration_limit).max(axis=1)),
        )
        long[long == 0.0] = 1.0
        times = np.concatenate([[0.0], np.cumsum(1.001 * long)])
        times += 0.0 if starts is None else starts[k]
        if not route:
            trajectories.append(None)
            visits.append([])
            continue
        trajectories.append(legs(way, times))
        at = [int(np.hypot(*(way - model.nodes[node]).T).argmin()) for node in route]
        visits.append(times[at])
    return MissionPlan(tuple(map(tuple, routes)), tuple(trajectories), tuple(visits))
