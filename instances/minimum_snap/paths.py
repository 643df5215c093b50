"""Problems through waypoints on curves given by formulas and on seeded random walks.

Random numbers are from ``Generator.random`` only. Coordinates are rounded to the millimetre and
times to the millisecond, so that a seed defines the same instance on every platform.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ...models.fields import Array, Real, Whole
from ...models.minimum_snap.model import MinimumSnap
from ..seeds import seeded

__all__ = [
    "figure_eight",
    "helix",
    "random_walk",
    "random_waypoints",
    "square",
    "times_by_distance",
]

Floats = NDArray[np.float64]

#: Largest number of segments of a generated problem.
MOST = 1_000_000


@np.errstate(over="ignore", invalid="ignore")  # the model rejects values that are not finite
def times_by_distance(
    waypoints: ArrayLike, speed: float = 1.0, *, shortest: float = 0.1, ramp: float = 0.0
) -> Floats:
    """Return times for waypoints such that every segment has the same mean speed.

    Parameters
    ----------
    waypoints : ndarray, shape (knots, dimensions)
        Positions, m.
    speed : float
        Mean speed, m/s; 1 by default.
    shortest : float
        Minimum duration of a segment, s, for close or equal waypoints.
    ramp : float
        Additional duration of the first and the last segment, s, for the acceleration from rest.

    Returns
    -------
    ndarray, shape (knots,)
        Times from 0, s, rounded to the millisecond.

    Raises
    ------
    InvalidData
        A coordinate is free or infinite, there are fewer than two waypoints, `speed` is not
        positive, `shortest` is below a millisecond, or `ramp` is negative.
    """
    points = Array(("knots", "dimensions")).coerce("waypoints", waypoints, {})
    if len(points) < 2:
        raise InvalidData(
            f"waypoints must hold at least 2 entries, got {len(points)}", field="waypoints"
        )
    pace = Real(lower=0, strict=True, unit="m/s").coerce("speed", speed, {})
    least = Real(lower=1e-3, unit="s").coerce("shortest", shortest, {})
    extra = Real(lower=0, unit="s").coerce("ramp", ramp, {})
    durations = np.maximum(np.linalg.norm(np.diff(points, axis=0), axis=1) / pace, least)
    durations[0] += extra
    durations[-1] += extra
    return np.concatenate([[0.0], np.round(np.cumsum(np.round(durations, 3)), 3)])


def figure_eight(
    segments: int = 12,
    dimensions: int = 3,
    *,
    size: float = 2.0,
    height: float = 1.0,
    climb: float = 0.3,
    lap: float = 12.0,
    name: str = "",
) -> MinimumSnap:
    """Return a lap of a figure eight from rest to rest: x = a sin θ, y = a sin θ cos θ.

    The lap starts and ends at the crossing. The curve is the lemniscate of Gerono, and the choice of
    waypoints is ours.

    Parameters
    ----------
    segments : int
        Number of segments, at least 4. All have the same duration except the first and the last,
        which are 1.5 times as long.
    dimensions : int
        2: x and y; 3: also z = height + climb sin θ; 4: also yaw along the path, rad.
    size : float
        a, half the width, m.
    height, climb : float
        Mean height, and rise of the right loop, m.
    lap : float
        Total duration, s.
    name : str
        Name of the model.
    """
    count = Whole(4, MOST).coerce("segments", segments, {})
    width = Whole(2, 4).coerce("dimensions", dimensions, {})
    a = Real(lower=0, strict=True, unit="m").coerce("size", size, {})
    level, rise = (
        Real(unit="m").coerce(n, v, {}) for n, v in (("height", height), ("climb", climb))
    )
    long = Real(lower=0, strict=True, unit="s").coerce("lap", lap, {})
    angle = 2 * np.pi * np.arange(count + 1) / count
    yaw = np.unwrap(np.arctan2(np.cos(2 * angle), np.cos(angle)))
    axes = [a * np.sin(angle), a * np.sin(angle) * np.cos(angle), level + rise * np.sin(angle), yaw]
    share = np.ones(count)
    share[[0, -1]] = 1.5
    times = np.concatenate([[0.0], np.cumsum(share)]) * (long / share.sum())
    return _model(np.column_stack(axes[:width]), times, name)


def helix(
    turns: int = 3,
    per_turn: int = 8,
    *,
    radius: float = 1.0,
    pitch: float = 0.5,
    speed: float = 1.0,
    name: str = "",
) -> MinimumSnap:
    """Return a climb along a helix from rest to rest at a constant mean speed.

    Parameters
    ----------
    turns, per_turn : int
        Number of turns, and of segments per turn (at least 3).
    radius, pitch : float
        Radius, and rise per turn, m.
    speed : float
        Mean speed, m/s.
    name : str
        The model's name.
    """
    around = Whole(3, MOST).coerce("per_turn", per_turn, {})
    count = Whole(1, MOST // around).coerce("turns", turns, {}) * around
    r = Real(lower=0, strict=True, unit="m").coerce("radius", radius, {})
    rise = Real(unit="m").coerce("pitch", pitch, {})
    turn = np.arange(count + 1) / around
    angle = 2 * np.pi * turn
    points = np.column_stack([r * np.cos(angle), r * np.sin(angle), rise * turn])
    return _timed(points, speed, name)


def square(side: float = 2.0, laps: int = 1, *, speed: float = 1.0, name: str = "") -> MinimumSnap:
    """Return laps around a square in the plane through its corners, from rest to rest.

    Parameters
    ----------
    side : float
        Length of a side, m.
    laps : int
        Number of laps, of 4 segments each.
    speed : float
        Mean speed, m/s.
    name : str
        The model's name.
    """
    edge = Real(lower=0, strict=True, unit="m").coerce("side", side, {})
    count = Whole(1, MOST).coerce("laps", laps, {})
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * edge
    return _timed(np.concatenate([np.tile(corners, (count, 1)), corners[:1]]), speed, name)


def random_walk(
    segments: int,
    dimensions: int = 3,
    seed: int = 0,
    *,
    step: float = 1.0,
    speed: float = 1.0,
    name: str = "",
    **options: Any,
) -> MinimumSnap:
    """Return a minimum-snap problem through a random walk, from rest to rest.

    Parameters
    ----------
    segments : int
        Number of segments.
    dimensions : int
        Number of axes.
    seed : int
        Seed of the walk. Equal seeds give equal waypoints.
    step : float
        Mean length of a step, m. Lengths are between 0.5 and 1.5 times this value, so that durations
        differ by a factor of at most three.
    speed : float
        Mean speed, m/s. The times are proportional to the distances.
    name : str
        The model's name.
    **options
        Further parameters of :class:`~crosstrack.models.MinimumSnap`.

    Raises
    ------
    InvalidData
        A size or the seed is not an integer or is too small, or a length or speed is not positive.
    """
    points = random_waypoints(segments, dimensions, seed, step=step)
    return _timed(points, speed, name, **options)


def random_waypoints(
    segments: int, dimensions: int = 3, seed: int = 0, *, step: float = 1.0
) -> Floats:
    """Return the waypoints of :func:`random_walk`, m, shape (segments + 1, dimensions).

    The first waypoint is the origin.

    Parameters
    ----------
    segments, dimensions : int
        Number of steps and of axes.
    seed : int
        Seed of the walk. Equal seeds give equal waypoints.
    step : float
        Mean length of a step, m.
    """
    count = Whole(1, MOST).coerce("segments", segments, {})
    width = Whole(1, 1000).coerce("dimensions", dimensions, {})
    mean = Real(lower=0.01, unit="m").coerce("step", step, {})
    rng = seeded(seed)
    heading = rng.random((count, width)) - 0.5
    length = mean * (0.5 + rng.random(count))
    size = np.linalg.norm(heading, axis=1)
    # A heading of length 0 has no direction. Its probability is 1e-15.
    heading[size < 1e-12] = 1.0
    heading /= np.linalg.norm(heading, axis=1)[:, None]
    walk = np.cumsum(np.round(heading * length[:, None], 3), axis=0)
    return np.concatenate([np.zeros((1, width)), np.round(walk, 3)])


@np.errstate(over="ignore", invalid="ignore")
def _timed(points: Floats, speed: float, name: str, **options: Any) -> MinimumSnap:
    pace = Real(lower=0, strict=True, unit="m/s").coerce("speed", speed, {})
    # Acceleration from rest takes about half a segment of additional time at the mean speed.
    ramp = 0.5 * float(np.linalg.norm(points[1] - points[0])) / pace
    return _model(
        points, times_by_distance(points, pace, shortest=1e-3, ramp=ramp), name, **options
    )


def _model(points: Floats, times: Floats, name: str, **options: Any) -> MinimumSnap:
    return MinimumSnap(
        waypoints=np.round(points, 3), times=np.round(times, 3), name=name, **options
    )
