"""Conversion of a chain of poses to a plan, whose primitives end at the encounters."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray

from ...models.messenger.dubins import WORDS, advance
from ...models.messenger.model import MessengerTour
from ...models.messenger.plan import SIGNS, Primitive, TourPlan
from ...models.messenger.sampling import outline, track
from .chain import DISC, FIXED, RIM, TURNS, Scene, Stops, confine, end_time, leg, where
from .passing import CLOSEST, GAP, PIECE, PIECES, TIME, passes, trace

__all__ = ["Chain", "cut", "move_to_boundary", "safe_radius"]

Floats = NDArray[np.float64]

#: Tolerance of an encounter on the boundary, relative to the radius.
RIM_NEAR = 1e-9
#: Margin of the radius against rounding, as a share.
MARGIN = 1e-9


def safe_radius(problem: MessengerTour, margin: float = MARGIN) -> Floats:
    """Return the radii (m), smaller by a share against rounding; the full one if the start is in the disc."""
    if problem.start is None:
        return problem.radius * (1.0 - margin)
    apart = np.hypot(*(problem.positions - problem.start[:2]).T)
    return problem.radius * np.where(apart <= problem.radius, 1.0, 1.0 - margin)


class Chain:
    """Arguments of the kernels: stops of a tour with their poses, and data of the vehicles.

    If `interior`, vehicles may be met inside their discs, otherwise only on the boundaries.
    """

    def __init__(self, problem: MessengerTour, *, interior: bool = True) -> None:
        n = problem.size
        self.problem, self.interior = problem, interior
        nodes, freedom = np.zeros((n + 1, 5)), np.full(n + 1, DISC if interior else RIM)
        nodes[:n, :2], nodes[:n, 2:4] = problem.positions, problem.velocities
        nodes[:n, 4] = safe_radius(problem) if interior else problem.radius
        self.scene = Scene(nodes, freedom, problem.closed, problem.speed, problem.turning_radius)
        self.stops = Stops(np.zeros(n + 1, np.int64), np.zeros(n + 1), np.zeros((n + 1, 3)))
        self.count = 1
        if problem.start is None:
            # The path begins at the encounter with the first vehicle.
            self.stops.poses[0, 0] = 0.0 if interior else problem.radius[0]
        else:
            self.stops.order[0] = n
            nodes[n, :2], nodes[n, 2:4] = problem.start[:2], problem.home_drift
            freedom[n] = TURNS if problem.heading is None else FIXED
            self.stops.poses[n, 2] = problem.heading or 0.0

    def copy(self) -> Chain:
        """Return an independent copy of the chain."""
        new = copy(self)
        order, times, poses = self.stops
        new.stops = Stops(order.copy(), times.copy(), poses.copy())
        return new

    def append(self, vehicle: int, offset: Floats, heading: float) -> None:
        """Add a stop, with its offset moved into the disc, or onto its boundary."""
        self.stops.order[self.count] = vehicle
        self.stops.poses[vehicle] = *offset, heading
        radius, freedom = self.scene.nodes[vehicle, 4], int(self.scene.freedom[vehicle])
        confine(self.stops.poses[vehicle], float(radius), freedom)
        self.count += 1

    def plan(self) -> TourPlan:
        """Return the tour; a vehicle without a stop is met where the path first comes within its radius."""
        problem, speed, r = self.problem, self.problem.speed, self.problem.turning_radius
        order, times, poses = self.stops
        nodes = self.scene.nodes
        flown, primitives, met = 0.0, [], {}
        home = end_time(self.stops, self.count, self.scene)
        for k in range(self.count + problem.closed):
            if k:
                a, b = int(order[k - 1]), int(order[k % self.count])
                begin = where(nodes[a], poses[a], times[k - 1])
                until = float(times[k]) if k < self.count else home
                end = where(nodes[b], poses[b], until)
                # A length of 0 selects the shortest path back.
                length = speed * (until - times[k - 1]) if until > 0.0 else 0.0
                *lengths, word = leg(*begin, *end, r, length)
                for length, sign in zip(lengths, WORDS[word].tolist(), strict=True):
                    if length > 0.0:
                        towards = math.atan2(end[1] - begin[1], end[0] - begin[0])
                        primitives.append((sign, float(length), towards if r == 0.0 else None))
                        flown += float(length)
            if k < self.count and order[k] < problem.size:
                met[int(order[k])] = flown
        pieces, near = np.empty((PIECES * (problem.size + 2), PIECE)), np.empty((CLOSEST, GAP + 1))
        size = trace(self.stops, self.count, self.scene, pieces)
        for i in set(range(problem.size)) - set(met):
            passes(nodes[i], pieces, size, False, speed, r, near)
            met[i] = float(near[0, TIME]) * speed
        plan = cut(problem, where(nodes[order[0]], poses[order[0]], 0.0), primitives, met)
        return plan if self.interior else move_to_boundary(problem, plan) or plan


def move_to_boundary(problem: MessengerTour, plan: TourPlan) -> TourPlan | None:
    """Return the same path with each encounter at the nearest crossing of its disc's boundary.

    The result is None if a disc contains the whole path.
    """
    from scipy.optimize import brentq

    r, speed = problem.turning_radius, problem.speed

    def gap(flown: Floats, i: int) -> Floats:
        """Return the distance of the UAV from the boundary of a disc."""
        apart = track(plan, r, flown).poses[:, :2] - problem.positions[i]
        apart -= problem.velocities[i] * (flown[:, None] / speed)
        return np.hypot(*apart.T) - problem.radius[i]  # type: ignore[no-any-return]

    samples, met = outline(plan, r).flown, {}
    for i, t in zip(plan.order, plan.times.tolist(), strict=True):
        met[i] = inside = t * speed
        radius = float(problem.radius[i])
        if radius == 0.0 or gap(np.array([inside]), i)[0] >= -RIM_NEAR * radius:
            continue
        outside = samples[gap(samples, i) >= 0.0]
        if not outside.size:
            return None
        low, high = sorted((inside, float(outside[np.abs(outside - inside).argmin()])))
        met[i] = brentq(
            lambda flown, i=i: gap(np.array([flown]), i)[0],
            low,
            high,
            xtol=1e-15 * max(high, radius),
        )
    path = [
        (int(SIGNS[turn]), length, heading if r == 0 else None)
        for _, turn, length, heading in plan.primitives
    ]
    return cut(problem, plan.start, path, met)


def cut(
    problem: MessengerTour,
    start: Sequence[float] | Floats,
    path: Iterable[tuple[int, float, float | None]],
    stops: dict[int, float],
) -> TourPlan:
    """Return the plan of a path, with its primitives cut at the encounters.

    `path` contains the sign of the curvature and the length (m) of each primitive, and its heading
    (rad) if the UAV turns on the spot. `stops` contains the length flown (m) at the encounter with
    each vehicle; an open tour ends at the last one.
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
                primitives.append(Primitive(number, "RSL"[sign + 1], step, h))
                x, y, h = advance(x, y, h, step, sign, r)
                rest -= step
            flown = max(flown, stops[order[number]])
            points.append((x, y))
            number += 1
        if number == len(order) and not problem.closed:
            break
        if rest > 0.0:
            primitives.append(Primitive(number, "RSL"[sign + 1], rest, h))
            x, y, h = advance(x, y, h, rest, sign, r)
        flown = end
    points += [(x, y)] * (len(order) - len(points))
    times = np.array([min(stops[i], flown) for i in order]) / speed
    return TourPlan(tuple(order), times, np.array(points), np.array(begin), tuple(primitives))
