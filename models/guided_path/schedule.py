"""Positions, times and loads of the vehicles along a plan, computed from the raw data.

Several vehicles on a line cannot pass one another. A stop of one vehicle pushes each vehicle in its way to the
same place. These moves are the shortest ones: at each stop, every vehicle must be in an interval, and on a
line the shortest path through a sequence of intervals moves to the nearest point of each.

Times are the earliest ones for the order of the plan. If vehicle a is left of vehicle b, a stop of a at x and a
later one of b at y < x need (x - y) / speed seconds between them. Conversely, trajectories that keep the order
exist if all pairs of stops are so far apart in time: move vehicle a along the largest of all lines
x - speed · abs(t - t') over the stops (t', x) of a and of the vehicles left of it. This function is as fast as
the vehicle, increases with a, and passes the stops of a.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .data import GuidedPathData
from .plan import GuidedPathPlan
from .track import Track

__all__ = ["Walk", "labels_of", "time_scales", "walk_of"]

Floats = NDArray[np.float64]


class Walk(NamedTuple):
    """Stops of a plan in order, with the start at both ends; arrays have one row per stop.

    If the end is free, the last row is the place of the last customer.

    Parameters
    ----------
    stops : list of int
        Numbers of the stops.
    vehicles : list of int
        Vehicle at each stop; 0 at both ends, for the load, too.
    places : ndarray, shape (stops,)
        Positions in m: the coordinate on a line, continued beyond the ends of a loop, the distance from node
        0 in a tree.
    walked : ndarray, shape (stops,)
        Length travelled so far by all vehicles, in m.
    positions : ndarray, shape (stops, vehicles)
        Position of each vehicle, in m.
    begin : ndarray, shape (stops,)
        Begin of the service at the stop, in s; at the end the time of return. NaN without a speed.
    load : ndarray, shape (stops,)
        Load of the vehicle after the stop; NaN without loads.
    """

    stops: list[int]
    vehicles: list[int]
    places: Floats
    walked: Floats
    positions: Floats
    begin: Floats
    load: Floats


def walk_of(model: GuidedPathData, plan: GuidedPathPlan) -> Walk:
    """Return the stops of a plan, which must contain only customers and vehicles of the model."""
    order = [0, *plan.order, 0]
    vehicles = [0, *(plan.vehicles or [0] * len(plan.order)), 0]
    places, positions, moved = _move(model, order, vehicles)
    load = np.full(len(order), math.nan)
    if model.loads is not None:
        for k in range(positions.shape[1]):
            rows = [row for row in range(1, len(order) - 1) if vehicles[row] == k]
            load[rows] = model.loads[0] + np.cumsum(model.loads[[order[row] for row in rows]])
        load[0] = model.loads[0]
        load[-1] = load[max(row for row in range(len(order) - 1) if vehicles[row] == 0)]
    begin = _times(model, order, vehicles, moved, places)
    return Walk(order, vehicles, places, np.cumsum(moved), positions, begin, load)


def time_scales(windows: Floats) -> tuple[Floats, Floats]:
    """Return the scale of each latest time, and the rounding of a sum of times up to it, in s.

    The scale is the time from the departure, so a shift of all times does not change what is accepted.
    """
    departure, latest = windows[0, 0], windows[:, 1]
    since, most = np.abs(latest - departure), np.maximum(np.abs(latest), abs(departure))
    since, most = (np.where(since < np.inf, values, 0.0) for values in (since, most))
    return since, len(windows) * np.spacing(most)


def labels_of(model: GuidedPathData, walk: Walk) -> list[str]:
    """Return the names of the stops; the last one is ``end`` unless the tour ends at its start."""
    names = [model.label(stop) for stop in walk.stops]
    return names if model.end is None else [*names[:-1], "end"]


def _move(
    model: GuidedPathData, order: Sequence[int], vehicles: Sequence[int]
) -> tuple[Floats, Floats, Floats]:
    """Return places, positions of all vehicles, and length travelled to each stop."""
    x, track, rows = model.coordinates.tolist(), model.track, len(order)
    starts = x[:1] if model.vehicles is None else model.vehicles.tolist()
    homes = [model.end] if isinstance(model.end, float) else starts
    places, moved, positions = np.zeros(rows), np.zeros(rows), np.zeros((rows, len(starts)))
    at = starts
    places[0] = positions[0, 0] = model.positions[0]
    positions[0, 1:] = at[1:]
    for row in range(1, rows):
        last, stop, k = row == rows - 1, order[row], vehicles[row]
        there = homes[0] if last else x[stop]
        if last and model.end == "free":
            places[row], positions[row] = places[row - 1], positions[row - 1]
        elif isinstance(track, Track):
            here = x[order[row - 1]]
            moved[row] = track.between(order[row - 1], here, stop, there)
            places[row] = model.positions[stop]
            if track.loop:
                forward = (there - here) % track.loop <= track.loop / 2
                places[row] = places[row - 1] + (moved[row] if forward else -moved[row])
            positions[row] = places[row]
        else:
            goals = homes if last else [
                there if b == k else min(y, there) if b < k else max(y, there)
                for b, y in enumerate(at)
            ]  # fmt: skip
            moved[row] = sum(abs(goal - y) for goal, y in zip(goals, at, strict=True))
            at, places[row], positions[row] = goals, there, goals
    return places, positions, moved


def _times(
    model: GuidedPathData, order: Sequence[int], vehicles: Sequence[int], moved: Floats,
    places: Floats,
) -> Floats:  # fmt: skip
    """Return the earliest begin of each service for the order of the plan, in s; NaN without a speed."""
    rows, speed, starts = len(order), model.speed, model.vehicles
    if speed is None:
        return np.full(rows, math.nan)
    opens = np.zeros(model.size) if model.windows is None else model.windows[:, 0]
    takes = np.zeros(model.size) if model.service is None else model.service
    begin, leave, numbers = np.zeros(rows), np.zeros(rows), np.array(vehicles)
    begin[0] = opens[0]
    leave[0] = begin[0] + takes[0]
    first = {stop: row for row, stop in reversed(list(enumerate(order))) if row < rows - 1}
    for row in range(1, rows):
        stop, last = order[row], row == rows - 1
        if starts is None:
            begin[row] = leave[row - 1] + moved[row] / speed
        elif last and model.end == "free":
            begin[row] = leave[:-1].max()
        else:
            # All vehicles are at their starts until the departure.
            begin[row] = leave[0]
            for k, goal in enumerate(starts) if last else [(vehicles[row], places[row])]:
                origins = np.concatenate([starts, places[1:row]])
                others = np.concatenate([np.arange(len(starts)), numbers[1:row]])
                since = np.concatenate([np.full(len(starts), leave[0]), leave[1:row]])
                # A vehicle to the left makes room only for stops to the left of its own, and vice versa.
                apart = np.where(others < k, origins - goal, goal - origins)
                apart[others == k] = np.abs(apart[others == k])
                bound = (apart > 0) | (others == k)
                begin[row] = np.max(since[bound] + apart[bound] / speed, initial=begin[row])
            pairs = [first[a] for a in model.before[stop] if first.get(a, rows) < row]
            begin[row] = np.max(leave[pairs], initial=begin[row])
        if not last:
            begin[row] = max(begin[row], opens[stop])
            leave[row] = begin[row] + takes[stop]
    return begin
