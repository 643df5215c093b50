"""Seeded feasible corridors: chains of boxes or polytopes.

The generator first draws a path, then a corridor and limits around it with a margin. It uses only
``Generator.random`` and rounds the drawn numbers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.fields import Real, Whole
from ...models.minimum_snap import FREE, MinimumSnap
from ...models.minimum_snap.trajectory import Trajectory
from ..seeds import seeded
from .paths import MOST, random_waypoints, times_by_distance

__all__ = ["corridor", "corridor_with_way", "gates", "hurried"]

Floats = NDArray[np.float64]

#: Rise of the acceleration, 3 s² - 2 s³, whose slope is 0 at both ends.
_RAMP = np.array([0.0, 0.0, 3.0, -2.0])
#: Peak velocity of the minimum-snap motion from rest to rest, relative to its mean velocity.
_REST_PEAK = 35 / 16


def corridor(
    segments: int,
    seed: int = 0,
    dimensions: int = 3,
    *,
    cruise: float = 2.0,
    acceleration: float = 1.2,
    width: float = 0.4,
    slack: float = 0.05,
    name: str = "",
) -> MinimumSnap:
    """Return a chain of overlapping boxes with limits, from rest to rest, inner waypoints free.

    Boxes bound the position, and limits bound velocity and acceleration, all at every instant. The
    instance is feasible: see :func:`corridor_with_way`.

    Parameters
    ----------
    segments : int
        Number of boxes, at least 4.
    seed : int
        Seed of the corridor. Equal seeds give equal corridors.
    dimensions : int
        Number of axes.
    cruise : float
        Velocity of the drawn path along one axis, m/s, varied by up to 10 %.
    acceleration : float
        Largest acceleration of the drawn path, m/s². It determines the duration of turns.
    width : float
        Largest distance between the drawn path and the faces of its box, m. The smallest is half.
    slack : float
        Relative margin of the limits above the peaks of the drawn path.
    name : str
        Name of the model.

    Raises
    ------
    InvalidData
        A size or the seed is not an integer or is too small, or a length or speed is not positive.
    """
    return corridor_with_way(
        segments, seed, dimensions, cruise=cruise, acceleration=acceleration, width=width,
        slack=slack, name=name,
    )[0]  # fmt: skip


def corridor_with_way(
    segments: int,
    seed: int = 0,
    dimensions: int = 3,
    *,
    cruise: float = 2.0,
    acceleration: float = 1.2,
    width: float = 0.4,
    slack: float = 0.05,
    name: str = "",
) -> tuple[MinimumSnap, Trajectory]:
    """Return the model of :func:`corridor` and the path it was drawn around, which is not optimal.

    The path follows the axes at about `cruise`, turns occasionally, and changes its velocity over two
    to five segments. It satisfies every box with a margin of half of `width` and every limit with
    `slack`, so the instance is strictly feasible. Parameters are those of :func:`corridor`.
    """
    count = Whole(4, MOST).coerce("segments", segments, {})
    axes = Whole(1, 1000).coerce("dimensions", dimensions, {})
    pace = Real(lower=0.1, unit="m/s").coerce("cruise", cruise, {})
    strength = Real(lower=0.01, unit="m/s²").coerce("acceleration", acceleration, {})
    room = Real(lower=0.02, unit="m").coerce("width", width, {})
    spare = Real(lower=0).coerce("slack", slack, {})
    rng = seeded(seed)

    spans = _spans(count, rng)
    velocities = _velocities(len(spans), axes, pace, rng)
    owner = np.repeat(np.arange(len(spans)), spans)
    change = np.abs(np.diff(velocities, axis=0)).max(axis=1)
    drawn = 1.0 + rng.random(count)
    # The acceleration determines the duration of turns, and the generator that of cruising.
    share = _ramps(owner)
    needed = change / strength / np.bincount(owner, drawn * share)
    steps = np.ceil(drawn * np.where(change > 0.5 * pace, needed, 1.0)[owner] * 100 - 1e-6)
    times = np.round(np.concatenate([[0.0], np.cumsum(steps)]) / 100, 2)
    way = _way(velocities, owner, times)

    extent = way.extremes()
    margin = room * (0.5 + 0.5 * rng.random((2, count, axes)))
    lower = np.floor((extent.least - margin[0]) * 100) / 100
    upper = np.ceil((extent.largest + margin[1]) * 100) / 100
    waypoints = np.full((count + 1, axes), FREE)
    begin, end = way.at_ends()
    waypoints[0], waypoints[-1] = begin[0], end[-1]
    model = MinimumSnap(
        waypoints=waypoints,
        times=times,
        corridor_lower=lower,
        corridor_upper=upper,
        velocity_limit=_rounded_up(np.abs(velocities).max() * (1 + spare)),
        acceleration_limit=_rounded_up(strength * (1 + spare)),
        name=name,
    )
    return model, way


def _spans(count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Return the number of segments, 2 to 5, of each change of the velocity."""
    result: list[int] = []
    left = count
    while left > 5:
        result.append(3 if rng.random() < 0.5 else 4)
        left -= result[-1]
    # The rest is split into two spans, so that even four segments contain a motion.
    return np.array([*result, left] if result and left > 1 else [*result, left - 2, 2])


def _ramps(owner: NDArray[np.int64]) -> Floats:
    """Return the mean acceleration of each segment, relative to its span's: ½ at both ends."""
    edge = np.concatenate([[True], owner[1:] != owner[:-1]])
    last = np.concatenate([edge[1:], [True]])
    return 1.0 - 0.5 * edge - 0.5 * last


def _velocities(spans: int, axes: int, pace: float, rng: np.random.Generator) -> Floats:
    """Return the velocity between spans: along one axis at a time, at rest at both ends."""
    result = np.zeros((spans + 1, axes))
    axis, sign = 0, 1.0
    for at in range(1, spans):
        if axes > 1 and rng.random() < 0.4:
            # Switch to another axis, so that the path does not return through the previous box.
            axis = (axis + 1 + int((axes - 1) * rng.random())) % axes
            sign = 1.0 if rng.random() < 0.5 else -1.0
        result[at, axis] = sign * pace * (0.9 + 0.2 * rng.random())
    return np.round(result, 2)


def _way(velocities: Floats, owner: NDArray[np.int64], times: Floats) -> Trajectory:
    """Return the trajectory that changes its velocity over each span. `owner` maps segment to span.

    The acceleration rises as 3 s² - 2 s³ over the first segment of a span, is then constant, and
    falls in the same way over the last, so that the jerk is 0 at every knot.
    """
    durations = np.diff(times)
    share = _ramps(owner)
    total = np.bincount(owner, durations * share)
    peak = (np.diff(velocities, axis=0) / total[:, None])[owner]
    first = np.concatenate([[True], owner[1:] != owner[:-1]])
    last = np.concatenate([first[1:], [True]])
    acceleration = np.zeros((owner.size, 4))
    acceleration[:, 0] = ~first
    acceleration += np.where(first, 1.0, np.where(last, -1.0, 0.0))[:, None] * _RAMP
    gained = peak * (durations * share)[:, None]
    velocity = np.cumsum(gained, axis=0) - gained
    inner = np.zeros((owner.size, 6, velocities.shape[1]))
    powers = np.arange(4.0)
    inner[:, 2:] = acceleration[:, :, None] * peak[:, None, :]
    inner[:, 2:] *= (durations[:, None] ** 2 / ((powers + 1) * (powers + 2)))[:, :, None]
    inner[:, 1] = velocity * durations[:, None]
    inner[1:, 0] = np.cumsum(inner.sum(axis=1), axis=0)[:-1]
    return Trajectory(times, inner)


def _rounded_up(value: float) -> Floats:
    return np.asarray(np.ceil(np.round(value * 100, 6)) / 100)


def hurried(segments: int = 10, segment: int = 6, seed: int = 0, *, name: str = "") -> MinimumSnap:
    """Return an infeasible corridor with a velocity limit that one segment cannot satisfy.

    It is that of :func:`corridor`, with both ends of `segment` fixed on the drawn path, and a velocity
    limit on this segment of 0.8 times the mean velocity between them.

    Parameters
    ----------
    segments : int
        Number of boxes, at least 2.
    segment : int
        Index of the infeasible segment.
    seed : int
        Seed of the corridor. Equal seeds give equal corridors.
    name : str
        Name of the model.

    Raises
    ------
    InvalidData
        The drawn path does not move enough in `segment`, or an argument is out of range.
    """
    model, way = corridor_with_way(segments, seed)
    at = Whole(0, model.segments - 1).coerce("segment", segment, {})
    begin, end = way.at_ends()
    waypoints = np.array(model.waypoints)
    waypoints[at], waypoints[at + 1] = begin[at], end[at]
    assert model.velocity_limit is not None
    limits = np.array(model.velocity_limit)
    needed = float(np.abs(end[at] - begin[at]).max() / model.durations[at])
    if needed < 0.1:
        raise InvalidData(
            f"segment must be one in which the path moves, but its mean velocity in {at} is "
            f"{needed:.2g} m/s",
            field="segment",
        )
    limits[at] = np.floor(80 * needed) / 100
    # The ends of the path are unchanged, so this is the only contradiction.
    return _replaced(model, waypoints=waypoints, velocity_limit=limits, name=name)


def _replaced(model: MinimumSnap, **changes: Any) -> MinimumSnap:
    data = {**model.data(), **changes}
    name = data.pop("name", model.name)
    return MinimumSnap.from_data(data, name=name)


def gates(
    segments: int = 6, seed: int = 0, *, width: float = 0.3, speed: float = 1.0, name: str = ""
) -> MinimumSnap:
    """Return a chain of slanted rectangles in the plane, as half-spaces, inner waypoints free.

    The rectangles follow the steps of a random walk and overlap around its waypoints, the gates. A
    straight flight from gate to gate with a stop at each has a margin of `width`.

    Parameters
    ----------
    segments : int
        Number of rectangles, at least 2.
    seed : int
        Seed of the walk. Equal seeds give equal rectangles.
    width : float
        Margin of a rectangle around its step on every side, m.
    speed : float
        Mean speed, m/s. The velocity limit is 1.1 times the peak of a flight that stops at every
        gate.
    name : str
        Name of the model.
    """
    count = Whole(2, MOST).coerce("segments", segments, {})
    room = Real(lower=0.01, unit="m").coerce("width", width, {})
    points = random_waypoints(count, 2, seed, step=2.0)
    times = times_by_distance(points, speed)
    step = np.diff(points, axis=0)
    along = step / np.linalg.norm(step, axis=1)[:, None]
    across = np.column_stack([-along[:, 1], along[:, 0]])
    normals = np.stack([along, -along, across, -across], axis=1)
    corners = np.stack([points[1:], points[:-1], points[1:], points[:-1]], axis=1)
    offsets = np.einsum("khd,khd->kh", normals, corners) + room
    waypoints = np.full_like(points, FREE)
    waypoints[[0, -1]] = points[[0, -1]]
    fastest = np.abs(step / np.diff(times)[:, None]).max() * _REST_PEAK
    return MinimumSnap(
        waypoints=waypoints,
        times=times,
        velocity_limit=_rounded_up(1.1 * float(fastest)),
        polytope_segments=np.repeat(np.arange(count), 4),
        polytope_normals=np.round(normals.reshape(-1, 2), 6),
        polytope_offsets=np.round(offsets.reshape(-1), 6),
        name=name,
    )
