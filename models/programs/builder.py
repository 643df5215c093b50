"""Writing a mixed-integer program block by block, as a paper lists its equations."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from .blocks import Block
from .linear import MixedIntegerProgram

__all__ = ["ProgramBuilder"]

Indices = NDArray[np.int64]


class ProgramBuilder:
    """Collects blocks of columns and rows and makes a :class:`MixedIntegerProgram` of them."""

    def __init__(self) -> None:
        self._columns: list[Block] = []
        self._rows: list[Block] = []
        self._column_data: list[tuple[NDArray[Any], ...]] = []
        self._row_bounds: list[tuple[NDArray[Any], NDArray[Any]]] = []
        self._entries: list[tuple[NDArray[Any], NDArray[Any], NDArray[Any]]] = []
        self._size = 0
        self._row_count = 0

    def columns(
        self,
        name: str,
        size: int,
        *,
        lower: ArrayLike = 0.0,
        upper: ArrayLike = np.inf,
        cost: ArrayLike = 0.0,
        integral: bool = False,
        equation: str = "",
        template: str = "",
        index: ArrayLike | None = None,
        unit: str = "",
    ) -> Indices:
        """Add a block of `size` columns and return their indices."""
        block = Block(name, equation, self._size, size, template, _index(index, size), unit)
        self._columns.append(block)
        self._column_data.append(
            (
                *(np.broadcast_to(np.asarray(v, float), (size,)) for v in (lower, upper, cost)),
                np.full(size, integral),
            )
        )
        self._size += size
        return np.arange(block.start, block.start + size, dtype=np.int64)

    def rows(
        self,
        name: str,
        size: int,
        *terms: tuple[ArrayLike, ArrayLike, ArrayLike],
        lower: ArrayLike = -np.inf,
        upper: ArrayLike = np.inf,
        equation: str = "",
        template: str = "",
        index: ArrayLike | None = None,
        unit: str = "",
    ) -> None:
        """Add a block of `size` rows.

        Each of `terms` is ``(row, column, coefficient)``, broadcast against one another, with the
        row counted within the block.
        """
        block = Block(name, equation, self._row_count, size, template, _index(index, size), unit)
        self._rows.append(block)
        self._row_bounds.append(
            (
                np.broadcast_to(np.asarray(lower, float), (size,)),
                np.broadcast_to(np.asarray(upper, float), (size,)),
            )
        )
        for row, column, coefficient in terms:
            r, c, v = np.broadcast_arrays(
                np.asarray(row, np.int64),
                np.asarray(column, np.int64),
                np.asarray(coefficient, float),
            )
            self._entries.append((r.ravel() + block.start, c.ravel(), v.ravel()))
        self._row_count += size

    def build(self, *, name: str = "", offset: float = 0.0) -> MixedIntegerProgram:
        """Return the program."""
        lower, upper, cost, integral = (
            np.concatenate(part) for part in zip(*self._column_data, strict=True)
        )
        if self._entries:
            row, column, value = (np.concatenate(part) for part in zip(*self._entries, strict=True))
        else:
            row, column, value = np.empty(0, int), np.empty(0, int), np.empty(0)
        shape = (self._row_count, self._size)
        return MixedIntegerProgram(
            cost=cost,
            matrix=sp.csr_array(sp.coo_array((value, (row, column)), shape=shape)),
            row_lower=np.concatenate([b[0] for b in self._row_bounds] or [np.empty(0)]),
            row_upper=np.concatenate([b[1] for b in self._row_bounds] or [np.empty(0)]),
            column_lower=lower,
            column_upper=upper,
            integral=integral.astype(bool),
            offset=offset,
            columns=tuple(self._columns),
            rows=tuple(self._rows),
            name=name,
        )


def _index(index: ArrayLike | None, size: int) -> Indices | None:
    if index is None:
        return None
    array = np.asarray(index, np.int64)
    return array.reshape(size, -1) if size else np.zeros((0, 1), np.int64)
