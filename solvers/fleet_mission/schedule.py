"""Schedules of robots along given curves: departures, slower flights and waits at places of rest.

Each robot has places at which it may rest and legs between them. On a grid of time, the legs of two robots
collide for a fixed set of differences of their departures, which is computed once. One robot after another gets
the schedule with the earliest return that avoids the previous ones, by safe intervals (Phillips and
Likhachev, SIPP, ICRA 2011): a place is safe in intervals of time, and a leg connects two of them. Changes of
the order are kept unless the last robot returns later.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ...models.fleet_mission.curves import nearest
from ...models.fleet_mission.model import FleetMission
from ...models.minimum_snap.trajectory import Trajectory
from .courses import Course

__all__ = ["Timed", "is_clear", "schedule"]

Floats = NDArray[np.float64]
Steps = NDArray[np.int64]
Flags = NDArray[np.bool_]

#: Steps of time per passage of the separation at top speed, and maximum number of steps per leg.
FINE, MOST = 4, 3000
#: Maximum number of steps of the motion of obstacles that is considered, and of pairs of samples in memory.
LATEST, PAIRS = 50_000, 4_000_000
#: Maximum number of changes of the order, and of schedules that are computed for them.
ROUNDS, PLACED = 120, 2400
#: Factors on the distance of samples; the next one is used if the proof fails.
FACTORS = (1.0, 1.03, 1.1)


class Timed(NamedTuple):
    """Trajectory of a robot and the times at which it passes its nodes, s."""

    trajectory: Trajectory
    visits: Floats


class _Stay(NamedTuple):
    """Use of a leg from a step, or a stay at a place from a step to another one (inclusive)."""

    row: int
    begin: int
    end: int
    moves: bool


class _Grid:
    """Legs, places and moving obstacles on a grid of time."""

    def __init__(self, problem: FleetMission, courses: Sequence[Course], factor: float) -> None:
        self.problem, self.courses, self.factor = problem, courses, factor
        self.robots = len(courses)
        #: Movers follow the robots: they have one leg and two places.
        self.top = [float(np.hypot(*problem.velocity_limit))] * self.robots
        self.top += [_top_speed(item.trajectory) for item in problem.moving]
        room = problem.separation
        if problem.moving:
            least = min(item.radius for item in problem.moving) + problem.radius
            room = min(room, least) if room > 0 else least
        longest = max(course.legs[0].curve.duration for course in courses)
        self.step = max(room / (FINE * self.top[0]), longest / MOST)
        curves = [[leg.curve for leg in course.legs] for course in courses]
        self.samples = [[self._sampled(curve) for curve in entry] for entry in curves]
        for item in problem.moving:
            steps = int(min(np.ceil(max(float(item.times[-1]), 0.0) / self.step), LATEST))
            self.samples.append([item(self.step * np.arange(steps + 1))])
        long = [len(entry[0]) for entry in self.samples]
        self.horizon = sum(long[: self.robots]) + max(long[self.robots :], default=1) - 1
        self.places = [course.places for course in courses]
        self.places += [entry[0][[0, -1]] for entry in self.samples[self.robots :]]
        self.movers = {
            row: [_Stay(0, 0, long[row], True), _Stay(1, long[row] - 1, self.horizon, False)]
            for row in range(self.robots, len(long))
        }
        self.trees: list[list[Any]] = [[cKDTree(part) for part in entry] for entry in self.samples]
        self._clashes: dict[tuple[int, ...], Steps] = {}
        self._passes: dict[tuple[int, ...], Steps] = {}

    def _sampled(self, curve: Trajectory) -> Floats:
        count = int(np.ceil(curve.duration / self.step * (1 - 1e-12)))
        return curve(curve.times[0] + np.minimum(self.step * np.arange(count + 1), curve.duration))

    def reach(self, one: int, other: int) -> float:
        """Return the distance of samples below which two robots may collide between samples, m."""
        needed = self.problem.separation
        for row in (one, other):
            if row >= self.robots:
                needed = self.problem.radius + self.problem.moving[row - self.robots].radius
        if needed == 0.0:
            return 0.0
        return self.factor * float(
            np.hypot(needed, 0.5 * self.step * (self.top[one] + self.top[other]))
        )

    def clashes(self, one: int, leg: int, other: int, second: int) -> Steps:
        """Return the differences of departures, first minus second, at which two legs collide."""
        key = (one, leg, other, second)
        if key not in self._clashes:
            tree, samples = self.trees[other][second], self.samples[one][leg]
            # Flags are faster than a sort of all differences.
            flags = np.zeros(len(samples) + tree.n, bool)
            rows = max(1, PAIRS // tree.n)
            for begin in range(0, len(samples), rows):
                part = cKDTree(samples[begin : begin + rows])
                pairs = part.sparse_distance_matrix(
                    tree, self.reach(one, other), output_type="ndarray"
                )
                flags[pairs["j"] - pairs["i"] - begin + len(samples)] = True
            result = np.flatnonzero(flags) - len(samples)
            self._clashes[key] = result
            self._clashes[other, second, one, leg] = -result[::-1]
        return self._clashes[key]

    def passes(self, one: int, leg: int, other: int, place: int) -> Steps:
        """Return the steps of a leg that are too close to a place of another robot."""
        key = (one, leg, other, place)
        if key not in self._passes:
            away = self.samples[one][leg] - self.places[other][place]
            close = np.hypot(*away.T) < self.reach(one, other)
            self._passes[key] = np.flatnonzero(close)
        return self._passes[key]

    def add(
        self, robot: int, other: int, stay: _Stay, forbidden: list[Flags], taken: list[Flags]
    ) -> None:
        """Mark the departures of legs and the stays at places that collide with another robot."""
        if self.reach(robot, other) == 0.0:
            return
        size = self.horizon + 1
        for leg, flags in enumerate(forbidden):
            if stay.moves:
                hits = stay.begin + self.clashes(robot, leg, other, stay.row)
                flags[hits[(hits >= 0) & (hits < size)]] = True
                continue
            steps = self.passes(robot, leg, other, stay.row)
            if steps.size:
                change = np.zeros(size + 1, np.int64)
                np.add.at(change, np.clip(stay.begin - steps, 0, size), 1)
                np.add.at(change, np.clip(stay.end - steps + 1, 0, size), -1)
                flags |= np.cumsum(change)[:size] > 0
        for place, flags in enumerate(taken):
            if stay.moves:
                hits = stay.begin + self.passes(other, stay.row, robot, place)
                flags[hits[hits < size]] = True
            else:
                away = self.places[robot][place] - self.places[other][stay.row]
                if np.hypot(*away) < self.reach(robot, other):
                    flags[stay.begin : stay.end + 1] = True

    def fastest(self, robot: int, others: dict[int, list[_Stay]]) -> list[_Stay] | None:
        """Return the schedule of a robot with the earliest return, given those of others."""
        course, size = self.courses[robot], self.horizon + 1
        forbidden = [np.zeros(size, bool) for _ in course.legs]
        taken = [np.zeros(size, bool) for _ in course.places]
        for other, stays in (*self.movers.items(), *others.items()):
            for stay in stays:
                self.add(robot, other, stay, forbidden, taken)
        final = len(course.places) - 1
        arrivals = [np.zeros(size, bool) for _ in course.places]
        latest: list[Steps] = [np.arange(size)] * (final + 1)
        ready = [np.ones(size, bool)] * (final + 1)
        long = [len(part) - 1 for part in self.samples[robot]]
        for place in range(final):
            if place:
                # A stay lasts from the latest arrival until the place is taken.
                latest[place] = _latest(arrivals[place] & ~taken[place])
                ready[place] = latest[place] > _latest(taken[place])
            for row, leg in enumerate(course.legs):
                if leg.begin == place and long[row] < size:
                    departs = ready[place][: size - long[row]] & ~forbidden[row][: size - long[row]]
                    arrivals[leg.end][long[row] :] |= departs
        if not arrivals[final].any():
            return None
        place, time = final, int(np.argmax(arrivals[final]))
        result: list[_Stay] = []
        while place:
            for row, leg in enumerate(course.legs):
                start = time - long[row]
                if (
                    leg.end == place
                    and start >= 0
                    and ready[leg.begin][start]
                    and not forbidden[row][start]
                ):
                    break
            result.insert(0, _Stay(row, start, time, True))
            place, time = leg.begin, start
            if place:
                time = int(latest[place][start])
                result.insert(0, _Stay(place, time, start, False))
        return result

    def timed(self, robot: int, stays: list[_Stay]) -> Timed:
        """Return the trajectory of a schedule."""
        legs = self.courses[robot].legs
        degree = max(legs[stay.row].curve.degree for stay in stays if stay.moves)
        times: list[Floats] = []
        parts: list[Floats] = []
        visits: list[Floats] = []
        for stay in stays:
            if not stay.moves:
                continue
            leg, begin = legs[stay.row], stay.begin * self.step
            if times:
                gap = begin - times[-1][-1]
                if gap > 1e-6 * leg.curve.duration:
                    still = np.zeros((1, degree + 1, 2))
                    still[0, 0] = leg.curve.coefficients[0, 0]
                    times.append(np.array([begin]))
                    parts.append(still)
                else:
                    begin = float(times[-1][-1])
            padded = np.zeros((leg.curve.segments, degree + 1, 2))
            padded[:, : leg.curve.degree + 1] = leg.curve.coefficients
            times.append(begin + leg.curve.times[bool(times) :])
            parts.append(padded)
            visits.append(begin + leg.visits)
        return Timed(
            Trajectory(np.concatenate(times), np.concatenate(parts)), np.concatenate(visits)
        )


def _top_speed(curve: Trajectory) -> float:
    """Return an upper bound on the speed, m/s."""
    extremes = curve.extremes(1)
    return float(np.linalg.norm(np.maximum(-extremes.least, extremes.largest), axis=1).max())


def _latest(flags: Flags) -> Steps:
    """Return the last step with a flag up to each step, or -1."""
    return np.maximum.accumulate(np.where(flags, np.arange(flags.size), -1))


def _ordered(
    grid: _Grid,
    order: list[int],
    limit: int,
    known: dict[int, list[_Stay]],
    stopped: Callable[[], object],
) -> dict[int, list[_Stay]] | None:
    """Return the schedules of all robots in an order, or None if one returns at `limit` or later.

    `known` contains the schedules of the first robots of the order.
    """
    result = dict(known)
    for robot in order[len(known) :]:
        if stopped():
            return None
        stays = grid.fastest(robot, result)
        if stays is None or stays[-1].end >= limit:
            return None
        result[robot] = stays
    return result


def schedule(
    problem: FleetMission,
    courses: Sequence[Course],
    seed: int,
    slack: float,
    stopped: Callable[[], object],
) -> list[Timed] | None:
    """Return trajectories that keep robots and moving obstacles apart, with an early last return.

    There is one course per robot. `seed` is that of the changes of the order, `slack` the accuracy of the least
    distances in the proof (m), and the search ends once `stopped` returns true. None if no schedule was found
    or if its separation is not proven.
    """
    for factor in FACTORS:
        grid = _Grid(problem, courses, factor)
        stays = _improved(grid, np.random.default_rng(seed), stopped)
        if stays is None:
            return None
        result = [grid.timed(robot, stays[robot]) for robot in range(grid.robots)]
        if is_separated(problem, [entry.trajectory for entry in result], slack):
            return result
    return None


def _improved(
    grid: _Grid, draw: np.random.Generator, stopped: Callable[[], object]
) -> dict[int, list[_Stay]] | None:
    """Return the best schedules of several orders of the robots."""
    steps = [[len(part) - 1.0 for part in entry] for entry in grid.samples[: grid.robots]]
    alone = [course.alone(long) for course, long in zip(grid.courses, steps, strict=True)]
    # The longest flight first, as the shorter ones are easier to fit in.
    order = sorted(range(grid.robots), key=lambda k: -len(grid.samples[k][0]))
    best = _ordered(grid, order, grid.horizon + 1, {}, stopped)
    if best is None:
        return None
    for _ in range(min(ROUNDS, PLACED // grid.robots)):
        returns = [best[k][-1].end for k in range(grid.robots)]
        last = max(returns)
        if last <= max(alone):
            break
        # A robot with a late return moves ahead; the last one is the most likely to be drawn.
        late = sorted(range(grid.robots), key=lambda k: -returns[k])
        robot = late[min(int(draw.exponential(1.5)), grid.robots - 1)]
        at = order.index(robot)
        to = int(draw.integers(0, at)) if at else int(draw.integers(grid.robots))
        changed = [k for k in order if k != robot]
        changed.insert(to, robot)
        same = next((i for i, (a, b) in enumerate(zip(order, changed, strict=True)) if a != b), 0)
        known = {k: best[k] for k in changed[:same]}
        result = _ordered(grid, changed, last + 1, known, stopped)
        if result is not None:
            order, best = changed, result
        if stopped():
            break
    return best


def is_separated(problem: FleetMission, flights: list[Trajectory], slack: float) -> bool:
    """Return whether robots keep their distances from each other and from moving obstacles, proven."""
    if problem.separation > 0 and nearest(flights, slack).distance < problem.separation:
        return False
    return is_clear(problem, flights, slack)


def is_clear(problem: FleetMission, flights: list[Trajectory], slack: float) -> bool:
    """Return whether robots keep their distance from moving obstacles, proven."""
    end = max(entry.times[-1] for entry in flights)
    pairs = np.array([[0, row] for row in range(1, len(flights) + 1)])
    return all(
        nearest([item.during(0.0, end), *flights], slack, pairs).distance
        >= problem.radius + item.radius
        for item in problem.moving
    )
