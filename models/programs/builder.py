"""Construction of mixed-integer and conic programs block by block."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ..fields import Array, Flag, Whole, show
from .blocks import Block
from .cones import ConeBlock, ConeKind
from .conic import ConicProgram
from .linear import MixedIntegerProgram

__all__ = ["ProgramBuilder"]

Indices = NDArray[np.int64]
Arrays = tuple[NDArray[Any], ...]

#: Largest number of rows or columns of a block.
MOST_ENTRIES = 100_000_000


class ProgramBuilder:
    """Builder that collects blocks of columns, rows and cones into a program.

    :meth:`build` returns a :class:`MixedIntegerProgram`, and :meth:`build_conic` a
    :class:`ConicProgram`. The constructor has no parameters.
    """

    def __init__(self) -> None:
        self._columns: list[Block] = []
        self._column_data: list[Arrays] = []
        self._rows: list[Block] = []
        self._row_bounds: list[Arrays] = [(np.empty(0), np.empty(0))]
        self._entries: list[Arrays] = []
        self._cones: list[ConeBlock] = []
        self._cone_offsets: list[NDArray[Any]] = [np.empty(0)]
        self._cone_entries: list[Arrays] = []
        self._size = self._row_count = self._cone_rows = 0

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
        """Add a block of columns.

        Parameters
        ----------
        name : str
            Name of the block.
        size : int
            Number of columns.
        lower, upper, cost : array_like
            Bounds and objective coefficients, one number or one per column.
        integral : bool
            Whether the columns must be integers.
        equation, template, index, unit
            See :class:`Block`.

        Returns
        -------
        ndarray of int, shape (size,)
            Indices of the columns.
        """
        size = Whole(0, MOST_ENTRIES).coerce("size", size, {})
        block = Block(name, equation, self._size, size, template, _index(index, size), unit)
        data = (
            _spread("lower", lower, size, -1),
            _spread("upper", upper, size, 1),
            _spread("cost", cost, size),
            np.full(size, Flag().coerce("integral", integral, {})),
        )
        self._columns.append(block)
        self._column_data.append(data)
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
        """Add a block of rows ``lower <= sum of terms <= upper``.

        Parameters
        ----------
        name : str
            Name of the block.
        size : int
            Number of rows.
        *terms : tuple of array_like
            Triples ``(row, column, coefficient)``, broadcast against one another, with the row
            counted within the block.
        lower, upper : array_like
            Bounds, one number or one per row.
        equation, template, index, unit
            See :class:`Block`.
        """
        size = Whole(0, MOST_ENTRIES).coerce("size", size, {})
        block = Block(name, equation, self._row_count, size, template, _index(index, size), unit)
        bounds = (_spread("lower", lower, size, -1), _spread("upper", upper, size, 1))
        self._entries += _entries(terms, block, self._size)
        self._rows.append(block)
        self._row_bounds.append(bounds)
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
        """Add a block of cones.

        Parameters
        ----------
        name : str
            Name of the block.
        kind : ConeKind
            Kind of the cones.
        count, dimension : int
            Number of cones, and of rows per cone.
        *terms : tuple of array_like
            Triples as in :meth:`rows`; entry e of cone k is row ``k * dimension + e`` of the block.
        offset : array_like
            Constants of the rows: one number, one per entry of a cone, or an array of shape
            ``(count, dimension)``.
        equation, template, index, unit
            See :class:`Block`; `index` has one row per cone.
        """
        count = Whole(1, MOST_ENTRIES).coerce("count", count, {})
        dimension = Whole(1, MOST_ENTRIES).coerce("dimension", dimension, {})
        start = self._cone_rows
        size = Whole(1, MOST_ENTRIES).coerce("rows of the cones", count * dimension, {})
        block = ConeBlock(
            name, equation, start, size, template, _index(index, count), unit,
            kind=kind, dimension=dimension,
        )  # fmt: skip
        offsets = _spread("offset", offset, (count, dimension))
        self._cone_entries += _entries(terms, block, self._size)
        self._cones.append(block)
        self._cone_offsets.append(offsets.ravel())
        self._cone_rows += size

    def build(self, *, name: str = "", offset: float = 0.0) -> MixedIntegerProgram:
        """Return the program, or raise ``InvalidData`` if it has cones."""
        if self._cones:
            raise InvalidData("a program with cones is built by build_conic", field="cones")
        shared, integral = self._shared()
        return MixedIntegerProgram(**shared, integral=integral, offset=offset, name=name)

    def build_conic(
        self, *, name: str = "", offset: float = 0.0, hessian: ArrayLike | None = None
    ) -> ConicProgram:
        """Return the program with its cones, or raise ``InvalidData`` if a column is integral.

        Parameters
        ----------
        name : str
            Name of the program.
        offset : float
            Constant of the objective.
        hessian : array_like, shape (n, n), optional
            Hessian of the objective; None for a linear objective.
        """
        shared, integral = self._shared()
        if integral.any():
            raise InvalidData("a conic program has no integral columns", field="integral")
        return ConicProgram(
            **shared,
            cone_matrix=_sparse(self._cone_entries, (self._cone_rows, self._size)),
            cone_offset=np.concatenate(self._cone_offsets),
            cones=tuple(self._cones),
            hessian=hessian,
            offset=offset,
            name=name,
        )

    def _shared(self) -> tuple[dict[str, Any], NDArray[np.bool_]]:
        """Return the fields of both kinds of programs, and which columns are integral."""
        if not self._column_data:
            raise InvalidData("a program needs a block of columns at least", field="columns")
        lower, upper, cost, integral = map(np.concatenate, zip(*self._column_data, strict=True))
        row_lower, row_upper = map(np.concatenate, zip(*self._row_bounds, strict=True))
        shared = {
            "cost": cost,
            "matrix": _sparse(self._entries, (self._row_count, self._size)),
            "row_lower": row_lower,
            "row_upper": row_upper,
            "column_lower": lower,
            "column_upper": upper,
            "columns": tuple(self._columns),
            "rows": tuple(self._rows),
        }
        return shared, integral.astype(bool)


def _spread(
    name: str, value: Any, shape: int | tuple[int, ...], infinity: int = 0
) -> NDArray[np.float64]:
    """Return `value` broadcast to `shape`; `infinity` as in :class:`Array`."""
    array = Array(_axes(value), infinity=infinity).coerce(name, value, {})
    try:
        return np.broadcast_to(array, shape)
    except ValueError:
        raise InvalidData(
            f"{name} must be a number or fit shape {shape}, got {show(value)}", field=name
        ) from None


def _entries(terms: Sequence[Any], block: Block, columns: int) -> list[Arrays]:
    """Return rows, columns and coefficients of `terms` in `block`."""
    result: list[Arrays] = []
    for k, term in enumerate(terms):
        name = f"term {k} of {block.name!r}"
        if not isinstance(term, tuple | list) or len(term) != 3:
            raise InvalidData(
                f"{name} must be (row, column, coefficient), got {show(term)}", field="terms"
            )
        parts = []
        for what, value, count in zip(("row", "column"), term, (block.size, columns), strict=False):
            rule = Array(_axes(value), int, lower=0, upper=count - 1)
            parts.append(rule.coerce(f"{name}: {what}", value, {}))
        parts.append(Array(_axes(term[2])).coerce(f"{name}: coefficient", term[2], {}))
        try:
            r, c, v = np.broadcast_arrays(*parts)
        except ValueError:
            raise InvalidData(
                f"{name}: shapes {[part.shape for part in parts]} do not fit", field="terms"
            ) from None
        result.append((r.ravel() + block.start, c.ravel(), v.ravel()))
    return result


def _axes(value: Any) -> tuple[str, ...]:
    """Return a name for every axis of `value`."""
    try:
        return tuple(f"axis {k}" for k in range(np.ndim(value)))
    except Exception:  # not an array: Array rejects it with its name
        return ("axis",)


def _sparse(entries: Sequence[Arrays], shape: tuple[int, int]) -> sp.csr_array:
    if not entries:
        return sp.csr_array(shape)
    row, column, value = map(np.concatenate, zip(*entries, strict=True))
    return sp.csr_array(sp.coo_array((value, (row, column)), shape=shape))


def _index(index: ArrayLike | None, size: int) -> Indices | None:
    if index is None:
        return None
    array = Array(_axes(index), int).coerce("index", index, {})
    if size and array.size % size:
        raise InvalidData(
            f"index must have a row for each of {size} entries, got shape {array.shape}",
            field="index",
        )
    return array.reshape(size, -1) if size else np.zeros((0, 1), np.int64)
