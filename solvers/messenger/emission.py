"""Conversion of a chain of poses to a plan, whose primitives end at the encounters."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ...models.messenger.checks import integrated
from ...models.messenger.dubins import WORDS, advance
from ...models.messenger.model import MessengerTour
from ...models.messenger.plan import SIGNS, Primitive, TourPlan
from .chain import DISC, FIXED, RIM, TURNS, leg, where
from .passing import CLOSEST, PIECE, PIECES, passed, trace

__all__ = ["Chain", "cut", "move_to_boundary"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Tolerance of an encounter on the boundary, relative to the radius.
RIM_NEAR = 1e-9
LETTERS = {1: "L", 0: "S", -1: "R"}


class Chain:
    """Arrays of the kernels: stops of a tour with their poses, and data of the vehicles.

    Parameters
    ----------
    problem : MessengerTour
        The model.
    interior : bool
        Whether vehicles may be met inside their discs, or only on the boundaries.
    """

    def __init__(self, problem: MessengerTour, *, interior: bool = True) -> None:
        n = problem.size
        self.problem = problem
        self.nodes: Floats = np.zeros((n + 1, 5))
        self.nodes[:n, :2], self.nodes[:n, 2:4] = problem.positions, problem.velocities
        self.nodes[:n, 4] = problem.radius
        self.poses: Floats = np.zeros((n + 1, 3))
        self.freedom: Ints = np.full(n + 1, DISC if interior else RIM)
        self.order: Ints = np.zeros(n + 1, np.int64)
        self.times: Floats = np.zeros(n + 1)
        self.count = 1
        if problem.start is None:
            # The path begins at the encounter with the first vehicle.
            self.poses[0, 0] = 0.0 if interior else problem.radius[0]
        else:
            self.order[0] = n
            self.nodes[n, :2] = problem.start[:2]
            self.freedom[n] = TURNS if problem.heading is None else FIXED
            self.poses[n, 2] = problem.heading or 0.0

    def copy(self) -> Chain:
        """Return an independent copy of the chain."""
        new = object.__new__(Chain)
        new.__dict__ = {
            name: value.copy() if isinstance(value, np.ndarray) else value
            for name, value in self.__dict__.items()
        }
        return new

    def plan(self) -> TourPlan:
        """Return the tour; a vehicle without a stop is met where the path first comes within its radius."""
        problem, speed, r = self.problem, self.problem.speed, self.problem.turning_radius
        flown, primitives, stops = 0.0, [], {}
        for k in range(self.count + problem.closed):
            if k:
                a, b = int(self.order[k - 1]), int(self.order[k % self.count])
                begin = where(self.nodes[a], self.poses[a], self.times[k - 1])
                t = self.times[k] if k < self.count else 0.0
                end = where(self.nodes[b], self.poses[b], t)
                length = max(speed * (t - self.times[k - 1]), 0.0)  # 0 for the shortest way back
                *lengths, word = leg(*begin, *end, r, length)
                for length, sign in zip(lengths, WORDS[word].tolist(), strict=True):
                    if length > 0.0:
                        towards = math.atan2(end[1] - begin[1], end[0] - begin[0])
                        primitives.append((sign, float(length), towards if r == 0.0 else None))
                        flown += float(length)
            if k < self.count and self.order[k] < problem.size:
                stops[int(self.order[k])] = flown
        start = where(self.nodes[self.order[0]], self.poses[self.order[0]], 0.0)
        pieces = np.empty((PIECES * (problem.size + 2), PIECE))
        size = trace(
            self.order, self.count, problem.closed, self.nodes, self.poses, self.times, speed, r,
            pieces,
        )  # fmt: skip
        legs, hints, gaps = np.empty(CLOSEST, np.int64), np.empty((CLOSEST, 4)), np.empty(CLOSEST)
        for i in range(problem.size):
            if i not in stops:
                passed(self.nodes[i], pieces, size, False, speed, r, legs, hints, gaps)
                stops[i] = float(hints[0, 3]) * speed
                if self.freedom[i] == RIM and problem.radius[i] > 0.0:
                    crossing = cross_boundary(problem, i, pieces[:size], stops[i])
                    stops[i] = stops[i] if crossing is None else crossing
        return cut(problem, start, primitives, stops)


def cross_boundary(problem: MessengerTour, i: int, pieces: Floats, inside: float) -> float | None:
    """Return the length flown at which a path crosses the boundary of a disc, or None.

    Parameters
    ----------
    problem : MessengerTour
        The model.
    i : int
        Index of the vehicle.
    pieces : ndarray, shape (k, 6) or more
        The path, as :func:`.passing.trace` fills it.
    inside : float
        A length flown (m) at which the UAV is in the disc.

    Returns
    -------
    float or None
        Length flown (m) at a crossing close to `inside`; None if all ends of pieces are in the
        disc.
    """
    from scipy.optimize import brentq

    speed, r, radius = problem.speed, problem.turning_radius, float(problem.radius[i])

    def gap(length: float) -> float:
        t = length / speed
        k = max(int(np.searchsorted(pieces[:, 3], t, side="right")) - 1, 0)
        x, y, h, begin, _, sign = pieces[k, :6].tolist()
        x, y, _ = advance(x, y, h, speed * (t - begin), int(sign), r)
        px, py = problem.where(i, t)
        return math.hypot(x - px, y - py) - radius

    depth = gap(inside)
    if abs(depth) <= RIM_NEAR * radius:
        return inside
    last = pieces[-1]
    ends = [*(pieces[:, 3] * speed).tolist(), float(last[3] + last[4]) * speed]
    for length in sorted(ends, key=lambda end: abs(end - inside)):
        if gap(length) >= 0.0:
            low, high = sorted((length, inside))
            return float(brentq(gap, low, high, xtol=1e-15 * max(high, radius)))
    return None


def move_to_boundary(problem: MessengerTour, plan: TourPlan) -> TourPlan | None:
    """Return the same path with encounters on the boundaries; None if this is impossible."""
    poses = integrated(plan, problem.turning_radius)
    flown, pieces = 0.0, []
    for pose, primitive in zip(poses, plan.primitives, strict=False):
        pieces.append(
            [
                *pose,
                flown / problem.speed,
                primitive.length / problem.speed,
                SIGNS[primitive.turn],
                0.0,
            ]
        )
        flown += primitive.length
    if not pieces:
        return plan if all(problem.radius == 0.0) else None
    stops = {}
    for k, i in enumerate(plan.order):
        inside = float(plan.times[k]) * problem.speed
        crossing = (
            cross_boundary(problem, i, np.array(pieces), inside)
            if problem.radius[i] > 0
            else inside
        )
        if crossing is None:
            return None
        stops[i] = crossing
    path = [
        (
            int(SIGNS[primitive.turn]),
            primitive.length,
            primitive.heading if problem.turning_radius == 0 else None,
        )
        for primitive in plan.primitives
    ]
    return cut(problem, tuple(plan.start.tolist()), path, stops)


def cut(
    problem: MessengerTour,
    start: tuple[float, float, float],
    path: Iterable[tuple[int, float, float | None]],
    stops: dict[int, float],
) -> TourPlan:
    """Return the plan of a path, with its primitives cut at the encounters.

    Parameters
    ----------
    problem : MessengerTour
        The model.
    start : tuple of 3 float
        x, y (m), heading (rad).
    path : iterable of (int, float, float)
        Sign of the curvature and length (m) of each primitive, and its heading (rad) if the UAV
        turns on the spot.
    stops : dict of int to float
        Length flown (m) at the encounter with each vehicle. An open tour ends at the last one.

    Returns
    -------
    TourPlan
        The plan.
    """
    r, speed = problem.turning_radius, problem.speed
    order = sorted(stops, key=lambda i: (stops[i], i))
    x, y, h = map(float, start)
    begin = (x, y, h)
    points, primitives, number, flown = [], [], 0, 0.0
    for sign, length, towards in path:
        h = h if towards is None else towards
        # Subtracting from the rest of the primitive avoids the cancellation of differences of
        # `flown`.
        rest, end = length, flown + length
        while number < len(order) and stops[order[number]] < end:
            step = min(max(stops[order[number]] - flown, 0.0), rest)
            if step > 0.0:
                primitives.append(Primitive(number, LETTERS[sign], step, h))
                x, y, h = advance(x, y, h, step, sign, r)
                rest -= step
            flown = max(flown, stops[order[number]])
            points.append((x, y))
            number += 1
        if number == len(order) and not problem.closed:
            break
        if rest > 0.0:
            primitives.append(Primitive(number, LETTERS[sign], rest, h))
            x, y, h = advance(x, y, h, rest, sign, r)
        flown = end
    points += [(x, y)] * (len(order) - len(points))
    times = np.array([min(stops[i], flown) for i in order]) / speed
    return TourPlan(tuple(order), times, np.array(points), np.array(begin), tuple(primitives))
