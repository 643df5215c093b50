"""A map of free and blocked cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ..declaration import Declared
from ..fields import Array, Flag, Real, declared, show
from .polygons import Polygons, as_shapely
from .raster import SHRINK, rasterise

__all__ = ["BLOCKED", "FREE", "MOST", "GridMap", "read_cells"]

Floats = NDArray[np.float64]
Truths = NDArray[np.bool_]

#: The characters of free and of blocked cells; those of MovingAI's maps that mean the same are read.
FREE, BLOCKED = ".", "@"
_FREE, _BLOCKED = ".G", "@OTW#"
#: Cells that a map may have at the most.
MOST = 2**26


class Cells(Array):
    """Truth values, or lines of text with a character a cell; written as lines."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Truths:
        if isinstance(value, str):
            value = value.splitlines()
        if isinstance(value, list | tuple) and value and all(isinstance(x, str) for x in value):
            value = read_cells(value, name)
        found: Truths = super().coerce(name, value, sizes)
        return found

    def encode(self, value: Truths) -> list[str]:
        letters = np.where(value, BLOCKED, FREE)
        found: list[str] = letters.view(f"U{value.shape[1]}")[:, 0].tolist()
        return found


def read_cells(
    lines: Sequence[str], where: str = "blocked", first: tuple[int, int] = (0, 0), free: str = _FREE
) -> Truths:
    """Return which cells are blocked in lines of text, a character a cell.

    Parameters
    ----------
    lines : sequence of str
        The rows.
    where : str
        What messages call the text, such as a file.
    first : tuple of int
        Numbers of the first line and of the first character in messages.
    free : str
        The characters of free cells.

    Returns
    -------
    ndarray of bool, shape (rows, columns)

    Raises
    ------
    InvalidData
        Naming line and column: unknown characters, lines of different lengths.
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


@dataclass(frozen=True, eq=False, repr=False)
class GridMap(Declared):
    """Square cells, each free or blocked; every position in a free cell is safe.

    The cell in row r and column c covers x from ``origin[0] + c cell`` to one `cell` more, and y from
    ``origin[1] + r cell`` alike. What lies outside of the map is blocked.

    Parameters
    ----------
    blocked : ndarray of bool, shape (rows, columns), or lines of text
        Which cells are blocked. In text ``.`` and ``G`` are free, ``@``, ``O``, ``T``, ``W`` and ``#``
        blocked, and the first line is row 0.
    cell : float
        Side of a cell, m.
    origin : ndarray, shape (2,)
        The corner of the cell in row 0 and column 0 that has the least x and y, m.
    upward : bool
        Whether pictures draw y upward, as for maps of a terrain; else row 0 is drawn at the top, as
        in text and images.

    Raises
    ------
    InvalidData
        Naming the field: lines of different lengths, unknown characters, no free cell, NaN.
    """

    blocked: Truths = declared(Cells(("rows", "columns"), bool))
    cell: float = declared(Real(lower=0, strict=True, unit="m"), default=1.0)
    origin: Floats = declared(Array((2,)), default=(0.0, 0.0))
    upward: bool = declared(Flag(), default=False)

    def check(self) -> None:
        """Refuse maps that nobody can move on, or that are too large."""
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
        """The map with a frame of blocked cells, flat, 1 where blocked, as the searches take it."""
        framed = np.pad(self.blocked, 1, constant_values=True).astype(np.uint8).ravel()
        framed.flags.writeable = False
        return framed

    def numbers_of(self, cells: ArrayLike) -> NDArray[np.int64]:
        """Return the places in :attr:`walls` of cells, rows and columns of shape (..., 2)."""
        at = np.asarray(cells, np.int64) + 1
        return np.asarray(at[..., 0] * (self.shape[1] + 2) + at[..., 1])

    def cells_at(self, numbers: ArrayLike) -> NDArray[np.int64]:
        """Return the rows and columns, shape (..., 2), of places in :attr:`walls`."""
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
            x, y (m).
        """
        rows_columns = np.asarray(cells, float)
        found: Floats = self.origin + (rows_columns[..., ::-1] + 0.5) * self.cell
        return found

    def cells_of(self, points: ArrayLike) -> NDArray[np.int64]:
        """Return rows and columns of the cells that hold points; they may lie outside of the map.

        Parameters
        ----------
        points : array-like, shape (..., 2)
            x, y (m). A point on an edge belongs to the cell with the greater row or column.

        Returns
        -------
        ndarray of int, shape (..., 2)
            Row, column.
        """
        steps = np.floor((np.asarray(points, float) - self.origin) / self.cell)
        return np.asarray(steps[..., ::-1]).astype(np.int64)

    def holds(self, cells: ArrayLike) -> Truths:
        """Return which of the cells, shape (..., 2), lie on the map and are free."""
        given = np.asarray(cells, np.int64)
        inside = np.asarray(((given >= 0) & (given < self.shape)).all(axis=-1))
        safe = np.where(inside[..., None], given, 0)
        return np.asarray(inside & ~self.blocked[safe[..., 0], safe[..., 1]])

    @classmethod
    @np.errstate(all="ignore")  # what overflows is refused where it counts
    def from_polygons(
        cls, polygons: Any, bounds: ArrayLike, cell: float, radius: float = 0.0
    ) -> GridMap:
        """Return the map of the cells that polygons leave free.

        A cell is blocked where one of its points is nearer than `radius` to a polygon, or for a radius
        of 0 within one, so the whole of a free cell is safe for the robot's centre. Contact does not
        count: cells are taken as smaller by 1e-9 of their side. A cell that leaves the bounds is
        blocked; the bounds themselves are where the centre may be, and no walls.

        Parameters
        ----------
        polygons : list
            Obstacles, in any form that :class:`~crosstrack.models.grid_path.Polygons` takes.
        bounds : array-like, shape (4,)
            Least x and y, greatest x and y, m.
        cell : float
            Side of a cell, m.
        radius : float
            Of the robot, m.

        Raises
        ------
        InvalidData
            A polygon that is none, bounds without an area, too many cells, or none that is free.
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
        # In cells, so that neither the map's place nor its scale costs digits.
        scaled = shapely.transform(as_shapely(obstacles), lambda xy: (xy - low) / side)
        blocked = rasterise(scaled, shape, reach)
        whole = np.floor(extent + SHRINK).astype(int)
        blocked[whole[1] :] = blocked[:, whole[0] :] = True
        return cls(blocked, side, low, upward=True)

    def inflated(self, radius: float) -> GridMap:
        """Return the map for a round robot: cells nearer than `radius` (m) to a blocked one are blocked.

        Distances are those between the nearest points of two cells, so the whole of a free cell is
        safe for the robot's centre.
        """
        from scipy.ndimage import distance_transform_edt

        reach = Real(lower=0, unit="m").coerce("radius", radius, {}) / self.cell
        # Nearest points of two cells are corners of both, as cells lie on one lattice.
        corners = np.ones(np.add(self.shape, 1), bool)
        for row in (0, 1):
            for column in (0, 1):
                rows, columns = self.shape
                corners[row : row + rows, column : column + columns] &= ~self.blocked
        if corners.all() or reach == 0:
            return self
        away = distance_transform_edt(corners)
        near = np.minimum(away[1:], away[:-1]).astype(float)
        near = np.asarray(np.minimum(near[:, 1:], near[:, :-1]))
        blocked = self.blocked | (near < reach * (1 - 1e-12))
        return replace(self, blocked=blocked)

    def __repr__(self) -> str:
        rows, columns = self.shape
        return f"<GridMap {rows} × {columns} cells of {self.cell:g} m, {self.blocked.mean():.0%} blocked>"
