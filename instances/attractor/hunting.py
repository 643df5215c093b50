"""Equations of a multirobot hunt: predators pursue an evader among round obstacles, from a random start.

The paper records the orbit of a robot in such a hunt. It prints neither the record nor equations of motion,
so these equations are ours. They are smooth and do not depend on time, so the motion has a largest exponent.
:func:`~crosstrack.instances.attractor.motions.largest_exponent` computes it as a reference for estimates.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.attractor.model import LEAST, MOST, AttractorAnalysis
from ...models.declaration import Declared
from ...models.fields import Array, Optional, Real, Whole, declared, required
from .motions import HUNT, Growth, Motion, largest_exponent, orbit

__all__ = ["Hunt", "hunt_exponent", "hunt_states", "simulate_hunt"]

Floats = NDArray[np.float64]

#: Largest numbers of predators and obstacles, and shortest step of the integration, s.
_PREDATORS, _OBSTACLES, _SHORTEST = 20, 50, 1e-4
#: Step as a share of the time that the fastest bodies need to turn before each other.
_SHARE = 0.25
#: Number of random places that are tried for a body.
_TRIES = 1000
#: Initial time that is discarded until the motion is on its attractor, times thrust.
_TRANSIENT = 450.0


@dataclass(frozen=True, eq=False)
class Hunt(Declared):
    """Predators, an evader and obstacles on a rectangle, and the forces between them.

    Each body is a disc of mass 1. Thrust accelerates a body below its usual speed and slows it above,
    ``thrust (1 - v²/speed²) v``. Walls, obstacles and other bodies at a gap g repel it by ``barrier / g²``,
    so that bodies never touch. The evader at a distance r attracts a predator by
    ``gain r / √(r² + reach²)``, and each predator repels the evader by ``flight r / (r² + reach²)``.

    Parameters
    ----------
    arena : ndarray, shape (2,)
        Width and height, m; the lower left corner is at (0, 0).
    obstacles : ndarray, shape (k, 3)
        Centres and radii, m.
    gains : ndarray, shape (p,)
        Attraction of each predator, m/s²; the length is the number of predators.
    flight : float
        Repulsion of the evader, m²/s².
    reach : float
        Distance below which both forces become weaker, m.
    thrust : float
        Rate at which bodies approach their usual speed, 1/s.
    speeds : ndarray, shape (2,)
        Usual speed of predators and of the evader, m/s.
    radius : float
        Radius of every body, m.
    barrier : float
        Strength of the repulsion between bodies, m³/s².
    seed : int
        Random seed of the initial places and speeds.

    Raises
    ------
    InvalidData
        A value is outside its range, an obstacle is outside the arena, the speeds are too high for the
        barrier, or the arena has no room to start. The message gives field and value.
    """

    arena: Floats = declared(Array((2,), lower=0, upper=1e4), default=(10.0, 10.0))
    obstacles: Floats = declared(
        Array(("k", 3), lower=0, upper=1e4),
        default=((3.0, 3.0, 0.8), (7.0, 4.0, 0.7), (5.0, 7.5, 0.9)),
    )
    gains: Floats = declared(Array(("p",), lower=0, upper=1e3), default=(0.02, 0.03, 0.04))
    flight: float = declared(Real(0, 1e3), default=0.04)
    reach: float = declared(Real(1e-3, 1e3, unit="m"), default=1.0)
    thrust: float = declared(Real(1e-3, 1e3, unit="1/s"), default=0.45)
    speeds: Floats = declared(Array((2,), lower=1e-3, upper=1e3), default=(0.22, 0.22))
    radius: float = declared(Real(0, 1e3, unit="m"), default=0.15)
    barrier: float = declared(Real(1e-9, 1e3), default=0.004)
    seed: int = declared(Whole(0), default=0)

    def check(self) -> None:
        """Reject hunts without predators or room, and hunts that need too short a step."""
        if not 1 <= len(self.gains) <= _PREDATORS:
            raise InvalidData(
                f"gains must be those of 1 … {_PREDATORS} predators, got {len(self.gains)}",
                field="gains",
            )
        if len(self.obstacles) > _OBSTACLES:
            raise InvalidData(
                f"obstacles must be at most {_OBSTACLES}, got {len(self.obstacles)}",
                field="obstacles",
            )
        outside = np.flatnonzero((self.obstacles[:, :2] > self.arena).any(axis=1))
        if len(outside):
            raise InvalidData(
                f"obstacles[{outside[0]}] must have its middle in the arena of {self.arena.tolist()} m, got "
                f"{self.obstacles[outside[0], :2].tolist()}",
                field="obstacles",
            )
        if not self.step >= _SHORTEST:
            raise InvalidData(
                f"barrier must be stronger, or speeds and forces less: bodies that come at {self.fastest:.3g} m/s "
                f"turn before each other within {self.step / _SHARE:.3g} s",
                field="barrier",
            )
        self.motion  # noqa: B018 - raises an error if the arena is full

    @property
    def fastest(self) -> float:
        """Speed that results from thrust and forces, m/s, without the barriers."""
        pulls = float(self.gains.max()), len(self.gains) * self.flight / (2.0 * self.reach)
        return max(
            float(speed) + pull / (2.0 * self.thrust)
            for speed, pull in zip(self.speeds, pulls, strict=True)
        )

    @property
    def step(self) -> float:
        """Step of the integration, s: a share of the time that two bodies need to turn before each other."""
        speed = self.fastest
        return _SHARE * min(self.barrier / speed**3, 1.0 / self.thrust)

    @cached_property
    def motion(self) -> Motion:
        """Equations of motion with random initial places and speeds."""
        shared = [
            *(len(self.gains), len(self.obstacles), *self.arena, self.radius, self.barrier),
            *(self.flight, self.reach, self.thrust, *self.speeds),
        ]
        constants = np.concatenate([shared, self.gains, self.obstacles.ravel()])
        return Motion(HUNT, constants, self._start(), self.step, _TRANSIENT / self.thrust)

    def gaps(self, places: Floats) -> Floats:
        """Return the smallest gap around any body at each time, m.

        Parameters
        ----------
        places : ndarray, shape (n, bodies, 2)
            Places of the bodies, m.

        Returns
        -------
        ndarray, shape (n,)
            Smallest gap between bodies, and between bodies and walls or obstacles; negative if they overlap.
        """
        smallest: Floats = np.minimum(places, self.arena - places).min(axis=(1, 2)) - self.radius
        for x, y, radius in self.obstacles.tolist():
            apart = np.hypot(places[..., 0] - x, places[..., 1] - y) - radius - self.radius
            smallest = np.minimum(smallest, apart.min(axis=1))
        for i, j in combinations(range(places.shape[1]), 2):
            apart = np.hypot(*(places[:, i] - places[:, j]).T) - 2.0 * self.radius
            smallest = np.minimum(smallest, apart)
        return smallest

    def _start(self) -> Floats:
        rng = np.random.default_rng(self.seed)
        # At this distance, the energy of the barrier is a quarter of that of a moving body.
        margin = 4.0 * self.barrier / self.fastest**2
        places: list[Floats] = []
        for _ in range(len(self.gains) + 1):
            for _ in range(_TRIES):
                place = self.arena * rng.random(2)
                if self.gaps(np.array([[*places, place]]))[0] > margin:
                    places.append(place)
                    break
            else:
                raise InvalidData(
                    f"arena must have room for {len(self.gains) + 1} bodies that are {margin:.3g} m off each other, "
                    f"the walls and the obstacles, got {self.arena.tolist()} m",
                    field="arena",
                )
        speeds = np.repeat(self.speeds, [len(self.gains), 1])[:, None]
        drawn: Floats = speeds * (rng.random((len(places), 2)) - 0.5)
        return np.hstack([np.array(places), drawn]).ravel()


def hunt_states(hunt: Hunt, count: int, period: float = 1.0) -> Floats:
    """Return the places (m) and speeds (m/s) of the bodies, shape (count, bodies, 4), the evader last.

    Samples are `period` seconds apart. Raise InvalidData if a body is at an unreachable place, because the
    integration is not accurate enough.
    """
    required("hunt", hunt, Hunt)
    count = Whole(1, MOST).coerce("count", count, {})
    period = Real(0, strict=True, unit="s").coerce("period", period, {})
    states = orbit(hunt.motion, count, period).reshape(count, -1, 4)
    if not (np.isfinite(states).all() and hunt.gaps(states[..., :2]).min() > 0):
        raise InvalidData(
            f"barrier must be stronger, got {hunt.barrier:g}: steps of {hunt.step:.3g} s are too long for it",
            field="barrier",
        )
    return states


def simulate_hunt(
    hunt: Hunt,
    count: int = 1000,
    *,
    period: float = 1.0,
    robot: int = 0,
    axis: int = 0,
    exponent: float | None = None,
    name: str = "",
) -> AttractorAnalysis:
    """Return a coordinate of one robot of a hunt over time, as the paper records it.

    Parameters
    ----------
    hunt : Hunt
        The hunt.
    count : int
        Number of samples.
    period : float
        Seconds between samples.
    robot : int
        Number of the robot: predators in order, then the evader.
    axis : int
        0 for x, 1 for y.
    exponent : float, optional
        Largest exponent in nats per second, from ``hunt_exponent``. Hidden from backends.
    name : str
        Name of the model.

    Raises
    ------
    InvalidData
        The hunt has no such robot, or a number is not allowed; the message gives its name.
    """
    required("hunt", hunt, Hunt)
    count = Whole(LEAST, MOST).coerce("count", count, {})
    robot = Whole(0, len(hunt.gains)).coerce("robot", robot, {})
    axis = Whole(0, 1).coerce("axis", axis, {})
    known = Optional(Real()).coerce("exponent", exponent, {})
    return AttractorAnalysis(
        hunt_states(hunt, count, period)[:, robot, axis],
        period,
        "m",
        true_exponent=known,
        chaotic=None if known is None else known > 0,
        name=name,
    )


def hunt_exponent(hunt: Hunt, duration: float = 20_000.0, interval: float = 5.0) -> Growth:
    """Return the largest Lyapunov exponent of a hunt, from its equations.

    The motion of `duration` seconds is normalised each `interval`, see
    :func:`~crosstrack.instances.attractor.motions.largest_exponent`.
    """
    return largest_exponent(required("hunt", hunt, Hunt).motion, duration, interval)
