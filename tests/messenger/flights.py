"""Feasible tours built by hand from a turn and a straight line per vehicle, independent of solvers."""

import math

import numpy as np
from numba import njit

from crosstrack.models.messenger import Primitive, TourPlan
from crosstrack.models.messenger.dubins import shortest

TURNS = {"L": 1.0, "R": -1.0}


@njit  # not cached: a cache would be stale after changes of the callees
def fill_lengths(start, end, radius, lengths):
    for i in range(len(start)):
        a, b, c, _ = shortest(
            start[i, 0], start[i, 1], start[i, 2], end[i, 0], end[i, 1], end[i, 2], radius[i]
        )
        lengths[i] = a + b + c


def shortest_lengths(start, end, r):
    """Return the lengths of the shortest paths between configurations, which broadcast."""
    start, end, r = np.asarray(start, float), np.asarray(end, float), np.asarray(r, float)
    shape = np.broadcast_shapes(start.shape[:-1], end.shape[:-1], r.shape)
    start, end = (np.broadcast_to(part, (*shape, 3)).reshape(-1, 3).copy() for part in (start, end))
    lengths = np.empty(len(start))
    fill_lengths(start, end, np.broadcast_to(r, shape).ravel(), lengths)
    return lengths.reshape(shape)


def toward(pose, place, radius, turn):
    """Return the lengths of a turn and a straight line to a place; None inside the turning circle."""
    sign = TURNS[turn]
    x, y, heading = pose
    middle = np.array(
        [x - sign * radius * math.sin(heading), y + sign * radius * math.cos(heading)]
    )
    gap = np.asarray(place) - middle
    far = math.hypot(*gap)
    if far < radius or (radius == 0 and far == 0):
        return None if far < radius else (0.0, 0.0, heading)
    straight = math.sqrt(far * far - radius * radius)
    course = math.atan2(gap[1], gap[0]) + sign * math.asin(min(radius / far, 1.0))
    angle = (sign * (course - heading)) % (2 * math.pi)
    return radius * angle, straight, course


def chase(model, vehicle, pose, begin, turn, loops=0):
    """Return when a turn with full circles and a line first meet a disc's centre, and their lengths."""
    radius, speed = model.turning_radius, model.speed

    def way(time):
        found = toward(pose, model.where(vehicle, time), radius, turn)
        return found and (found[0] + 2 * math.pi * radius * loops, *found[1:])

    def late(time):
        found = way(time)
        return math.inf if found is None else found[0] + found[1] - speed * (time - begin)

    step, low, before = (0.1 + 0.2 * radius) / speed, begin, late(begin)
    for _ in range(2_000):
        high = low + step
        after = late(high)
        if after <= 0 < before < math.inf:
            left, right = low, high
            for _ in range(100):
                middle = 0.5 * (left + right)
                left, right = (middle, right) if late(middle) > 0 else (left, middle)
            if abs(late(right)) < 1e-7 * speed:
                return right, way(right)
        low, before, step = high, after, 1.02 * step
        if high > 1e6:
            break
    return math.inf, None


def flight(model, order=None):
    """Return the plan that meets vehicles at their centres, by default the earliest one next."""
    left = list(range(model.size)) if order is None else list(order)
    start = np.zeros(2) if model.start is None else model.start
    pose = [*start[:2], start[2] if start.size == 3 else math.pi / 2]
    pose_at_start = list(pose)
    now, done, times, points, pieces = 0.0, [], [], [], []
    while left:
        near = left if order is None else left[:1]
        for loops in (0, 1):
            found = [
                (*chase(model, k, pose, now, turn, loops), k, turn) for k in near for turn in TURNS
            ]
            met, way, vehicle, turn = min(found, key=lambda one: one[0])
            if way is not None:
                break
        arc, straight, course = way
        leg = len(done)
        if model.turning_radius > 0:
            pieces.append(Primitive(leg, turn, arc, pose[2]))
        end = pose[2] + TURNS[turn] * arc / (model.turning_radius or 1.0)
        heading = course if model.turning_radius == 0 else end
        pieces.append(Primitive(leg, "S", straight, heading))
        place = model.where(vehicle, met)
        pose, now = [*place, heading], met
        done.append(vehicle), times.append(met), points.append(place)
        left.remove(vehicle)
    return TourPlan(tuple(done), times, points, pose_at_start, tuple(pieces))
