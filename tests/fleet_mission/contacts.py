"""Least distance of two robots under way, written apart from the package, and missions to try it on.

The squared distance of two piecewise polynomials is a polynomial between two knots of either, so its
minimum is at an end of such an interval or at a real root of its derivative. Positions come from the
plan's JSON data alone. ``python -m contacts BEGIN END`` prints a line for each mission drawn.
"""

from __future__ import annotations

import itertools
import math
import sys

import numpy as np
from numpy.polynomial import polynomial as P

import crosstrack as ct
from crosstrack.models import FleetMission


def positions(data, begin, end):
    """Return the polynomials x, y in u of 0 … 1 over the interval, from a trajectory's data."""
    times = data["times"]
    k = max(i for i in range(len(times) - 1) if times[i] <= 0.5 * (begin + end))
    long = times[k + 1] - times[k]
    shift, scale = (begin - times[k]) / long, (end - begin) / long
    result = []
    for axis in range(2):
        powers = [row[axis] for row in data["coefficients"][k]]
        whole = np.zeros(1)
        for power in reversed(powers):  # Horner's rule with s = shift + scale u
            whole = P.polyadd(P.polymul(whole, [shift, scale]), [power])
        result.append(whole)
    return result


def least_distance(one, other):
    """Return the least distance of two trajectories' data while both are under way, and its time."""
    begin = max(one["times"][0], other["times"][0])
    end = min(one["times"][-1], other["times"][-1])
    if not begin < end:
        return math.inf, math.nan
    knots = sorted({begin, end, *(t for t in one["times"] + other["times"] if begin < t < end)})
    best = (math.inf, math.nan)
    for low, high in itertools.pairwise(knots):
        pair = zip(positions(one, low, high), positions(other, low, high), strict=True)
        between = [P.polysub(a, b) for a, b in pair]
        square = P.polyadd(*(P.polymul(part, part) for part in between))
        slope = P.polyder(square)
        roots = P.polyroots(np.trim_zeros(slope, "b")) if np.any(slope) else np.zeros(0)
        # Roots that rounding has moved off the real line are candidates too; more harm nothing.
        u = np.clip(np.concatenate([roots.real, np.linspace(0.0, 1.0, 33)]), 0.0, 1.0)
        apart = np.hypot(*(P.polyval(u, part) for part in between))
        k = int(np.argmin(apart))
        best = min(best, (float(apart[k]), low + (high - low) * float(u[k])))
    return best


def contacts(model, plan):
    """Return the pairs of robots that come nearer than the separation, with distance and time."""
    trajectories = model.plan_to_data(plan)["trajectories"]
    found = []
    for a, b in itertools.combinations(range(len(trajectories)), 2):
        if trajectories[a] is None or trajectories[b] is None:
            continue
        distance, time = least_distance(trajectories[a], trajectories[b])
        if distance < model.separation - 1e-6 * model.cell:
            found.append((a, b, distance, time))
    return found


def track(obstacle, end):
    """Return the motion of an obstacle's JSON data from 0 to `end` as a trajectory's data, at rest beyond its times."""
    times = list(obstacle["times"])
    if obstacle.get("positions") is not None:
        places = obstacle["positions"]
        rows = [
            [a, [q - p for p, q in zip(a, b, strict=True)]] for a, b in itertools.pairwise(places)
        ]
        first, last = places[0], places[-1]
    else:
        rows = obstacle["coefficients"]
        first, last = rows[0][0], [sum(column) for column in zip(*rows[-1], strict=True)]
    if times[0] > 0:
        times, rows = [0.0, *times], [[first], *rows]
    if times[-1] < end:
        times, rows = [*times, end + 1.0], [*rows, [last]]
    return {"times": times, "coefficients": rows}


def moving_contacts(model, plan):
    """Return robots and moving obstacles that come nearer than both radii, with distance and time."""
    found = []
    for k, obstacle in enumerate(model.data()["moving"] if model.moving else ()):
        for robot, trajectory in enumerate(model.plan_to_data(plan)["trajectories"]):
            distance, time = least_distance(trajectory, track(obstacle, plan.end))
            if distance < model.radius + obstacle["radius"] - 1e-6 * model.cell:
                found.append((robot, k, distance, time))
    return found


def mission(seed):
    """Return a mission drawn by `seed`: walls with gaps, corridors, a depot in a corner or anywhere."""
    draw = np.random.default_rng(seed)
    side, cell = float(draw.integers(10, 24)), 0.5
    radius = float(draw.choice([0.1, 0.25, 0.4]))
    obstacles = []
    for x in np.arange(4.0, side - 3.0, float(draw.uniform(3.5, 7.0))):
        gap, wide = draw.uniform(1.5, side - 3.0), 2 * radius + float(draw.choice([1.1, 1.6, 3.0]))
        width = float(draw.uniform(0.3, 1.5))
        for low, high in ((0.0, gap - wide / 2), (gap + wide / 2, side)):
            if high - low > 0.2:
                obstacles.append([[x, low], [x + width, low], [x + width, high], [x, high]])
    vehicles = int(draw.integers(2, 11))
    corner = [1.0, 1.0] if draw.random() < 0.5 else [1.0, float(draw.uniform(1.0, side - 1.0))]
    last = [side - 1.0, float(draw.uniform(1.0, side - 1.0))]
    nodes = []
    while len(nodes) < vehicles + int(draw.integers(0, 4)):
        near = draw.random() < 0.4  # many robots share one way
        place = (
            np.array(last) + draw.uniform(-1, 1, 2) if near else draw.uniform(0.6, side - 0.6, 2)
        )
        place = np.clip(place, 0.6, side - 0.6)
        try:
            FleetMission(obstacles, (0, 0, side, side), [place], corner, 1, cell, radius)
        except ct.errors.InvalidData as error:
            if error.field != "nodes":
                return mission(seed + 1_000_000)
            continue
        nodes.append(place)
    explicit = (
        {"separation": float(draw.choice([2.0, 2.5, 4.0])) * radius} if draw.random() < 0.5 else {}
    )
    return FleetMission(
        obstacles, (0, 0, side, side), nodes, corner, vehicles, cell, radius, name=f"drawn-{seed}", **explicit
    )  # fmt: skip


def main():
    """Solve the missions from BEGIN up to END and print their contacts."""
    solved = touched = 0
    begin, end = map(int, sys.argv[1:3])
    for seed in range(begin, end):
        model = mission(seed)
        answer = ct.solve(model, time_limit=20, seed=1)
        touching = [] if answer.plan is None else contacts(model, answer.plan)
        solved += answer.plan is not None
        touched += bool(touching)
        if answer.plan is None or touching:
            print(seed, answer, touching, flush=True)
    print(f"{end - begin} missions, {solved} with a plan, {touched} with a contact")


if __name__ == "__main__":
    main()
