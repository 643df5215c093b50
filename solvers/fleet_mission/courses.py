"""Courses of robots: whole flights, flights in lanes, and flights with rests at which a robot may wait."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ...models.fleet_mission.model import FleetMission
from ...models.minimum_snap.trajectory import Trajectory
from .corridor import Corridor
from .flight import Flight

__all__ = ["Course", "Leg", "courses_with_rests", "whole_courses"]

Floats = NDArray[np.float64]
Fly = Callable[[Corridor], Flight]

#: Factors of the durations of whole flights.
SLOWER = (1.0, 1.12, 1.3)
#: Points of a corridor's segment that may be chosen for a rest.
POINTS = 6
#: Distance of a place of rest from the ways of other robots, as a multiple of the separation.
CLEAR = 1.1


class Leg(NamedTuple):
    """Curve (m) from rest to rest between the places `begin` and `end` of a course, from time 0.

    `visits`, shape (nodes,), are the times at which nodes are passed, s.
    """

    begin: int
    end: int
    curve: Trajectory
    visits: Floats

    def slower(self, factor: float) -> Leg:
        """Return the leg with all times multiplied by `factor`."""
        curve = Trajectory(self.curve.times * factor, self.curve.coefficients)
        return self._replace(curve=curve, visits=self.visits * factor)


class Course(NamedTuple):
    """Places at which a robot may rest, shape (n, 2), m, from the depot to the depot, and legs between them.

    A robot takes no room at the depot. At least one leg leads from the first to the last place.
    """

    places: Floats
    legs: tuple[Leg, ...]

    def alone(self, durations: Sequence[float]) -> float:
        """Return the time that a robot needs without others, given the duration of each leg."""
        least = [0.0, *[np.inf] * (len(self.places) - 1)]
        for leg, duration in sorted(
            zip(self.legs, durations, strict=True), key=lambda k: k[0].begin
        ):
            least[leg.end] = min(least[leg.end], least[leg.begin] + duration)
        return least[-1]


def whole_courses(problem: FleetMission, flights: Sequence[Flight]) -> list[Course]:
    """Return courses without rests, at several speeds, one per flight."""
    home = np.stack([problem.depot, problem.depot])
    whole = [
        Leg(0, 1, entry.trajectory, entry.trajectory.times[entry.stops[1:-1]]) for entry in flights
    ]
    return [Course(home, tuple(leg.slower(factor) for factor in SLOWER)) for leg in whole]


def courses_with_rests(
    problem: FleetMission, direct: Sequence[Course], ways: Sequence[Corridor], fly: Fly
) -> Iterator[Course]:
    """Yield a course per robot, with flights through other corridors and up to two places of rest.

    `direct` are the courses without rests, and `ways` the corridors of the further flights. `fly` returns the
    flight through a corridor, from rest to rest.
    """
    lines = [_points_along(way)[1] for way in ways]
    for robot, (course, way) in enumerate(zip(direct, ways, strict=True)):
        if not len(way.lower):  # all nodes are at the depot
            yield course
            continue
        others = [line for row, line in enumerate(lines) if row != robot]
        stops = [0.0, *_rests(problem, way, others), float(len(way.lower))]
        last = len(stops) - 1
        legs = [leg._replace(end=last) for leg in course.legs]
        for begin in range(last):
            for end in range(begin + 1, last + 1):
                leg = _leg(way, stops, begin, end, fly)
                factors = SLOWER if end - begin == last else SLOWER[:1]
                legs += [leg.slower(factor) for factor in factors]
        yield Course(np.array([_place(way, stop) for stop in stops]), tuple(legs))


def _points_along(way: Corridor) -> tuple[Floats, Floats]:
    """Return positions along a polyline, in segments, and their coordinates, m."""
    at = np.arange(len(way.lower) * POINTS + 1.0) / POINTS
    return at, np.array([_place(way, entry) for entry in at])


def _place(way: Corridor, at: float) -> Floats:
    """Return the point of a corridor's polyline at a position, counted in segments, m."""
    if not len(way.lower):  # the robot stays at the depot
        return np.asarray(way.knots[0])
    row = min(int(at), len(way.knots) - 2)
    share = at - row
    place: Floats = np.asarray((1.0 - share) * way.knots[row] + share * way.knots[row + 1])
    for box in {row, max(int(np.ceil(at)) - 1, 0)}:  # rounding may move it beyond an edge
        place = np.clip(place, way.lower[box], way.upper[box])
    return place


def _rests(problem: FleetMission, way: Corridor, others: Sequence[Floats]) -> list[float]:
    """Return the first and the last position at which a resting robot is clear of the other ways."""
    at, points = _points_along(way)
    needed = CLEAR * problem.separation
    clear = np.hypot(*(points - problem.depot).T) > needed
    if others:
        clear &= cKDTree(np.concatenate(others)).query(points)[0] > needed
    inner = at[clear & (at > 0) & (at < at[-1])]
    if not inner.size:
        inner = at[np.isin(at, way.stops[1:-1])]
    return sorted({float(entry) for entry in (*inner[:1], *inner[-1:])} - {0.0, float(at[-1])})


def _leg(way: Corridor, stops: Sequence[float], begin: int, end: int, fly: Fly) -> Leg:
    """Return the flight between two positions of a corridor, from rest to rest."""
    low, high = stops[begin], stops[end]
    first, last = int(low), int(np.ceil(high)) - 1
    knots = np.array([_place(way, low), *way.knots[first + 1 : last + 1], _place(way, high)])
    nodes = way.stops[1:-1]
    nodes = nodes[((nodes > low) | (begin == 0)) & (nodes <= high)]
    # A node at a place of rest belongs to the leg that ends there.
    rows = np.where(nodes == high, last - first + 1, nodes - first)
    # Nodes may share a knot, and both ends are stops of this leg.
    part = Corridor(
        way.lower[first : last + 1], way.upper[first : last + 1], knots,
        np.array([0, *rows, len(knots) - 1]),
    )  # fmt: skip
    flight = fly(part)
    return Leg(begin, end, flight.trajectory, flight.trajectory.times[flight.stops[1:-1]])
