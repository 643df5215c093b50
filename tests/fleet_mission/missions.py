"""Missions and plans for tests: straight legs from rest to rest, which anybody can compute."""

import numpy as np

from crosstrack.models import FleetMission, Trajectory
from crosstrack.models.fleet_mission import MissionPlan

#: From 0 to 1 in a unit of time, with velocity, acceleration and jerk 0 at both ends.
REST = np.array([0.0, 0, 0, 0, 35, -84, 70, -20])
SQUARE = [[4, 4], [6, 4], [6, 6], [4, 6]]


def legs(points, times):
    """Return the straight legs between points, from rest to rest."""
    places = np.asarray(points, float)
    coefficients = REST[None, :, None] * np.diff(places, axis=0)[:, None]
    coefficients[:, 0] = places[:-1]
    return Trajectory(times, coefficients)


def small(**changes):
    """Return a mission of two robots around a square."""
    given = {
        "obstacles": [SQUARE], "bounds": (0, 0, 10, 10), "nodes": [[8, 8], [8, 2], [2, 8]],
        "depot": (1, 1), "vehicles": 2, "cell": 0.5, "radius": 0.25,
    }  # fmt: skip
    return FleetMission(**{**given, **changes})


def flown(*robots, pace=20.0):
    """Return the plan of robots that stop at each ``(node, place)`` and rest between `pace` s long.

    A robot is a list of nodes or of places in between, ``(None, place)``, without the depot.
    """
    routes, trajectories, visits = [], [], []
    for depot, *stops in robots:
        times = pace * np.arange(len(stops) + 2.0)
        trajectories.append(legs([depot, *(place for _, place in stops), depot], times))
        routes.append([node for node, _ in stops if node is not None])
        visits.append(
            [t for t, (node, _) in zip(times[1:], stops, strict=False) if node is not None]
        )
    return MissionPlan(routes, trajectories, visits)


def plain(model):
    """Return a plan for :func:`small` that keeps everything: one robot after the other."""
    a, b, c = model.nodes.tolist()
    home = model.depot.tolist()
    return delayed(flown([home, (1, b), (0, a), (None, b)], [home, (2, c)]), 80.0)


def delayed(plan, seconds):
    """Return the plan with the second robot leaving later."""
    first, second = plan.trajectories
    moved = Trajectory(second.times + seconds, second.coefficients)
    return MissionPlan(plan.routes, (first, moved), (plan.visits[0], plan.visits[1] + seconds))


def box(x, y, right, top):
    """Return a rectangle."""
    return [[x, y], [right, y], [right, top], [x, top]]


def wild():
    """Yield what is changed of :func:`small` for missions that are hard for one reason each, by name."""
    yield (
        "passage as wide as the robot and a cell",
        {
            "obstacles": [box(4, 0, 6, 4.75), box(4, 5.75, 6, 10)],
            "nodes": [[8, 5.25], [9, 9]],
            "depot": (1, 5),
        },
    )
    # The lower half of the passage would be free but for the grid, which lies across it.
    yield (
        "a detour where the passage is off the grid",
        {
            "obstacles": [box(4, 2, 6, 4.6), box(4, 5.6, 6, 10)],
            "nodes": [[8, 5.25], [9, 9]],
            "depot": (1, 5),
        },
    )
    yield (
        "touching and nested",
        {
            "obstacles": [
                box(4, 4, 6, 6),
                box(6, 4, 7, 6),
                box(4.5, 4.5, 5, 5),
                box(5.5, 5.5, 6.5, 7),
            ]
        },
    )
    yield "a depot in a pocket", {
        "obstacles": [box(0.5, 0, 3, 0.5), box(0, 1.75, 6, 2.25), box(0, 0, 0.5, 1.75)],
        "depot": (1.25, 1.1), "cell": 0.25,
    }  # fmt: skip
    yield (
        "nodes at one place, and at the depot",
        {"nodes": [[8, 8], [8, 8], [8, 8], [1, 1], [1, 1]], "vehicles": 3},
    )
    yield "as many robots as nodes", {"vehicles": 3}
    yield (
        "a node far from all others",
        {"bounds": (0, 0, 400, 10), "nodes": [[8, 8], [8, 8.0000001], [399, 5]], "cell": 0.5},
    )
    yield "a free space of one cell", {
        "obstacles": [{"shell": box(-1, -1, 2, 2), "holes": [box(0, 0, 1, 1)]}], "bounds": (-1, -1, 2, 2),
        "nodes": [[0.1, 0.9], [1, 0]], "depot": (0.5, 0.5), "cell": 1.0, "radius": 0.0,
    }  # fmt: skip
    yield (
        "nodes on the edges of cells and at contact",
        {"nodes": [[3.75, 5], [5, 3.75], [6.25, 5]], "cell": 0.25},
    )
    yield "micrometres", {
        "obstacles": [np.array(SQUARE) * 1e-6], "bounds": np.array([0, 0, 1, 1]) * 1e-5,
        "nodes": np.array([[8, 8], [8, 2], [2, 8]]) * 1e-6, "depot": (1e-6, 1e-6), "cell": 5e-7, "radius": 2.5e-7,
    }  # fmt: skip
    yield "thousands of kilometres, far from the origin", {
        "obstacles": [np.array(SQUARE) * 1e6 + 1e8], "bounds": np.array([0, 0, 1, 1]) * 1e7 + 1e8,
        "nodes": np.array([[8, 8], [8, 2], [2, 8]]) * 1e6 + 1e8, "depot": (1.01e8, 1.01e8), "cell": 5e5,
        "radius": 2.5e5, "velocity_limit": 1e3,
    }  # fmt: skip
    yield (
        "slow on one axis, and hard to push",
        {"velocity_limit": [1e-3, 1e3], "acceleration_limit": [1e3, 1e-3], "separation": 0.0},
    )
    yield "no obstacle at all", {"obstacles": [], "radius": 0.0}
    yield (
        "robots that must keep apart",
        {"vehicles": 3, "nodes": [[8, 8], [8, 7], [7, 8], [8, 2]], "separation": 1.0},
    )
    yield "robots that must keep apart on the way out", {"separation": 0.4}
