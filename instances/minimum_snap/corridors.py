"""Seeded corridors: chains of boxes or polytopes that are known to have a way through.

A way that keeps everything with a margin is drawn first, and the corridor and the limits are put
around it. Only ``Generator.random`` is drawn from, and what is drawn is rounded.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.fields import Real, Whole
from ...models.minimum_snap import FREE, MinimumSnap
from ...models.minimum_snap.trajectory import Trajectory
from .paths import MOST, generator, random_waypoints, times_by_distance

__all__ = ["corridor", "corridor_with_way", "gates", "hurried"]

Floats = NDArray[np.float64]

#: How the acceleration rises, 3 s² - 2 s³: its slope vanishes at both ends.
_RAMP = np.array([0.0, 0.0, 3.0, -2.0])
#: The largest velocity of the minimum-snap motion from rest to rest, in mean velocities.
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

    Boxes hold the position, and velocity and acceleration are limited, all at every instant. It
    is feasible: see :func:`corridor_with_way`.

    Parameters
    ----------
    segments : int
        Number of boxes, at least 4.
    seed : int
        Same seed, same corridor.
    dimensions : int
        Number of axes.
    cruise : float
        Velocity along one axis that the drawn way flies at, m/s, up to 10 % more or less.
    acceleration : float
        The most that the drawn way needs to change its velocity, m/s²: segments in which it turns
        last as long as that takes.
    width : float
        How far a box reaches beyond the drawn way on each side, m: between half of it and all.
    slack : float
        By how much the limits exceed what the drawn way needs, relatively.
    name : str
        The model's name.

    Raises
    ------
    InvalidData
        A size or a seed that is no whole number or too small, a length or speed that is not > 0.
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
    """Return what :func:`corridor` returns, and the way it was drawn around, which is not the best.

    The way flies along the axes at about `cruise`, turns now and then, and takes two to five
    segments to change its velocity. It keeps every box by half of `width` and every limit by
    `slack`, so the instance is strictly feasible.
    """
    count = Whole(4, MOST).coerce("segments", segments, {})
    axes = Whole(1, 1000).coerce("dimensions", dimensions, {})
    pace = Real(lower=0.1, unit="m/s").coerce("cruise", cruise, {})
    strength = Real(lower=0.01, unit="m/s²").coerce("acceleration", acceleration, {})
    room = Real(lower=0.02, unit="m").coerce("width", width, {})
    spare = Real(lower=0).coerce("slack", slack, {})
    rng = generator(seed)

    spans = _spans(count, rng)
    velocities = _velocities(len(spans), axes, pace, rng)
    owner = np.repeat(np.arange(len(spans)), spans)
    change = np.abs(np.diff(velocities, axis=0)).max(axis=1)
    drawn = 1.0 + rng.random(count)
    # A real change of velocity takes what it takes; cruising lasts as long as was drawn.
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
    """Return in how many segments, 2 to 5, the way changes its velocity each time."""
    found: list[int] = []
    left = count
    while left > 5:
        found.append(3 if rng.random() < 0.5 else 4)
        left -= found[-1]
    # The rest makes two spans, so that even four segments lead somewhere.
    return np.array([*found, left] if found and left > 1 else [*found, left - 2, 2])


def _ramps(owner: NDArray[np.int64]) -> Floats:
    """Return the mean acceleration of each segment, as a share of its span's: ½ at both ends."""
    edge = np.concatenate([[True], owner[1:] != owner[:-1]])
    last = np.concatenate([edge[1:], [True]])
    return 1.0 - 0.5 * edge - 0.5 * last


def _velocities(spans: int, axes: int, pace: float, rng: np.random.Generator) -> Floats:
    """Return the velocity between spans: along one axis at a time, at rest at both ends."""
    found = np.zeros((spans + 1, axes))
    axis, sign = 0, 1.0
    for at in range(1, spans):
        if axes > 1 and rng.random() < 0.4:
            # Another axis, so that nobody has to fly back through the box just left.
            axis = (axis + 1 + int((axes - 1) * rng.random())) % axes
            sign = 1.0 if rng.random() < 0.5 else -1.0
        found[at, axis] = sign * pace * (0.9 + 0.2 * rng.random())
    return np.round(found, 2)


def _way(velocities: Floats, owner: NDArray[np.int64], times: Floats) -> Trajectory:
    """Return the trajectory that changes its velocity over each span; `owner` is a segment's.

    The acceleration rises over the span's first segment as 3 s² - 2 s³, holds, and falls alike over
    the last, so that the jerk vanishes at every knot.
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
    """Return a corridor in which one segment cannot be flown within its velocity limit.

    It is that of :func:`corridor`, with the two ends of `segment` fixed where the drawn way passes
    them, and a velocity limit on this segment of 0.8 times the mean velocity between them.

    Parameters
    ----------
    segments : int
        Number of boxes, at least 2.
    segment : int
        The segment that cannot be flown.
    seed : int
        Same seed, same corridor.
    name : str
        The model's name.
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
            f"segment must be one in which the way moves, which it hardly does in {at}: "
            f"{needed:.2g} m/s",
            field="segment",
        )
    limits[at] = np.floor(80 * needed) / 100
    # The ends of the whole stay as they are, so this is the only contradiction.
    return _replaced(model, waypoints=waypoints, velocity_limit=limits, name=name)


def _replaced(model: MinimumSnap, **changes: Any) -> MinimumSnap:
    data = {**model.data(), **changes}
    name = data.pop("name", model.name)
    return MinimumSnap.from_data(data, name=name)


def gates(
    segments: int = 6, seed: int = 0, *, width: float = 0.3, speed: float = 1.0, name: str = ""
) -> MinimumSnap:
    """Return a chain of slanted rectangles in the plane, as half-spaces, inner waypoints free.

    The rectangles lie along the steps of a random walk and overlap around its waypoints, which are
    the gates. Flying straight from gate to gate, stopping at each, keeps a margin of `width`.

    Parameters
    ----------
    segments : int
        Number of rectangles, at least 2.
    seed : int
        Same seed, same rectangles.
    width : float
        How far a rectangle reaches beyond its step on every side, m.
    speed : float
        Mean speed, m/s; the velocity limit is what stopping at every gate takes and a tenth more.
    name : str
        The model's name.
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
