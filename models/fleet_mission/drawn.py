"""The plain data of a mission's picture: curves, what happens over time, and what is broken."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..minimum_snap import Trajectory
from ..verification import Check, Verification
from .model import FleetMission
from .plan import MissionPlan

__all__ = ["FAR", "apart_of", "broken_places", "missed_nodes", "owners_of", "sampled", "stops_of"]

Floats = NDArray[np.float64]

#: Farther away nothing is drawn: an invalid plan may lead anywhere (m).
FAR = 1e100
#: Instants of each segment at the least, and of a curve in all about.
_FEWEST, _POINTS = 9, 1500
#: How a check says which robots it means, and when.
_WHO = re.compile(r"robots? (\d+)(?: and (\d+))?")
_WHEN = re.compile(r"\(t = (\S+) s\)")


def sampled(trajectory: Trajectory | None) -> Floats:
    """Return instants that show a curve as it is, s, its knots among them."""
    if trajectory is None:
        return np.empty(0)
    each = max(_FEWEST, _POINTS // trajectory.segments)
    shares = np.linspace(0.0, 1.0, each, endpoint=False)
    inner = trajectory.times[:-1, None] + shares * trajectory.durations[:, None]
    return np.append(inner.ravel(), trajectory.times[-1])


def stops_of(model: FleetMission, plan: MissionPlan) -> list[Floats]:
    """Return the places of every route, the depot at both ends, m, each of shape (k, 2)."""
    home = model.depot[None]
    nodes = (model.nodes[list(route)].reshape(-1, 2) for route in plan.routes)
    return [np.concatenate([home, some, home]) if len(some) else some for some in nodes]


def owners_of(model: FleetMission, plan: MissionPlan) -> NDArray[np.int64]:
    """Return the robot that visits each node, -1 for none."""
    owners = np.full(len(model.nodes), -1)
    for k, route in enumerate(plan.routes):
        owners[list(route)] = k
    return owners


def missed_nodes(model: FleetMission, plan: MissionPlan) -> Floats:
    """Return the places of nodes that are in no route, or in several."""
    listed = np.array([node for route in plan.routes for node in route], int)
    return np.asarray(model.nodes[np.bincount(listed, minlength=len(model.nodes)) != 1])


def apart_of(model: FleetMission, plan: MissionPlan, times: Floats) -> Floats:
    """Return the least distance of two robots at each of `times`, m.

    Robots that are not under way do not count; NaN if less than two are.
    """
    places = np.full((len(plan.trajectories), len(times), 2), np.nan)
    for k, one in enumerate(plan.trajectories):
        if one is not None:
            under_way = (times >= one.times[0]) & (times <= one.times[-1])
            places[k, under_way] = one(times[under_way])
    least = np.full(len(times), np.inf)
    for k in range(len(places) - 1):
        apart = np.hypot(*np.moveaxis(places[k + 1 :] - places[k], -1, 0))
        least = np.minimum(least, np.where(np.isnan(apart), np.inf, apart).min(axis=0))
    # Where one more or one less counts, the least distance jumps: no line leads there.
    counted = np.isfinite(places[..., 0]).sum(axis=0)
    least[1:][np.diff(counted) != 0] = np.inf
    return np.where(np.isfinite(least), least, np.nan)


def broken_places(plan: MissionPlan, found: Verification) -> Floats:
    """Return where robots are when they break a rule the most, m, shape (k, 2)."""
    places = [place for check in found.violated for place in _places_of(plan, check)]
    broken = np.array(places).reshape(-1, 2)
    return broken[(np.abs(broken) < FAR).all(axis=1)]


def _places_of(plan: MissionPlan, check: Check) -> Iterator[Floats]:
    """Yield where the robots are that a check names, at the time that it names, or at their ends."""
    who, when = _WHO.search(check.where), _WHEN.search(check.where)
    for robot in map(int, filter(None, who.groups() if who else ())):
        one = plan.trajectories[robot] if robot < len(plan.trajectories) else None
        if one is None:
            continue
        if when is not None:
            yield one(np.clip(float(when[1]), one.times[0], one.times[-1]))
        elif check.where.endswith((", start", ", end")):
            yield one(one.times[0 if check.where.endswith("start") else -1])
