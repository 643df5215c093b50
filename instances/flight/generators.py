"""Seeded random maps in three dimensions: forests of pillars and rings, and fractal noise.

The maps resemble those on which GCOPTER (Wang, Zhou, Xu, Gao 2022) and other planners of quadrotors are
shown. The functions use only ``Generator.random`` and ``Generator.integers`` and round computed numbers, so
that a seed yields the same map on every platform. Random maps in two dimensions are in
:mod:`crosstrack.instances.grid_path`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ...models.fields import Array, Real, Whole, show
from ...models.flight import VoxelMap
from ..seeds import seeded

__all__ = ["forest", "noise_map"]

Floats = NDArray[np.float64]
Truths = NDArray[np.bool_]

#: Maximum number of cubes, of pillars and rings, and of octaves.
_CUBES, _SOLIDS, _OCTAVES = 2**26, 100_000, 16
#: Limits on the radii of rings, relative to the height of the map, and on that of their tubes, in cells.
_RINGS, _TUBE = (0.15, 0.4), 1.0
#: Decimal digits of computed numbers.
_DIGITS = 9


def forest(
    seed: int = 0,
    size: ArrayLike = (50.0, 50.0, 5.0),
    cell: float = 0.25,
    *,
    pillars: int = 120,
    rings: int = 30,
    width: ArrayLike = (0.5, 1.8),
    keep: ArrayLike = (),
    gap: float = 1.5,
) -> VoxelMap:
    """Return a map of vertical round pillars of full height and of rings in any direction.

    Parameters
    ----------
    seed : int
        Seed of the map. Equal seeds give equal maps.
    size : array-like, shape (3,)
        Sides of the map, m, from the origin. They are rounded up to whole cubes.
    cell : float
        Side of a cube, m.
    pillars, rings : int
        Their numbers.
    width : array-like, shape (2,)
        Least and greatest diameter of pillars, m.
    keep : array-like, shape (k, 3)
        Points with free space around them, m.
    gap : float
        Radius of the free space around those points, m.

    Raises
    ------
    InvalidData
        An argument is invalid, or no cube is free.
    """
    rng, axes = seeded(seed), _axes(size, cell)
    least, greatest = Array((2,), lower=0).coerce("width", width, {})
    if not least <= greatest:
        raise InvalidData(f"width must be least and greatest, got {show(width)}", field="width")
    ends = np.array([axis[-1] + axis[0] for axis in axes])
    blocked = np.zeros([len(axis) for axis in axes], bool)
    x, y, z = np.ix_(*axes)
    for _ in range(Whole(0, _SOLIDS).coerce("pillars", pillars, {})):
        place = rng.random(2) * ends[:2]
        radius = 0.5 * (least + (greatest - least) * float(rng.random()))
        # A pillar blocks at least the cubes around its axis.
        reach = max(radius, 0.75 * cell)
        part = _around(axes[:2], place, reach)
        square = (x[part[0]] - place[0]) ** 2 + (y[:, part[1]] - place[1]) ** 2
        blocked[part] |= np.round(square, _DIGITS) <= reach**2
    for _ in range(Whole(0, _SOLIDS).coerce("rings", rings, {})):
        place, direction = rng.random(3) * ends, 2.0 * rng.random(3) - 1.0
        direction /= max(float((direction**2).sum()) ** 0.5, 1e-9)
        radius = ends[2] * (_RINGS[0] + (_RINGS[1] - _RINGS[0]) * float(rng.random()))
        i, j, k = _around(axes, place, radius + 2.0 * _TUBE * cell)
        steps = [x[i] - place[0], y[:, j] - place[1], z[:, :, k] - place[2]]
        height = sum(step * part for step, part in zip(steps, direction.tolist(), strict=True))
        square = steps[0] ** 2 + steps[1] ** 2 + steps[2] ** 2
        away = np.sqrt(np.maximum(square - height**2, 0.0)) - radius
        blocked[i, j, k] |= np.round(height**2 + away**2, _DIGITS) <= (_TUBE * cell) ** 2
    return _map(blocked, axes, cell, keep, gap)


def noise_map(
    seed: int = 0,
    size: ArrayLike = (50.0, 50.0, 5.0),
    cell: float = 0.25,
    *,
    fill: float = 0.15,
    wavelength: float = 5.0,
    octaves: int = 2,
    keep: ArrayLike = (),
    gap: float = 1.5,
) -> VoxelMap:
    """Return a map of smooth random blobs: the cubes with the greatest values of fractal noise.

    Parameters
    ----------
    seed, size, cell, keep, gap
        See :func:`forest`.
    fill : float
        Share of blocked cubes before the points are kept free, less than 1.
    wavelength : float
        Distance of the random values of the first octave, m. Distance and amplitude halve with each octave.
    octaves : int
        Number of octaves.

    Raises
    ------
    InvalidData
        An argument is invalid, or no cube is free.
    """
    rng, axes = seeded(seed), _axes(size, cell)
    share = Real(lower=0, upper=0.99).coerce("fill", fill, {})
    wave = Real(lower=0, strict=True, unit="m").coerce("wavelength", wavelength, {})
    values = np.zeros([len(axis) for axis in axes])
    for octave in range(Whole(1, _OCTAVES).coerce("octaves", octaves, {})):
        values += _noise(rng, axes, max(wave / 2**octave, cell)) / 2**octave
    order = np.argsort(-np.round(values, _DIGITS), axis=None, kind="stable")
    blocked = np.zeros(values.shape, bool)
    blocked.flat[order[: int(share * values.size)]] = True
    return _map(blocked, axes, cell, keep, gap)


def _axes(size: ArrayLike, cell: float) -> list[Floats]:
    """Return the coordinates of the centres of cubes along each axis, m."""
    sides = Array((3,), unit="m").coerce("size", size, {})
    side = Real(lower=0, strict=True, unit="m").coerce("cell", cell, {})
    with np.errstate(over="ignore"):
        counts = np.ceil(sides / side - 1e-9)
    if not (counts.min() >= 1 and counts.prod() <= _CUBES):
        raise InvalidData(
            f"size must give 1 … {_CUBES} cubes of {side:g} m, got {show(sides.tolist())}",
            field="size",
        )
    return [np.asarray((np.arange(int(count)) + 0.5) * side) for count in counts]


def _around(axes: list[Floats], place: Floats, reach: float) -> tuple[slice, ...]:
    """Return the indices of cubes within a distance of a point along each axis."""
    return tuple(
        slice(*np.searchsorted(axis, [at - reach, at + reach]).tolist())
        for axis, at in zip(axes, place.tolist(), strict=True)
    )


def _noise(rng: np.random.Generator, axes: list[Floats], wave: float) -> Floats:
    """Return random values at the nodes of a lattice, interpolated smoothly at the centres of cubes."""
    values = rng.random([int(axis[-1] / wave) + 2 for axis in axes])
    for k, axis in enumerate(axes):
        first = (axis / wave).astype(int)
        share = axis / wave - first
        share = (share * share * (3.0 - 2.0 * share)).reshape(
            [-1 if j == k else 1 for j in range(3)]
        )
        values = values.take(first, k) * (1.0 - share) + values.take(first + 1, k) * share
    return values


def _map(blocked: Truths, axes: list[Floats], cell: float, keep: ArrayLike, gap: float) -> VoxelMap:
    """Return the map with free space around points."""
    space = Real(lower=0, unit="m").coerce("gap", gap, {})
    for point in Array(("k", 3)).coerce("keep", keep, {}):
        part = _around(axes, point, space)
        grids = np.ix_(*(axis[s] - at for axis, s, at in zip(axes, part, point, strict=True)))
        blocked[part] &= np.round(sum(grid**2 for grid in grids), _DIGITS) > space**2
    return VoxelMap(blocked, cell)
