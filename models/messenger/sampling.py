"""Poses of the UAV along a tour, between the ends of its primitives."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .checks import integrated
from .plan import SIGNS, TourPlan

__all__ = ["Track", "outline", "track"]

Floats = NDArray[np.float64]

#: Largest angle of a turn drawn as one straight line, in rad.
_TURN = math.radians(4.0)
#: Number of full circles of a turn that are drawn in wind: there they do not coincide.
_DRIFTING = 100


class Track(NamedTuple):
    """Poses on the path of a tour: x, y (m) and heading (rad, not wrapped), shape (k, 3).

    `flown` (k,) is the length of the path up to each pose (m), and `legs` (k,) is the leg of each pose;
    at the boundary of two legs, the earlier one.
    """

    flown: Floats
    poses: Floats
    legs: NDArray[np.int64]


def track(
    plan: TourPlan, turning_radius: float, flown: ArrayLike, drift: Floats | None = None
) -> Track:
    """Return the poses after the lengths `flown` (m), shape (k,), clipped to the length of the path.

    With `drift`, shape (2,), the displacement of the air per metre flown, places are over the ground.
    """
    lengths = np.array([primitive.length for primitive in plan.primitives])
    ends = np.cumsum(lengths)
    distance = np.clip(np.asarray(flown, float), 0.0, ends[-1] if ends.size else 0.0)
    piece = np.minimum(np.searchsorted(ends, distance), ends.size - 1)
    rest = distance - (ends - lengths)[piece] if ends.size else distance
    return _shifted(Track(distance, *_advance(plan, turning_radius, piece, rest)), drift)


def _shifted(path: Track, drift: Floats | None) -> Track:
    """Return `path` over the ground."""
    if drift is not None:
        path.poses[:, :2] += path.flown[:, None] * drift
    return path


def outline(plan: TourPlan, turning_radius: float, drift: Floats | None = None) -> Track:
    """Return poses that draw the path: the ends of lines, and turns in small steps.

    `drift` is that of :func:`track`.
    """
    loops = _DRIFTING if drift is not None and drift.any() else 2
    around = 2 * math.pi * turning_radius
    parts, pieces = [np.zeros(1)], [0]
    for k, primitive in enumerate(plan.primitives):
        steps, length = np.array([primitive.length]), abs(primitive.length)
        if primitive.turn != "S" and around > 0 and length > 0:
            # Full circles between the first and the last coincide with these.
            drawn = length if length <= loops * around else (loops - 1) * around + length % around
            count = math.ceil(drawn / turning_radius / _TURN)
            fine = drawn * np.arange(1, count + 1) / count
            steps = np.sign(primitive.length) * np.where(
                fine > (loops - 1) * around, fine + (length - drawn), fine
            )
        parts.append(steps)
        pieces += [k] * len(steps)
    rest, piece = np.concatenate(parts), np.array(pieces)
    lengths = np.array([0.0, *(primitive.length for primitive in plan.primitives)])
    flown = np.cumsum(lengths)[piece] + rest
    return _shifted(Track(flown, *_advance(plan, turning_radius, piece, rest)), drift)


def _advance(
    plan: TourPlan, turning_radius: float, piece: NDArray[np.int64], rest: Floats
) -> tuple[Floats, NDArray[np.int64]]:
    """Return poses and legs at the lengths `rest` after the start of each primitive."""
    poses = integrated(plan, turning_radius)
    if not plan.primitives:
        return np.repeat(poses, rest.size, axis=0), np.zeros(rest.size, np.int64)
    begin = poses[piece]
    signs = np.array([SIGNS[primitive.turn] for primitive in plan.primitives])[piece]
    angle = signs * rest / turning_radius if turning_radius > 0 else np.zeros(rest.size)
    # Chord of a part of an arc; a straight line is the case of angle 0.
    chord, middle = rest * np.sinc(0.5 * angle / np.pi), begin[:, 2] + 0.5 * angle
    result = begin + np.column_stack([chord * np.cos(middle), chord * np.sin(middle), angle])
    return result, np.array([primitive.leg for primitive in plan.primitives])[piece]
