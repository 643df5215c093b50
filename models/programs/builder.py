"""Writing a mixed-integer or conic program block by block, as a paper lists its equations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from .blocks import Block
from .cones import ConeBlock, ConeKind
from .conic import ConicProgram
from .linear import MixedIntegerProgram

__all__ = ["ProgramBuilder"]

Indices = NDArray[np.int64]


class ProgramBuilder:
    """Collects blocks of columns, rows and cones and makes a program of them.

    That is a :class:`MixedIntegerProgram`, or a :class:`ConicProgram` where there are cones.
    """

    def __init__(self) -> None:
        self._columns: list[Block] = []
        self._rows: list[Block] = []
        self._column_data: list[tuple[NDArray[Any], ...]] = []
        self._row_bounds: list[tuple[NDArray[Any], NDArray[Any]]] = []
        self._entries: list[tuple[NDArray[Any], NDArray[Any], NDArray[Any]]] = []
        self._cones: list[ConeBlock] = []
        self._cone_offsets: list[NDArray[Any]] = []
        self._cone_entries: list[tuple[NDArray[Any], NDArray[Any], NDArray[Any]]] = []
        self._size = 0
        self._row_count = 0
        self._cone_rows = 0

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
        self._entries += _entries(terms, block.start)
        self._row_count += size

    def cones(
        self,
        name: str,
        kind: ConeKind,
        count: int,
        dimension: int,
        *terms: tuple[ArrayLike, ArrayLike, ArrayLike],
        offset: ArrayLike = 0.0,
        equation: str = "",
        template: str = "",
        index: ArrayLike | None = None,
        unit: str = "",
    ) -> None:
        """Add a block of `count` cones of `dimension` rows each.

        `terms` are as in :meth:`rows`, with the row counted within the block: that of entry e of
        cone k is ``k * dimension + e``. `offset`, which is added to them, may be one number, one
        for every entry of a cone, or have the shape ``(count, dimension)``. `index` has one row a
        cone.
        """
        start, size = self._cone_rows, count * dimension
        block = ConeBlock(
            name, equation, start, size, template, _index(index, count), unit,
            kind=kind, dimension=dimension,
        )  # fmt: skip
        self._cones.append(block)
        offsets = np.broadcast_to(np.asarray(offset, float), (count, dimension))
        self._cone_offsets.append(offsets.ravel())
        self._cone_entries += _entries(terms, start)
        self._cone_rows += size

    def build(self, *, name: str = "", offset: float = 0.0) -> MixedIntegerProgram:
        """Return the program; ``InvalidData`` where it has cones, which :meth:`build_conic` takes."""
        if self._cones:
            raise InvalidData("a program with cones is built by build_conic", field="cones")
        shared, integral = self._shared()
        return MixedIntegerProgram(**shared, integral=integral, offset=offset, name=name)

    def build_conic(
        self, *, name: str = "", offset: float = 0.0, hessian: ArrayLike | None = None
    ) -> ConicProgram:
        """Return the program with its cones; ``InvalidData`` where a column must be whole."""
        shared, integral = self._shared()
        if integral.any():
            raise InvalidData("a conic program has no integral columns", field="integral")
        return ConicProgram(
            **shared,
            cone_matrix=_sparse(self._cone_entries, (self._cone_rows, self._size)),
            cone_offset=np.concatenate([np.empty(0), *self._cone_offsets]),
            cones=tuple(self._cones),
            hessian=hessian,
            offset=offset,
            name=name,
        )

    def _shared(self) -> tuple[dict[str, Any], NDArray[np.bool_]]:
        """Return what programs of both kinds have, and which columns must be whole."""
        lower, upper, cost, integral = (
            np.concatenate(part) for part in zip(*self._column_data, strict=True)
        )
        shared = {
            "cost": cost,
            "matrix": _sparse(self._entries, (self._row_count, self._size)),
            "row_lower": np.concatenate([b[0] for b in self._row_bounds] or [np.empty(0)]),
            "row_upper": np.concatenate([b[1] for b in self._row_bounds] or [np.empty(0)]),
            "column_lower": lower,
            "column_upper": upper,
            "columns": tuple(self._columns),
            "rows": tuple(self._rows),
        }
        return shared, integral.astype(bool)


def _entries(
    terms: Sequence[tuple[ArrayLike, ArrayLike, ArrayLike]], start: int
) -> list[tuple[NDArray[Any], NDArray[Any], NDArray[Any]]]:
    """Return rows, columns and coefficients of `terms` in a block that begins at `start`."""
    found = []
    for row, column, coefficient in terms:
        r, c, v = np.broadcast_arrays(
            np.asarray(row, np.int64), np.asarray(column, np.int64), np.asarray(coefficient, float)
        )
        found.append((r.ravel() + start, c.ravel(), v.ravel()))
    return found


def _sparse(
    entries: Sequence[tuple[NDArray[Any], NDArray[Any], NDArray[Any]]], shape: tuple[int, int]
) -> sp.csr_array:
    if not entries:
        return sp.csr_array(shape)
    row, column, value = (np.concatenate(part) for part in zip(*entries, strict=True))
    return sp.csr_array(sp.coo_array((value, (row, column)), shape=shape))


def _index(index: ArrayLike | None, size: int) -> Indices | None:
    if index is None:
        return None
    array = np.asarray(index, np.int64)
    return array.reshape(size, -1) if size else np.zeros((0, 1), np.int64)
