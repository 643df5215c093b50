"""Seeded instances of messenger tours, of the sizes and the sparsity of the paper's.

Only ``Generator.random`` is drawn from, and what is computed of it is rounded, so that a seed means
the same vehicles wherever it is used.
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

#: Vehicles that an instance may have: the sparsity takes every pair of them.
MOST = 10_000
#: Digits of the square's side, and of velocities below the UAV's speed: fewer than sums and sines of
#: different machines agree in.
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
    """Return an open tour over vehicles that begin uniformly in a square, with the UAV in its corner.

    The square is scaled to the sparsity that is asked for. Headings of vehicles are uniform, speeds
    uniform up to `fastest`; the UAV begins at (0, 0) and flies in the direction of y.

    Parameters
    ----------
    vehicles : int
        Their number, at least 2.
    sparsity : float
        κ_P, the mean distance of two vehicles less twice the radius, by the turning radius. It may be
        negative, as long as that mean distance is > 0.
    seed : int
        Same seed, same vehicles.
    radius : float
        How near the UAV must come to each, m (paper: r_com).
    turning_radius : float
        m, > 0: the sparsity is measured in it (paper: r_min).
    speed : float
        Of the UAV, m/s (paper: v_A).
    fastest : float
        Speed that no vehicle reaches, m/s, below `speed`; 0 leaves all at rest.
    name : str
        Of the model.

    Returns
    -------
    MessengerTour
        Its ``sparsity`` is the given one to 9 digits.

    Raises
    ------
    InvalidData
        Fewer than 2 vehicles, no finite number, a sparsity that no square has.
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
            f"sparsity must be > {-2.0 * near / turning:g}, where all vehicles stand in one place, "
            f"and leave their distance finite; got {sparsity!r}",
            field="sparsity",
        )
    unit = rng.random((count, 2))
    side = float(_rounded(mean / pdist(unit).mean(), mean, _SIDE))
    headings, speeds = 2.0 * np.pi * rng.random(count), fastest * rng.random(count)
    velocities = speeds[:, None] * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    data = {
        "positions": side * unit,
        "velocities": _rounded(velocities, speed, _VELOCITY),
        "radius": near,
        "speed": speed,
        "turning_radius": turning,
    }
    return MessengerTour.from_data(data, name=name)


def _rounded(value: ArrayLike, size: float, digits: int) -> Any:
    """Return `value` with as many digits, counted from the first of `size`."""
    return np.round(np.asarray(value), digits - 1 - math.floor(math.log10(size)))
