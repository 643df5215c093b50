"""Flights and curves for tests, and checks by points that share no code with the package."""

import itertools
from fractions import Fraction

import numpy as np

from crosstrack.models import Flight, FlightPlan, GridMap, PointMass, Trajectory, VoxelMap

WALL = [[4.0, -3.0], [6.0, -3.0], [6.0, 3.0], [4.0, 3.0]]
#: Polygon with a hole.
RING = {
    "shell": [[2, -3], [8, -3], [8, 3], [2, 3]],
    "holes": [[[3, -2], [7, -2], [7, 2], [3, 2]]],
}
#: From 0 to 1 in a unit of time, with velocity, acceleration and jerk 0 at both ends.
REST = np.array([0.0, 0, 0, 0, 35, -84, 70, -20])


def around(**changes):
    """Return a flight around a wall."""
    given = {
        "map": [WALL], "start": (0, 0), "goal": (10, 0), "vehicle": PointMass(2.0, 1.0), "radius": 0.3,
    }  # fmt: skip
    return Flight(**{**given, **changes})


def straight(points, pace=20.0):
    """Return the plan that rests at each point, `pace` s apart."""
    places = np.asarray(points, float)
    coefficients = REST[None, :, None] * np.diff(places, axis=0)[:, None]
    coefficients[:, 0] = places[:-1]
    curve = Trajectory(pace * np.arange(len(places)), coefficients)
    return FlightPlan(curve)


def boxes_of(source):
    """Return the lowest and highest corners of the blocked cells of a map, in the order x, y (, z)."""
    blocked = source.blocked.T if isinstance(source, GridMap) else source.blocked
    low = source.origin + source.cell * np.argwhere(blocked)
    return low, low + source.cell


def clearance(source, points):
    """Return the distance of each point from the nearest blocked cell or point of a cloud."""
    low, high = (source, source) if isinstance(source, np.ndarray) else boxes_of(source)
    gaps = np.maximum(np.maximum(low - points[:, None], points[:, None] - high), 0.0)
    return np.linalg.norm(gaps, axis=2).min(axis=1)


def is_clear(curve, source, radius, depth=40):
    """Prove by exact arithmetic that a curve keeps a distance of `radius` from all blocked cells.

    Rational Bézier points are bisected until the box around them is far from each cell. The result is
    False if that is not shown within `depth` bisections.
    """
    low, high = boxes_of(source)
    need = Fraction(radius) ** 2
    for powers in curve.coefficients:
        stack = [(_bezier(powers), 0)]
        while stack:
            control, level = stack.pop()
            box = [(min(axis), max(axis)) for axis in zip(*control, strict=True)]
            first, last = (
                np.array([float(side) for side in ends]) for ends in zip(*box, strict=True)
            )
            gaps = np.maximum(np.maximum(low - last, first - high), 0.0)
            squares = (gaps * gaps).sum(axis=1)
            # Rounding cannot change comparisons outside of this margin.
            margin = 1e-6 * (radius + source.cell) ** 2
            unsure = np.flatnonzero(np.abs(squares - float(need)) <= margin)
            if (squares >= float(need) - margin).all() and all(
                _is_apart(box, [map(Fraction, ends[k].tolist()) for ends in (low, high)], need)
                for k in unsure
            ):
                continue
            if level == depth:
                return False
            stack += [(half, level + 1) for half in _halves(control)]
    return True


def _is_apart(box, cell, need):
    """Return whether two boxes have a squared distance of at least `need`, or no common interior for 0."""
    total, outside = Fraction(0), False
    for (low, high), first, last in zip(box, *cell, strict=True):
        gap = max(low - last, first - high)
        total += max(gap, Fraction(0)) ** 2
        outside |= gap >= 0
    return outside and total >= need


def _bezier(powers):
    """Return the exact Bézier points of a polynomial in ascending powers."""
    count = len(powers)
    rows = [[Fraction(x) for x in row] for row in powers.tolist()]
    points = []
    for i in range(count):
        point = [Fraction(0)] * len(rows[0])
        for j in range(i + 1):
            share = Fraction(_choose(i, j), _choose(count - 1, j))
            point = [a + share * b for a, b in zip(point, rows[j], strict=True)]
        points.append(point)
    return points


def _choose(n, k):
    from math import comb

    return comb(n, k)


def _halves(control):
    """Return the Bézier points of both halves by exact de Casteljau steps."""
    left, right, row = [control[0]], [control[-1]], control
    while len(row) > 1:
        row = [
            [(a + b) / 2 for a, b in zip(first, second, strict=True)]
            for first, second in itertools.pairwise(row)
        ]
        left.append(row[0])
        right.append(row[-1])
    return left, right[::-1]


def world(seed, shape=(24, 24, 8), share=0.12, cell=0.5):
    """Return a voxel map of random blocked boxes with free corners."""
    draw = np.random.default_rng(seed)
    blocked = np.zeros(shape, bool)
    while blocked.mean() < share:
        low = draw.integers(0, shape)
        high = low + draw.integers(1, 5, 3)
        blocked[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = True
    blocked[:4, :4], blocked[-4:, -4:] = False, False
    return VoxelMap(blocked, cell)
