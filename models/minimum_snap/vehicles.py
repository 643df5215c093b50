"""Vehicles: limits of a trajectory that follow from the forces and wheels that move it.

Sources: Mellinger and Kumar, "Minimum snap trajectory generation and control for quadrotors", ICRA
2011 (differential flatness); Watterson and Kumar, "Control of quadrotors using the Hopf fibration on
SO(3)", ISRR 2017 (attitude without a singularity in level flight); Wang, Zhou, Xu and Gao,
"Geometrically constrained trajectory optimization for multicopters", 2022 (drag).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..arrays import NumberTuple
from ..specs import Real, declared
from .jets import Jet, squared_norm
from .motion import Motion
from .vehicle_base import (
    Measure,
    PointMass,
    Vehicle,
    VehicleSpec,
    components,
    constant,
    norm_measure,
    positive,
    root,
    sizes,
)

__all__ = ["DifferentialDrive", "Measure", "PointMass", "Quadrotor", "Vehicle", "VehicleSpec"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Quadrotor(Vehicle):
    """Quadrotor with limits on its thrust, tilt and body rates, through differential flatness.

    The thrust balances ``F = mass (a + gravity e₃) + drag v``; the body's axis has the direction of F.
    The attitude is the smallest rotation of the vertical to F, followed by the yaw about the body's
    axis (Hopf fibration). Without a yaw, the yaw is 0. The body rate is the norm of the whole
    angular velocity, with its component about the body's axis.

    Parameters
    ----------
    mass : float
        Mass, kg.
    thrust : tuple of float
        Smallest and largest collective thrust, N: ``0 <= low < mass gravity < high``.
    tilt : float, optional
        Largest angle between the body's axis and the vertical, rad, in (0, π/2).
    body_rate : float, optional
        Largest norm of the angular velocity, rad/s.
    drag : float
        Coefficient of the linear drag, kg/s.
    speed, acceleration : float, optional
        Largest norms of velocity (m/s) and acceleration (m/s²).
    yaw_rate : float, optional
        Largest absolute value of the rate of the yaw, rad/s.
    gravity : float
        Gravitational acceleration, m/s².

    Raises
    ------
    InvalidData
        A value is outside its range, or hovering is impossible within the limits of the thrust.
    """

    mass: float = declared(Real(0.0, strict=True, unit="kg"))
    thrust: tuple[float, float] = declared(NumberTuple((2,), unit="N"))
    tilt: float | None = positive("rad")
    body_rate: float | None = positive("rad/s")
    drag: float = declared(Real(0.0, unit="kg/s"), default=0.0)
    speed: float | None = positive("m/s")
    acceleration: float | None = positive("m/s²")
    yaw_rate: float | None = positive("rad/s")
    gravity: float = declared(Real(0.0, strict=True, unit="m/s²"), default=9.81)

    kind: ClassVar[str] = "quadrotor"
    axes: ClassVar[int | None] = 3

    def check(self) -> None:
        """Reject thrusts that make hovering impossible, and tilts of a right angle or more."""
        low, high = self.thrust
        weight = self.mass * self.gravity
        if low < 0:
            raise InvalidData(f"thrust[0] must be >= 0 N, got {low:g}", field="thrust")
        if not low < weight < high:
            raise InvalidData(
                f"thrust must enclose the weight mass * gravity = {weight:g} N, otherwise hovering "
                f"is impossible, got ({low:g}, {high:g})",
                field="thrust",
            )
        if self.tilt is not None and self.tilt >= math.pi / 2:
            raise InvalidData(f"tilt must be < pi/2 rad, got {self.tilt:g}", field="tilt")

    def force(self, motion: Motion) -> list[Jet]:
        """Return the series of the force F of the thrust, N."""
        pairs = zip(motion.velocity, motion.acceleration, strict=True)
        force = [
            acceleration * self.mass + velocity * self.drag for velocity, acceleration in pairs
        ]
        return [*force[:2], force[2] + self.mass * self.gravity]

    def _tilt(self, motion: Motion) -> Jet:
        """Return tan²(tilt / 2), which increases from 0 to infinity at the reversed vertical."""
        force = self.force(motion)
        return squared_norm(force[:2]) / (squared_norm(force).root() + force[2]).square()

    def _rates(self, motion: Motion) -> tuple[list[Jet], Jet]:
        """Return the rate of the body's axis and the angular velocity about it."""
        force = self.force(motion)
        size = squared_norm(force).root()
        axis = [component / size for component in force]
        turn = [component.rate() for component in axis]
        spin = (axis[1] * turn[0] - axis[0] * turn[1]) / (axis[2] + 1.0)
        return turn, spin if motion.turn is None else spin + motion.turn

    @property
    def measures(self) -> tuple[Measure, ...]:
        """Thrust, tilt, body rate, speed, acceleration and yaw rate."""
        low, high = self.thrust
        measures = norm_measure("thrust", "N", high, self.force, True)
        if low > 0:
            measures.append(
                Measure(
                    "lowest thrust", "N", low, lambda at: -squared_norm(self.force(at)), -(low**2),
                    lambda value: root(-value),
                    lambda at: [squared_norm(self.force(at)).root() - low], False, False,
                )
            )  # fmt: skip
        if self.tilt is not None:
            slope = math.tan(self.tilt)

            def cone(motion: Motion) -> list[Jet]:
                force = self.force(motion)
                return [force[2] * slope, *force[:2]]

            measures.append(
                Measure(
                    "tilt", "rad", self.tilt, self._tilt, math.tan(self.tilt / 2) ** 2,
                    lambda value: 2 * np.arctan(root(value)), cone, True,
                )
            )  # fmt: skip
        measures += norm_measure("body rate", "rad/s", self.body_rate, self._body_rates, False)
        measures += PointMass(self.speed, self.acceleration).measures
        measures += norm_measure("yaw rate", "rad/s", self.yaw_rate, self._yaw_rate, False)
        return tuple(measures)

    def _body_rates(self, motion: Motion) -> list[Jet]:
        """Return a vector whose norm is that of the angular velocity."""
        turn, spin = self._rates(motion)
        return [*turn, spin]

    def _yaw_rate(self, motion: Motion) -> list[Jet]:
        return [constant(motion, 0.0) if motion.turn is None else motion.turn]

    def _quantities(self, motion: Motion) -> dict[str, Floats]:
        (turn, spin), force = self._rates(motion), components(self.force(motion))
        size = np.linalg.norm(force, axis=1)
        z, dz = force / size[:, None], components(turn)
        yaw = motion.heading
        lean = dz[:, 2] / (1.0 + z[:, 2])
        across = z[:, 1] * lean - dz[:, 1]
        along = dz[:, 0] - z[:, 0] * lean
        c, s = np.cos(yaw), np.sin(yaw)
        rates = np.column_stack([c * across + s * along, c * along - s * across, spin.terms[0]])
        half = np.sqrt(2.0 * (1.0 + z[:, 2]))
        w, x, y = 0.5 * half, -z[:, 1] / half, z[:, 0] / half
        ch, sh = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
        attitude = np.column_stack([w * ch, x * ch + y * sh, y * ch - x * sh, w * sh])
        flat = np.hypot(force[:, 0], force[:, 1])
        return {
            "speed": sizes(motion.velocity),
            "acceleration": sizes(motion.acceleration),
            "thrust": size,
            "tilt": np.arctan2(flat, force[:, 2]),
            "body_rate": np.linalg.norm(rates, axis=1),
            "body_rates": rates,
            "attitude": attitude,
            "yaw": yaw,
            "yaw_rate": np.zeros(len(z)) if motion.turn is None else motion.turn.terms[0],
        }


@dataclass(frozen=True, eq=False)
class DifferentialDrive(Vehicle):
    """Robot on two driven wheels that moves forward along the tangent of its path.

    The speeds of the wheels are ``v ± ω track / 2`` with the speed v and the rate ω of the heading. At
    standstill they are the limit values along the path.

    Parameters
    ----------
    wheel_speed : float
        Largest absolute speed of a wheel over the ground, m/s.
    wheel_acceleration : float, optional
        Largest absolute acceleration of a wheel, m/s².
    track : float
        Distance between the wheels, m.

    Raises
    ------
    InvalidData
        A value is not positive.
    """

    wheel_speed: float = declared(Real(0.0, strict=True, unit="m/s"))
    wheel_acceleration: float | None = positive("m/s²")
    track: float = declared(Real(0.0, strict=True, unit="m"), default=None)  # required: None raises

    kind: ClassVar[str] = "differential-drive"
    axes: ClassVar[int | None] = 2
    follows_path: ClassVar[bool] = True

    def _wheel_speed(self, side: float, motion: Motion) -> list[Jet]:
        """Return the speed of the wheel on a side: 1 right, -1 left."""
        speed, turn = motion.course
        return [speed + turn * (0.5 * side * self.track)]

    def _wheel_acceleration(self, side: float, motion: Motion) -> list[Jet]:
        return [wheel.rate() for wheel in self._wheel_speed(side, motion)]

    @property
    def measures(self) -> tuple[Measure, ...]:
        """Speed and acceleration of both wheels, and the speed that follows: the mean of the wheels."""
        result = list(PointMass(speed=self.wheel_speed).measures)
        for word, side in (("left", -1.0), ("right", 1.0)):
            result += norm_measure(
                f"{word} wheel speed", "m/s", self.wheel_speed,
                partial(self._wheel_speed, side), False,
            )  # fmt: skip
            result += norm_measure(
                f"{word} wheel acceleration", "m/s²", self.wheel_acceleration,
                partial(self._wheel_acceleration, side), False,
            )  # fmt: skip
        return tuple(result)

    def _quantities(self, motion: Motion) -> dict[str, Floats]:
        speed, turn = motion.course
        left, right = (self._wheel_speed(side, motion)[0] for side in (-1.0, 1.0))
        return {
            "speed": speed.terms[0],
            "turn_rate": turn.terms[0],
            "heading": motion.heading,
            "wheel_speeds": np.column_stack([left.terms[0], right.terms[0]]),
            "wheel_accelerations": np.column_stack([left.terms[1], right.terms[1]]),
        }
