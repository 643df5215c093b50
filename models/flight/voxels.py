"""Maps of free and blocked cubes in three dimensions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ..declaration import Declared
from ..fields import Array, Real, declared, show
from ..grid_path.gridmap import enlarged, read_cells
from ..inputs import Field, FloatArray, Numbers

__all__ = ["MOST_VOXELS", "VoxelMap"]

Floats = NDArray[np.float64]
Truths = NDArray[np.bool_]

#: Maximum number of cells of a map.
MOST_VOXELS = 2**26
#: Distance, in cells, at which a point also blocks the neighbouring cell, against rounding.
_NEAR = 1e-9


class Voxels(Array):
    """Field of Boolean cells, also accepted as lines of text along z: one list of lines per x."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Truths:
        if isinstance(value, list | tuple) and value and isinstance(value[0], list | tuple):
            if value[0] and isinstance(value[0][0], str):
                value = _read(name, value)
        cells: Truths = super().coerce(name, value, sizes)
        return cells

    def encode(self, value: Truths) -> list[list[str]]:
        letters = np.where(value, "@", ".")
        lines: list[list[str]] = letters.view(f"U{value.shape[2]}")[..., 0].tolist()
        return lines


def _read(name: str, layers: Sequence[Any]) -> Truths:
    width = len(layers[0])
    for k, layer in enumerate(layers):
        fits = isinstance(layer, list | tuple) and len(layer) == width
        if not fits or not all(isinstance(line, str) for line in layer):
            raise InvalidData(
                f"{name}[{k}] must be a list of {width} lines as the first, got {show(layer)}",
                field=name,
            )
    cells = read_cells([line for layer in layers for line in layer], name)
    return cells.reshape(len(layers), width, -1)


@dataclass(frozen=True, eq=False, repr=False)
class VoxelMap(Declared):
    """Map of cubes, each free or blocked. Every position in a free cube is safe.

    The cube (i, j, k) covers x from ``origin[0] + i * cell`` to ``origin[0] + (i + 1) * cell``, and y and z
    in the same way with j and k. The region outside the map is blocked.

    Parameters
    ----------
    blocked : ndarray of bool, shape (nx, ny, nz)
        Cubes, true if blocked, at most 2**26. JSON data contains lines of text along z, with ``@`` for
        blocked and ``.`` for free, in one list of lines per x.
    cell : float, default 1
        Side of a cube in metres.
    origin : ndarray, shape (3,), default (0, 0, 0)
        Corner of the cube (0, 0, 0) with the lowest coordinates, in metres.

    Raises
    ------
    InvalidData
        The map has no free cube, is too large or too fine for its coordinates, or a number is not finite.
        The message names the field.
    """

    blocked: Field[Numbers | Sequence[Sequence[str]], Truths] = declared(
        Voxels(("nx", "ny", "nz"), bool)
    )
    cell: float = declared(Real(lower=0, strict=True, unit="m"), default=1.0)
    origin: FloatArray = declared(Array((3,), unit="m"), default=(0.0, 0.0, 0.0))

    def check(self) -> None:
        """Raise if no cube is free, or the map is too large or too fine for its coordinates."""
        if not 0 < self.blocked.size <= MOST_VOXELS or self.blocked.all():
            raise InvalidData(
                f"blocked must have at most {MOST_VOXELS} cubes and at least one that is free, got "
                f"{' × '.join(map(str, self.shape))} with {int((~self.blocked).sum())} free",
                field="blocked",
            )
        corner = np.abs(self.origin).max() + self.cell * max(self.shape)
        if not np.isfinite(corner) or self.cell < 1e-9 * corner:
            raise InvalidData(
                f"cell must be large enough to tell cubes at {corner:g} m apart, got {self.cell:g} m",
                field="cell",
            )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of cubes along x, y and z."""
        nx, ny, nz = self.blocked.shape
        return nx, ny, nz

    def centres(self, cubes: ArrayLike) -> Floats:
        """Return the centres, m, shape (..., 3), of cubes (i, j, k), shape (..., 3)."""
        points: Floats = self.origin + (np.asarray(cubes, float) + 0.5) * self.cell
        return points

    def cells_of(self, points: ArrayLike) -> NDArray[np.int64]:
        """Return the cubes (i, j, k), shape (..., 3), that contain points, possibly outside the map.

        A point on a face belongs to the cube with the greater index.
        """
        steps = np.floor((np.asarray(points, float) - self.origin) / self.cell)
        return np.asarray(steps).astype(np.int64)

    def holds(self, cubes: ArrayLike) -> Truths:
        """Return whether each cube (i, j, k), shape (..., 3), is free and inside the map."""
        indices = np.asarray(cubes, np.int64)
        inside = np.asarray(((indices >= 0) & (indices < self.shape)).all(axis=-1))
        safe = np.where(inside[..., None], indices, 0)
        return np.asarray(inside & ~self.blocked[safe[..., 0], safe[..., 1], safe[..., 2]])

    @classmethod
    def from_points(
        cls, points: ArrayLike, cell: float, bounds: ArrayLike | None = None, radius: float = 0.0
    ) -> VoxelMap:
        """Return the map that blocks every cube with a point.

        A point nearer than 1e-9 cells to a face blocks the cubes on both sides. With a radius, the map
        is :meth:`inflated` afterwards.

        Parameters
        ----------
        points : array-like, shape (n, 3)
            Points on obstacles, m.
        cell : float
            Side of a cube, m.
        bounds : array-like, shape (6,), optional
            Lowest x, y, z and greatest x, y, z, m. The map covers them with whole cubes. By default the
            bounds of the points. Points outside are ignored.
        radius : float, default 0
            Radius of the vehicle, m.

        Raises
        ------
        InvalidData
            An argument is invalid, points and bounds are both missing, or the map is too large.
        """
        cloud = Array(("n", 3)).coerce("points", points, {})
        side = Real(lower=0, strict=True, unit="m").coerce("cell", cell, {})
        if bounds is None and not len(cloud):
            raise InvalidData("bounds must be given if points is empty", field="bounds")
        ends = (
            Array((6,)).coerce("bounds", bounds, {}).reshape(2, 3)
            if bounds is not None
            else np.stack([cloud.min(axis=0), cloud.max(axis=0)])
        )
        with np.errstate(all="ignore"):  # the check below rejects results of an overflow
            extent = (ends[1] - ends[0]) / side
            counts = np.maximum(np.ceil(extent - _NEAR), 1.0)
            if not (extent >= 0).all() or not counts.prod() <= MOST_VOXELS:
                raise InvalidData(
                    "bounds must be lowest x, y, z and greatest x, y, z with at most "
                    f"{MOST_VOXELS} cubes of {side:g} m, got {show(ends.ravel().tolist())}",
                    field="bounds" if bounds is not None else "cell",
                )
        blocked = np.zeros(counts.astype(int), bool)
        steps = (cloud - ends[0]) / side
        steps = steps[((steps >= -_NEAR) & (steps <= counts + _NEAR)).all(axis=1)]
        for signs in product((-_NEAR, _NEAR), repeat=3):
            index = np.floor(steps + np.array(signs)).astype(np.int64)
            index = index[((index >= 0) & (index < blocked.shape)).all(axis=1)]
            blocked[tuple(index.T)] = True
        return cls(blocked, side, ends[0]).inflated(radius)

    def inflated(self, radius: float) -> VoxelMap:
        """Return the map for a spherical vehicle, with cubes nearer than `radius` to a blocked one blocked.

        The distance of two cubes is the distance of their nearest points, compared by exact arithmetic. The
        vehicle's centre is therefore safe everywhere in a free cube. The outside of the map bounds the
        centre; it is not a wall.

        Parameters
        ----------
        radius : float
            Radius of the vehicle, m.

        Raises
        ------
        InvalidData
            The radius is invalid, or no cube remains free.
        """
        reach = Real(lower=0, unit="m").coerce("radius", radius, {})
        if reach == 0 or not self.blocked.any():
            return self
        return replace(self, blocked=enlarged(self.blocked, Fraction(reach) / Fraction(self.cell)))

    def __repr__(self) -> str:
        size = " × ".join(map(str, self.shape))
        return f"<VoxelMap {size} cubes of {self.cell:g} m, {self.blocked.mean():.0%} blocked>"
