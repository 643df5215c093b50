"""Obstacles whose motion is known in advance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Declared, Nested
from ..fields import Array, Optional, Real, declared, show
from ..inputs import FloatArray, FloatsOrNone
from ..minimum_snap.trajectory import Trajectory
from ..specs import count_rows

__all__ = ["MovingObstacle"]

Floats = NDArray[np.float64]

#: Maximum number of dimensions.
DIMENSIONS = 3


@dataclass(frozen=True, eq=False)
class MovingObstacle(Declared):
    """Disc or ball whose motion is known: straight from place to place, or along polynomials.

    It stays at its first place before the first time, and at its last place after the last time.

    Parameters
    ----------
    radius : float
        Radius in metres, at least 0.
    times : ndarray, shape (k,)
        Strictly increasing times in seconds; a single time declares a standing obstacle.
    positions : ndarray, shape (k, dimensions), optional
        Centres at `times` in metres, connected by straight lines at constant speed.
    coefficients : ndarray, shape (k - 1, degree + 1, dimensions), optional
        Polynomials between the times instead of `positions`, as those of
        :class:`~crosstrack.models.Trajectory`: ascending powers of the scaled time of each segment, m.

    Raises
    ------
    InvalidData
        Both or neither of `positions` and `coefficients` are given, their shape does not fit `times`,
        there are not 1 to 3 dimensions, times do not increase, or the motion jumps between two
        polynomials.

    Examples
    --------
    >>> from crosstrack.models import MovingObstacle
    >>> cart = MovingObstacle(0.5, [0, 10, 20], [[0, 5], [8, 5], [8, 0]])
    >>> cart(15).tolist(), cart(60).tolist()
    ([8.0, 2.5], [8.0, 0.0])
    """

    radius: float = declared(Real(lower=0, unit="m"))
    times: FloatArray = declared(Array(("times",), unit="s"))
    positions: FloatsOrNone = declared(
        Optional(Array(("times", "dimensions"), unit="m")), default=None, added=True
    )
    coefficients: FloatsOrNone = declared(
        Optional(Array(("segments", "degree + 1", "dimensions"), unit="m")),
        default=None,
        added=True,
    )

    def _feed(self) -> Iterator[bytes]:
        """Yield the bytes that identify the content: all fields, as earlier versions did in digests."""
        for name, spec in self._specs():
            yield f"\0{name}\0".encode()
            yield from spec.feed(getattr(self, name))

    def check(self) -> None:
        """Refuse ambiguous, jumping and empty motions."""
        if (self.positions is None) == (self.coefficients is None):
            count = "neither" if self.positions is None else "both"
            raise InvalidData(
                f"positions or coefficients must be given, but not both; got {count}",
                field="positions",
            )
        bad = np.flatnonzero(np.diff(self.times) <= 0)
        fewest = 1 if self.coefficients is None else 2
        if bad.size or self.times.size < fewest:
            raise InvalidData(
                f"times must hold at least {fewest} strictly increasing numbers, got {show(self.times)}",
                field="times",
            )
        name, motion = "positions", self.positions
        if motion is None:
            name, motion = "coefficients", self.coefficients
            assert motion is not None
            count_rows(name, len(motion), "", {"": (self.times.size - 1, "times (less one)")})
        if 0 in motion.shape or motion.shape[-1] > DIMENSIONS:
            raise InvalidData(
                f"{name} must have 1 to {DIMENSIONS} dimensions, got shape {motion.shape}",
                field=name,
            )
        if self.coefficients is not None:
            begins, ends = self.trajectory.at_ends()
            jumps = np.abs(begins[1:] - ends[:-1]).max(axis=1, initial=0.0)
            allowed = 1e-9 * float(np.abs(self.coefficients).sum(axis=1).max())
            if (jumps > allowed).any():
                k = int(np.argmax(jumps))
                raise InvalidData(
                    f"coefficients must continue at times[{k + 1}], got a jump of {jumps[k]:g} m",
                    field="coefficients",
                )

    @property
    def dimensions(self) -> int:
        """Number of axes."""
        motion = self.coefficients if self.positions is None else self.positions
        assert motion is not None
        return int(motion.shape[-1])

    @cached_property
    def trajectory(self) -> Trajectory:
        """Motion from the first to the last time; a standing obstacle rests for a second or more."""
        if self.coefficients is not None:
            return Trajectory(self.times, self.coefficients)
        assert self.positions is not None
        if self.times.size == 1:
            end = self.times + np.maximum(1.0, 1e-9 * np.abs(self.times))
            return Trajectory(np.append(self.times, end), self.positions[:, None])
        lines = np.stack([self.positions[:-1], np.diff(self.positions, axis=0)], axis=1)
        return Trajectory(self.times, lines)

    def __call__(self, t: Any) -> Floats:
        """Return the centre at any times `t` (s), m, shape (*t.shape, dimensions)."""
        motion = self.trajectory
        return motion(np.clip(np.asarray(t, float), motion.times[0], motion.times[-1]))

    def during(self, begin: float, end: float) -> Trajectory:
        """Return the motion from at most `begin` to at least `end` (s), at rest beyond its own times."""
        motion = self.trajectory
        times, coefficients = motion.times, motion.coefficients
        still = np.zeros((2, 1, *coefficients.shape[1:]))
        still[0, 0, 0], still[1, 0, 0] = coefficients[0, 0], coefficients[-1].sum(axis=0)
        if begin < times[0]:
            times = np.append(begin, times)
            coefficients = np.concatenate([still[0], coefficients])
        if end > times[-1]:
            times = np.append(times, end)
            coefficients = np.concatenate([coefficients, still[1]])
        return Trajectory(times, coefficients)


@dataclass(frozen=True)
class Movers(Nested):
    """Moving obstacle in the plane or in space (`axes`); errors name its row of the field."""

    axes: int = 2

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Declared:
        field = name.partition("[")[0]
        if not isinstance(value, MovingObstacle | Mapping):
            raise InvalidData(f"{name} must be a MovingObstacle, got {show(value)}", field=field)
        try:
            result = super().coerce(name, value, sizes)
        except InvalidData as error:
            raise InvalidData(f"{name}: {error}", field=field) from None
        assert isinstance(result, MovingObstacle)
        if result.dimensions != self.axes:
            raise InvalidData(
                f"{name} must have {self.axes} dimensions, got {result.dimensions}", field=field
            )
        return result
