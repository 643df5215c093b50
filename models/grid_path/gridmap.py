"""Grid maps of free and blocked cells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ..declaration import Declared
from ..fields import Array, Flag, Real, declared, show
from ..inputs import Field, FloatArray, Numbers
from .polygons import Polygons, as_shapely
from .raster import SHRINK, rasterise

__all__ = ["BLOCKED", "FREE", "MOST", "GridMap", "enlarged", "read_cells"]

Floats = NDArray[np.float64]
Truths = NDArray[np.bool_]

#: Characters of free and blocked cells on output. Input also accepts the equivalents of MovingAI's maps.
FREE, BLOCKED = ".", "@"
_FREE, _BLOCKED = ".G", "@OTW#"
#: Maximum number of cells of a map.
MOST = 2**26
#: Distance in cells that exceeds the size of every map.
_FARTHEST = 1e9


class Cells(Array):
    """Field of Boolean cells, also accepted as lines of text with one character per cell; written as lines."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Truths:
        if isinstance(value, str):
            value = value.splitlines()
        if isinstance(value, list | tuple) and value and all(isinstance(x, str) for x in value):
            value = read_cells(value, name)
        cells: Truths = super().coerce(name, value, sizes)
        return cells

    def encode(self, value: Truths) -> list[str]:
        letters = np.where(value, BLOCKED, FREE)
        lines: list[str] = letters.view(f"U{value.shape[1]}")[:, 0].tolist()
        return lines


def read_cells(
    lines: Sequence[str], where: str = "blocked", first: tuple[int, int] = (0, 0), free: str = _FREE
) -> Truths:
    """Return which cells of a map are blocked, from lines of text with one character per cell.

    Messages name `where`, such as a file, and count lines and characters from `first`. A character that is unknown, and
    lines of different length, raise ``InvalidData``. `free` are the characters of free cells.
    """
    width = len(lines[0]) if lines else 0
    for number, line in enumerate(lines, first[0]):
        if len(line) != width:
            raise InvalidData(
                f"{where}, line {number} must have {width} cells as the first, got {len(line)}",
                field="blocked",
            )
    _require_few(where, len(lines) * width)
    letters = np.frombuffer("".join(lines).encode("utf-32-le", "surrogatepass"), np.uint32)
    letters = letters.reshape(len(lines), width)
    blocked = np.isin(letters, list(map(ord, _BLOCKED)))
    strange = ~(blocked | np.isin(letters, list(map(ord, free))))
    if strange.any():
        row, column = np.argwhere(strange)[0].tolist()
        raise InvalidData(
            f"{where}, line {row + first[0]}, column {column + first[1]} must be one of "
            f"{' '.join(free)} (free) or {' '.join(_BLOCKED)} (blocked), got "
            f"{show(lines[row][column])}",
            field="blocked",
        )
    return blocked


def _require_few(where: str, cells: int) -> None:
    if cells > MOST:
        raise InvalidData(f"{where} must have at most {MOST} cells, got {cells}", field="blocked")


def enlarged(blocked: Truths, reach: float | Fraction) -> Truths:
    """Return the blocked cells and those nearer than `reach` cells to one, compared by exact arithmetic.

    The distance of two cells is that of their nearest points. There may be any number of axes.
    """
    from scipy.ndimage import distance_transform_edt

    if reach == 0 or not blocked.any():
        return blocked
    # The nearest points of two cells of the same lattice are corners.
    corners = np.ones(np.add(blocked.shape, 1), bool)
    windows = [
        tuple(slice(s, s + n) for s, n in zip(shift, blocked.shape, strict=True))
        for shift in np.ndindex((2,) * blocked.ndim)
    ]
    for window in windows:
        corners[window] &= ~blocked
    limit = math.ceil(Fraction(min(reach, _FARTHEST)) ** 2)
    near = np.rint(distance_transform_edt(corners) ** 2) < limit
    return np.asarray(np.logical_or.reduce([blocked, *(near[window] for window in windows)]))


@dataclass(frozen=True, eq=False, repr=False)
class GridMap(Declared):
    """Map of square cells, each free or blocked. Every position in a free cell is safe.

    The cell in row r and column c covers x from ``origin[0] + c * cell`` to ``origin[0] + (c + 1) * cell``,
    and y from ``origin[1] + r * cell`` to ``origin[1] + (r + 1) * cell``. The region outside the map is
    blocked.

    Parameters
    ----------
    blocked : ndarray of bool, shape (rows, columns), or lines of text
        Cells, true if blocked, at most 2**26. In text, ``.`` and ``G`` are free, ``@``, ``O``, ``T``, ``W``
        and ``#`` are blocked, and the first line is row 0.
    cell : float, default 1
        Side of a cell in metres.
    origin : ndarray, shape (2,), default (0, 0)
        Corner of the cell in row 0 and column 0 with the lowest x and y, in metres.
    upward : bool, default False
        Whether plots draw y upward, as for terrain. Otherwise row 0 is at the top, as in text and images.

    Raises
    ------
    InvalidData
        The lengths of lines differ, a character is unknown, no cell is free, the map is too large, or a
        number is not finite. The message names the field.
    """

    blocked: Field[Numbers | Sequence[str], Truths] = declared(Cells(("rows", "columns"), bool))
    cell: float = declared(Real(lower=0, strict=True, unit="m"), default=1.0)
    origin: FloatArray = declared(Array((2,), unit="m"), default=(0.0, 0.0))
    upward: bool = declared(Flag(), default=False)

    def check(self) -> None:
        """Raise if no cell is free, or the map is too large or too fine for its coordinates."""
        _require_few("blocked", self.blocked.size)
        if self.blocked.all():
            raise InvalidData(
                f"blocked must leave at least one cell free, got {self.shape[0]} × {self.shape[1]} "
                "cells of which none is",
                field="blocked",
            )
        corner = np.abs(self.origin).max() + self.cell * max(self.shape)
        if not np.isfinite(corner) or self.cell < 1e-9 * corner:
            raise InvalidData(
                f"cell must be large enough to tell cells at {corner:g} m apart, got {self.cell:g} m",
                field="cell",
            )

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        rows, columns = self.blocked.shape
        return rows, columns

    @cached_property
    def walls(self) -> NDArray[np.uint8]:
        """Flat map with a frame of blocked cells, 1 if blocked, for the search kernels."""
        framed = np.pad(self.blocked, 1, constant_values=True).astype(np.uint8).ravel()
        framed.flags.writeable = False
        return framed

    def numbers_of(self, cells: ArrayLike) -> NDArray[np.int64]:
        """Return the indices in :attr:`walls`, shape (...), of cells (row, column), shape (..., 2)."""
        framed = np.asarray(cells, np.int64) + 1
        return np.asarray(framed[..., 0] * (self.shape[1] + 2) + framed[..., 1])

    def cells_at(self, numbers: ArrayLike) -> NDArray[np.int64]:
        """Return the cells (row, column), shape (..., 2), of indices in :attr:`walls`."""
        return np.stack(np.divmod(np.asarray(numbers, np.int64), self.shape[1] + 2), axis=-1) - 1

    def centres(self, cells: ArrayLike) -> Floats:
        """Return the centres of cells.

        Parameters
        ----------
        cells : array-like of int, shape (..., 2)
            Rows and columns.

        Returns
        -------
        ndarray, shape (..., 2)
            Centres x, y, m.
        """
        rows_columns = np.asarray(cells, float)
        points: Floats = self.origin + (rows_columns[..., ::-1] + 0.5) * self.cell
        return points

    def cells_of(self, points: ArrayLike) -> NDArray[np.int64]:
        """Return the cells that contain points, possibly outside the map.

        Parameters
        ----------
        points : array-like, shape (..., 2)
            Points x, y, m. A point on an edge belongs to the cell with the greater row or column.

        Returns
        -------
        ndarray of int, shape (..., 2)
            Rows and columns.
        """
        steps = np.floor((np.asarray(points, float) - self.origin) / self.cell)
        return np.asarray(steps[..., ::-1]).astype(np.int64)

    def holds(self, cells: ArrayLike) -> Truths:
        """Return whether each cell, shape (..., 2), is free and inside the map."""
        indices = np.asarray(cells, np.int64)
        inside = np.asarray(((indices >= 0) & (indices < self.shape)).all(axis=-1))
        safe = np.where(inside[..., None], indices, 0)
        return np.asarray(inside & ~self.blocked[safe[..., 0], safe[..., 1]])

    @classmethod
    @np.errstate(all="ignore")  # the checks below reject results of an overflow
    def from_polygons(
        cls, polygons: Any, bounds: ArrayLike, cell: float, radius: float = 0.0
    ) -> GridMap:
        """Return the map of polygonal obstacles within bounds.

        A cell is blocked if one of its points is nearer than `radius` to a polygon or, with radius 0, inside
        a polygon. The robot's centre is therefore safe everywhere in a free cell. Contact does not block a
        cell, because cells shrink by 1e-9 of their side for the comparison. A cell that extends beyond the
        bounds is blocked. The bounds limit the robot's centre; they are not walls.

        Parameters
        ----------
        polygons : list
            Obstacles, in any form that :class:`~crosstrack.models.grid_path.Polygons` accepts.
        bounds : array-like, shape (4,)
            Lowest x and y, greatest x and y, m.
        cell : float
            Side of a cell, m.
        radius : float, default 0
            Radius of the robot, m.

        Returns
        -------
        GridMap
            Map with its origin at the lower left corner of the bounds and y drawn upward.

        Raises
        ------
        InvalidData
            A polygon is invalid, the bounds have no area, the map has too many cells, or no cell is free.
        """
        import shapely

        obstacles = Polygons().coerce("polygons", polygons, {})
        corners = Array((4,)).coerce("bounds", bounds, {})
        side = Real(lower=0, strict=True, unit="m").coerce("cell", cell, {})
        reach = Real(lower=0, unit="m").coerce("radius", radius, {}) / side
        low, extent = corners[:2], (corners[2:] - corners[:2]) / side
        if not extent.min() > 0:
            raise InvalidData(
                f"bounds must be least x, least y, greatest x, greatest y with an area > 0, got "
                f"{show(corners.tolist())}",
                field="bounds",
            )
        columns, rows = np.maximum(np.ceil(extent - SHRINK), 1.0)
        if not rows * columns <= MOST:
            raise InvalidData(
                f"cell must give at most {MOST} cells within the bounds, got {cell:g} m, which gives "
                f"{rows:g} × {columns:g}",
                field="cell",
            )
        shape = (int(rows), int(columns))
        # Coordinates in cells avoid cancellation by the map's position and scale.
        scaled = shapely.transform(as_shapely(obstacles), lambda xy: (xy - low) / side)
        blocked = rasterise(scaled, shape, reach)
        whole = np.floor(extent + SHRINK).astype(int)
        blocked[whole[1] :] = blocked[:, whole[0] :] = True
        return cls(blocked, side, low, upward=True)

    def inflated(self, radius: float) -> GridMap:
        """Return the map for a circular robot, with cells nearer than `radius` to a blocked cell blocked.

        The distance of two cells is the distance of their nearest points. The robot's centre is therefore
        safe everywhere in a free cell.

        Parameters
        ----------
        radius : float
            Radius of the robot, m.

        Raises
        ------
        InvalidData
            The radius is invalid, or no cell remains free.
        """
        reach = Real(lower=0, unit="m").coerce("radius", radius, {}) / self.cell
        if not self.blocked.any() or reach == 0:
            return self
        return replace(self, blocked=enlarged(self.blocked, reach * (1 - 1e-12)))

    def inflation_weights(
        self, radius: float, peak: float, decay: float, inscribed: float = 0.0
    ) -> Floats:
        """Return weights of cells for :class:`GridPath` that are greater near blocked cells.

        For the distance d between the centres of a cell and the nearest blocked cell, the weight is `peak` up to
        `inscribed`, then ``1 + (peak - 1) exp(-decay (d - inscribed))`` up to `radius`, and 1 beyond. These are
        the costs of the inflation layer of ROS (http://wiki.ros.org/costmap_2d), on a scale from 1 to `peak`.

        Parameters
        ----------
        radius : float
            Distance up to which weights exceed 1, m.
        peak : float
            Greatest weight, at least 1.
        decay : float
            Rate at which the weights decrease, 1/m.
        inscribed : float, default 0
            Distance up to which the weight is `peak`, m.

        Returns
        -------
        ndarray, shape (rows, columns)
            Weights, at least 1.

        Raises
        ------
        InvalidData
            A parameter is out of range.
        """
        from scipy.ndimage import distance_transform_edt

        reach, inner = (
            Real(lower=0, unit="m").coerce(name, value, {})
            for name, value in (("radius", radius), ("inscribed", inscribed))
        )
        top = Real(lower=1).coerce("peak", peak, {})
        rate = Real(lower=0, unit="1/m").coerce("decay", decay, {})
        if not self.blocked.any():
            return np.ones(self.shape)
        apart = distance_transform_edt(~self.blocked) * self.cell
        weights = 1.0 + (top - 1.0) * np.exp(-rate * np.maximum(apart - inner, 0.0))
        return np.where(apart <= max(reach, inner), weights, 1.0)

    def __repr__(self) -> str:
        rows, columns = self.shape
        return f"<GridMap {rows} × {columns} cells of {self.cell:g} m, {self.blocked.mean():.0%} blocked>"
