"""Eigenaxis slew: rotation about one axis with a trapezoidal rate (bang-coast-bang)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .quaternions import product, rotation_about

__all__ = ["EigenaxisProfile"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EigenaxisProfile:
    """Rest-to-rest rotation about one axis with a trapezoidal or triangular rate.

    It starts at the attitude `initial` and turns by `angle` (rad) about the unit vector `axis` in body axes,
    with the `acceleration` (rad/s²) up to the rate `peak` (rad/s), which a short rotation does not reach.
    """

    initial: Floats
    axis: Floats
    angle: float
    peak: float
    acceleration: float

    @cached_property
    def ramp(self) -> float:
        """Duration of each ramp, s."""
        return min(self.peak / self.acceleration, float(np.sqrt(self.angle / self.acceleration)))

    @property
    def reached(self) -> float:
        """Highest rate of the rotation, rad/s."""
        return self.acceleration * self.ramp

    @cached_property
    def duration(self) -> float:
        """Duration of the rotation, s."""
        if self.angle == 0.0:
            return 0.0
        return self.ramp + self.angle / self.reached

    @cached_property
    def breaks(self) -> Floats:
        """Times at which the acceleration jumps, from 0 to the duration, increasing."""
        times = np.array([0.0, self.ramp, self.duration - self.ramp, self.duration])
        result: Floats = times[np.concatenate([[True], np.diff(times) > 1e-9])]
        return result

    def turned(self, t: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Return the angle (rad), its rate and its acceleration at times `t`, each of its shape.

        After the end the angle is constant. At a jump, the acceleration is that after it.
        """
        times = np.clip(np.asarray(t, float), 0.0, self.duration)
        ramp, rate, long = self.ramp, self.acceleration, self.duration
        left = long - times
        before, after = times < ramp, left <= ramp
        along = 0.5 * rate * ramp**2 + self.reached * (times - ramp)
        angle = np.where(before, 0.5 * rate * times**2, along)
        angle = np.where(after, self.angle - 0.5 * rate * left**2, angle)
        speed = np.where(before, rate * times, np.where(after, rate * left, self.reached))
        push = np.where(before, rate, np.where(after, -rate, 0.0))
        push = np.where(np.asarray(t, float) >= long, 0.0, push)
        return angle, speed, push

    def course(self, t: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Return attitude (…, 4), body rates (…, 3) and their derivatives (…, 3) at times `t`."""
        angle, speed, push = self.turned(t)
        attitude = product(self.initial, rotation_about(self.axis, angle))
        return attitude, speed[..., None] * self.axis, push[..., None] * self.axis
