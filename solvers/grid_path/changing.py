"""Map whose cells change, with its connected components."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ...models.fields import Array, Real, show
from ...models.grid_path.gridmap import GridMap, enlarged
from ...models.grid_path.model import Goals

__all__ = ["ChangingMap"]

Ints = NDArray[np.int64]

_ONE, _SEVERAL = Array((2,), int), Goals(("k", 2), int)


class ChangingMap:
    """Map of a prepared solver, see :class:`.PreparedMap`.

    Attributes `blocked`, shape (rows, columns), for the verification and `walls`, with a frame and flat, for the searches
    have the same cells.
    """

    def __init__(self, grid: GridMap, radius: float) -> None:
        self.grid, self.width = grid, grid.shape[1] + 2
        self._reach = Real(lower=0, unit="m").coerce("radius", radius, {}) / grid.cell * (1 - 1e-12)
        self._map: GridMap | None = grid.inflated(radius)
        self._given = grid.blocked.copy()
        self.blocked, self.walls = self._map.blocked.copy(), self._map.walls.copy()
        self.free = int((self.walls == 0).sum())
        self._labels: NDArray[np.int32] | None = None

    @property
    def map(self) -> GridMap:
        """The present map, including the radius."""
        if self._map is None:
            self._map = replace(self.grid, blocked=self.blocked.copy())
        return self._map

    def numbers_of(self, name: str, cells: Any) -> list[int]:
        """Return the numbers of free cells; raise if a cell is not free."""
        if type(cells) is tuple and len(cells) == 2 and type(cells[0]) is type(cells[1]) is int:
            pairs: Any = [cells]  # the common case needs no array
        else:
            spec = _ONE if name == "start" else _SEVERAL
            pairs = spec.coerce(name, cells, {}).reshape(-1, 2).tolist()
        if not pairs:
            raise InvalidData(f"{name} must hold at least one cell, got none", field=name)
        rows, columns = self.blocked.shape
        numbers = []
        for row, column in pairs:
            if not (0 <= row < rows and 0 <= column < columns) or self.blocked[row, column]:
                raise InvalidData(
                    f"{name} must be free cells (row, column) of {rows} × {columns}, got "
                    f"{[row, column]}, which is blocked or outside",
                    field=name,
                )
            numbers.append((row + 1) * self.width + column + 1)
        return numbers

    def change(self, cells: ArrayLike, blocked: ArrayLike) -> Ints:
        """Return the numbers of the cells that have another state afterwards, see :meth:`.PreparedMap.change`."""
        at = _SEVERAL.coerce("cells", cells, {})
        rows, columns = self.blocked.shape
        bad = np.flatnonzero(((at < 0) | (at >= (rows, columns))).any(axis=1))
        if bad.size:
            raise InvalidData(
                f"cells[{bad[0]}] must be inside of {rows} × {columns} cells, got "
                f"{show(at[bad[0]].tolist())}",
                field="cells",
            )
        states = np.full(len(at), blocked) if np.ndim(blocked) == 0 else blocked
        states = Array((len(at),), bool).coerce("blocked", states, {})
        places = tuple(at.T)
        former = self._given[places]
        self._given[places] = states
        differing = self._differing(at)
        numbers = self.grid.numbers_of(differing)
        freed = int(self.walls[numbers].sum())
        free = self.free + 2 * freed - len(numbers)
        if free <= 0:
            self._given[places] = former
            raise InvalidData("blocked must leave at least one cell free", field="blocked")
        self.blocked[tuple(differing.T)] ^= True
        self.walls[numbers] ^= 1
        self.free = free
        self._map = None
        if freed:
            self._labels = None
        return numbers

    def _differing(self, at: Ints) -> Ints:
        """Return the cells whose state on the map differs after changes of the given map at `at`."""
        cells = np.unique(at, axis=0)
        if self._reach == 0 or not len(at):
            places = tuple(cells.T)
            return np.asarray(cells[self._given[places] != self.blocked[places]])
        most = math.ceil(min(self._reach, max(self.blocked.shape))) + 1
        low, high = np.maximum(cells.min(axis=0) - most, 0), cells.max(axis=0) + most + 1
        begin = np.maximum(low - most, 0)
        window = tuple(slice(b, e + most) for b, e in zip(begin, high, strict=True))
        inner = tuple(slice(b, e) for b, e in zip(low - begin, high - begin, strict=True))
        fresh = enlarged(self._given[window], self._reach)[inner]
        present = self.blocked[low[0] : high[0], low[1] : high[1]]
        return np.asarray(np.argwhere(fresh != present) + low)

    # -- components ------------------------------------------------------------------------------

    def number_components(self) -> None:
        """Number the connected components, which shows later that cells are separated.

        Diagonal steps join no further cells. Blocked cells may divide a component but join none, so the
        numbers remain a proof until cells are freed.
        """
        from scipy.ndimage import label

        self._labels = label(self.walls.reshape(-1, self.width) == 0)[0].ravel()

    def are_joined(self, first: int, other: int) -> bool:
        """Return whether two free cells may be connected; False is a proof that they are not."""
        return self._labels is None or bool(self._labels[first] == self._labels[other])
