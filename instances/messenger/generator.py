"""Seeded instances of messenger tours, with the sizes and the sparsity of the paper's instances.

All random numbers come from ``Generator.random``, and derived values are rounded, so that a seed
yields the same vehicles on every machine.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.distance import pdist

from ...errors import InvalidData
from ...models.fields import Real, Whole
from ...models.messenger.model import MessengerTour

__all__ = ["generate"]

#: Maximum number of vehicles: the sparsity takes quadratic time and memory.
MOST = 10_000
#: Significant digits of the square's side, and of velocities relative to the UAV's speed: fewer
#: than
#: the digits on which sums and sines of different machines agree.
_SIDE, _VELOCITY = 12, 9


def generate(
    vehicles: int,
    sparsity: float,
    seed: int,
    *,
    radius: float = 5.0,
    turning_radius: float = 5.0,
    speed: float = 10.0,
    fastest: float = 3.5,
    name: str = "",
) -> MessengerTour:
    """Return an open tour over vehicles that begin uniformly in a square, with the UAV at its corner.

    The square is scaled to the given sparsity. Headings of vehicles are uniform, and speeds uniform
    up to `fastest`. The UAV begins at (0, 0) and flies in the direction of y.

    Parameters
    ----------
    vehicles : int
        Number of vehicles, 2 to 10,000.
    sparsity : float
        κ_P: mean distance of two vehicles minus twice the radius, divided by the turning radius. It
        may be negative, as long as the mean distance is positive.
    seed : int
        Seed, at least 0. The same seed yields the same vehicles.
    radius : float
        Largest distance at an encounter, in m (paper: r_com).
    turning_radius : float
        Turning radius, in m, > 0: it is the unit of the sparsity (paper: r_min).
    speed : float
        Speed of the UAV, in m/s (paper: v_A).
    fastest : float
        Strict upper limit on the speed of the vehicles, in m/s, below `speed`; 0 for vehicles at
        rest.
    name : str
        Name of the model.

    Returns
    -------
    MessengerTour
        Model whose ``sparsity`` equals the given value to 9 digits.

    Raises
    ------
    InvalidData
        Fewer than 2 vehicles, a value that is not a finite number, or an infeasible sparsity.
    """
    count = Whole(2, MOST).coerce("vehicles", vehicles, {})
    sparsity = Real().coerce("sparsity", sparsity, {})
    rng = np.random.default_rng(Whole(0).coerce("seed", seed, {}))
    turning = Real(lower=0, strict=True).coerce("turning_radius", turning_radius, {})
    near = Real(lower=0).coerce("radius", radius, {})
    fastest = Real(lower=0).coerce("fastest", fastest, {})
    mean = sparsity * turning + 2.0 * near
    if not 0 < mean < math.inf:
        raise InvalidData(
            f"sparsity must be > {-2.0 * near / turning:g}, at which all vehicles are in one place, "
            f"and leave their distance finite; got {sparsity!r}",
            field="sparsity",
        )
    unit = rng.random((count, 2))
    side = float(_round(mean / pdist(unit).mean(), mean, _SIDE))
    headings, speeds = 2.0 * np.pi * rng.random(count), fastest * rng.random(count)
    velocities = speeds[:, None] * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    data = {
        "positions": side * unit,
        "velocities": _round(velocities, speed, _VELOCITY),
        "radius": near,
        "speed": speed,
        "turning_radius": turning,
    }
    return MessengerTour.from_data(data, name=name)


def _round(value: ArrayLike, size: float, digits: int) -> Any:
    """Return `value` rounded to `digits` digits, counted from the first digit of `size`."""
    return np.round(np.asarray(value), digits - 1 - math.floor(math.log10(size)))
