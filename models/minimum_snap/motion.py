"""Motion of a vehicle on a trajectory: series of its position, of its direction and of its yaw."""

from __future__ import annotations

import math
from functools import cache
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .jets import Jet, squared_norm
from .polynomials import bernstein_matrix, derived, horner
from .trajectory import Trajectory

__all__ = ["REST", "Extended", "Motion", "Yaw", "extended", "heading_jumps"]

Floats = NDArray[np.float64]
#: Yaw of a vehicle: ignored, tangent to the path, constant (rad), or a trajectory of one axis.
Yaw: TypeAlias = Literal["tangent"] | float | Trajectory | None

#: Largest control point of the velocity at the end of a segment that is regarded as standstill,
#: relative to the largest control point of the segment. It allows for rounding: the direction of
#: a motion that starts from standstill is that of its first derivative that differs from 0.
REST = 1e-9


class Motion(NamedTuple):
    """Series in time of a motion, for instants or for parts of segments.

    Parameters
    ----------
    position : list of Jet
        Position of each axis, m.
    size, direction : Jet and list of Jet, or None
        Factors of the velocity in the plane: ``velocity = size * direction`` with a size >= 0
        and a direction (m/s) that also differs from 0 at the standstill of the ends of a segment.
    yaw : Jet, optional
        Given yaw, rad.
    tangent : bool
        Whether the yaw is the direction of the path.
    """

    position: list[Jet]
    size: Jet | None
    direction: list[Jet] | None
    yaw: Jet | None
    tangent: bool

    @property
    def velocity(self) -> list[Jet]:
        """Velocity, m/s."""
        return [axis.rate() for axis in self.position]

    @property
    def acceleration(self) -> list[Jet]:
        """Acceleration, m/s²."""
        return [axis.rate().rate() for axis in self.position]

    @property
    def course(self) -> tuple[Jet, Jet]:
        """Speed in the plane (m/s) and rate of its direction (rad/s)."""
        assert self.size is not None and self.direction is not None
        x, y = self.direction
        square = squared_norm([x, y])
        return self.size * square.root(), (x * y.rate() - y * x.rate()) / square

    @property
    def turn(self) -> Jet | None:
        """Rate of the yaw, rad/s; None without a yaw."""
        if self.tangent:
            return self.course[1]
        return None if self.yaw is None else self.yaw.rate()

    @property
    def heading(self) -> Floats:
        """Direction of the path if the yaw follows it, else the yaw or 0, rad, at instants."""
        if self.yaw is not None or self.direction is None:
            value = np.zeros_like(self.position[0].terms[0])
            return value if self.yaw is None else np.asarray(self.yaw.terms[0])
        x, y = self.direction
        return np.asarray(np.arctan2(y.terms[0], x.terms[0]))


class Extended(NamedTuple):
    """Trajectory with the further axes of a motion.

    Parameters
    ----------
    curve : Trajectory
        Axes of the position, then those of size and direction, then the yaw, as far as they exist.
    axes : int
        Number of axes of the position.
    follows : bool
        Whether there are axes of size and direction.
    tangent : bool
        Whether the yaw is the direction of the path.
    """

    curve: Trajectory
    axes: int
    follows: bool
    tangent: bool

    def motion(self, columns: list[Jet]) -> Motion:
        """Return the motion from one series per axis of the curve."""
        d = self.axes
        size = columns[d] if self.follows else None
        direction = columns[d + 1 : d + 3] if self.follows else None
        rest = columns[d + 3 * self.follows :]
        return Motion(columns[:d], size, direction, rest[0] if rest else None, self.tangent)

    def at(self, t: Floats, order: int) -> Motion:
        """Return the series at times with the derivatives up to an order."""
        return self._motion([self.curve(t, k) / math.factorial(k) for k in range(order + 1)])

    def on(self, segment: NDArray[np.int64], s: Floats, order: int) -> Motion:
        """Return the series at scaled times of segments with the derivatives up to an order."""
        inner, long = self.curve.coefficients[segment], self.curve.durations[segment]
        scales = (long**-k / math.factorial(k) for k in range(order + 1))
        return self._motion(
            [horner(derived(inner, k), s) * scale[:, None] for k, scale in enumerate(scales)]
        )

    def _motion(self, terms: list[Floats]) -> Motion:
        columns = [Jet([term[:, j] for term in terms]) for j in range(self.curve.dimensions)]
        return self.motion(columns)


def extended(trajectory: Trajectory, yaw: Yaw, follows: bool) -> Extended:
    """Return the trajectory with the axes of the direction (if it follows the path) and of the yaw."""
    tangent = isinstance(yaw, str)
    columns = [trajectory.coefficients]
    if follows or tangent:
        columns.append(_course(trajectory))
    if yaw is not None and not isinstance(yaw, str):
        if isinstance(yaw, Trajectory):
            columns.append(yaw.coefficients)
        else:
            columns.append(np.full((trajectory.segments, 1, 1), float(yaw)))
    powers = max(part.shape[1] for part in columns)
    padded = [np.pad(part, ((0, 0), (0, powers - part.shape[1]), (0, 0))) for part in columns]
    curve = Trajectory(trajectory.times, np.concatenate(padded, axis=2))
    return Extended(curve, trajectory.dimensions, follows or tangent, tangent)


def _course(trajectory: Trajectory) -> Floats:
    """Return size and direction of the velocity in the plane, shape (segments, degree, 3).

    The velocity of a segment is ``s^k (1 - s)^l`` times the direction, with the orders k and l of its
    zeros at the ends. A segment at rest has the size 0 and the direction of the previous segment.
    """
    inner = derived(trajectory.coefficients[:, :, :2], 1) / trajectory.durations[:, None, None]
    result = np.zeros((trajectory.segments, inner.shape[1], 3))
    previous = np.array([1.0, 0.0])
    for segment, powers in enumerate(inner):
        size = REST * float(np.abs(bernstein_matrix(len(powers) - 1) @ powers).max())
        begin = _zeros(powers, size)
        # Powers of 1 - s: the expansion at the other end.
        end = _zeros(_reflection(len(powers)) @ powers, size)
        if begin == len(powers) or begin + end >= len(powers):
            result[segment, 0, 1:] = previous
            continue
        direction = powers[begin:]
        for _ in range(end):
            direction = np.cumsum(direction, axis=0)[:-1]
        factor = np.zeros(begin + end + 1)
        factor[begin:] = np.polynomial.polynomial.polypow([1.0, -1.0], end)
        result[segment, : len(factor), 0] = factor
        result[segment, : len(direction), 1:] = direction
        previous = direction.sum(axis=0)
        previous = previous / np.linalg.norm(previous)
    return result


def _zeros(powers: Floats, size: float) -> int:
    """Return the number of leading coefficients that do not exceed `size`."""
    small = np.abs(powers).max(axis=1) <= size
    return len(powers) if small.all() else int(small.argmin())


@cache
def _reflection(size: int) -> Floats:
    """Return the matrix from the powers of s to those of 1 - s."""
    return np.array([[(-1.0) ** i * math.comb(j, i) for j in range(size)] for i in range(size)])


def heading_jumps(trajectory: Trajectory) -> Floats:
    """Return the changes of the direction in the plane at the inner knots, rad, in [0, π]."""
    course = _course(trajectory)[:, :, 1:]
    before, after = course[:-1].sum(axis=1), course[1:, 0]
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    jumps: Floats = np.abs(np.arctan2(cross, (before * after).sum(axis=1)))
    return jumps
