"""Blocks of rows and columns with the paper's equations, and specifications of sparse matrices."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from string import Formatter
from typing import Any, ClassVar, TypeVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Declared
from ..fields import Array, Optional, Spec, Text, Whole, declared, frozen, show
from ..records import Several

__all__ = ["Block", "Blocks", "Sparse", "without"]


@dataclass(frozen=True, eq=False)
class Block(Declared):
    """Named range of rows or columns that represents one equation or one kind of decision.

    Parameters
    ----------
    name : str
        Name of the block, such as ``"horizontal error"``.
    equation : str
        Equation number in the paper; empty if it has none.
    start, size : int
        The rows or columns ``start … start + size - 1``.
    template : str
        Format of the place of an entry, such as ``"arc {0}-{1}"``, filled from `index`.
    index : ndarray of int, shape (size, k)
        Values for `template`, one row per entry.
    unit : str
        Unit of the entries.
    labels : tuple of str
        Names of the entries, used instead of `template`; empty if they have none.
    """

    name: str = declared(Text())
    equation: str = declared(Text())
    start: int = declared(Whole(0))
    size: int = declared(Whole(0))
    template: str = declared(Text(), default="")
    index: NDArray[np.int64] | None = declared(
        Optional(Array(("entries", "numbers"), int)), default=None
    )
    unit: str = declared(Text(), default="")
    labels: tuple[str, ...] = declared(Several(Text()), default=(), added=True)

    def check(self) -> None:
        """Reject labels or an index that do not fit the entries, and a template unlike the index."""
        if self.labels and len(self.labels) != self.count:
            raise InvalidData(
                f"labels must name each of {self.count} entries, got {len(self.labels)} names",
                field="labels",
            )
        if self.index is None:
            return
        if len(self.index) != self.count:
            raise InvalidData(
                f"index must have a row for each of {self.count} entries, got {len(self.index)}",
                field="index",
            )
        if self.count:
            _check_template(self.template, self.index.shape[1])

    @property
    def count(self) -> int:
        """Number of entries, and of rows of `index`."""
        return self.size

    @property
    def slice(self) -> slice:
        """The entries as a slice."""
        return slice(self.start, self.start + self.size)

    def place(self, entry: int) -> str:
        """Return the place of `entry`, which is counted within the block."""
        if self.labels:
            return self.labels[entry]
        if self.index is None:
            return f"{self.name} {entry}" if self.size > 1 else ""
        return self.template.format(*self.index[entry].tolist())

    @property
    def entry_labels(self) -> list[str]:
        """Names of the entries without the name of the block, if they have some."""
        if self.labels or self.index is not None:
            return [self.place(k) for k in range(self.size)]
        name = f"({self.name})" if " " in self.name else self.name
        return [f"{name}[{k}]" for k in range(self.size)] if self.size > 1 else [self.name]

    @property
    def title(self) -> str:
        """The block's name with its equation."""
        return f"eq. {self.equation}, {self.name}" if self.equation else self.name

    def describe(self, entry: int) -> str:
        """Return the description of an entry, such as ``"eq. 13, horizontal error at point 40"``."""
        if self.index is None and not self.labels:
            return f"{self.title} {entry}" if self.size > 1 else self.title
        return f"{self.title} {self.place(entry)}"


def _check_template(template: str, count: int) -> None:
    """Raise if a template has other fields than the numbers 0 … `count` - 1 in braces."""
    try:
        parts = [part for part in Formatter().parse(template) if part[1] is not None]
    except ValueError:
        parts = [("", "", "", None)]
    known = set(map(str, range(count)))
    if any(field not in known or spec or turn for _, field, spec, turn in parts):
        raise InvalidData(
            f"template must hold {', '.join(f'{{{k}}}' for k in range(count))} and text, "
            f"got {show(template)}",
            field="template",
        )


SomeBlock = TypeVar("SomeBlock", bound=Block)


def block_names(names: Any) -> set[str]:
    """Return `names` as a set, or raise if it is not an iterable of strings."""
    if not isinstance(names, str | bytes | Mapping):
        with contextlib.suppress(TypeError):  # not iterable: rejected below
            result = list(names)
            if all(isinstance(name, str) for name in result):
                return set(result)
    raise InvalidData(f"names must be a list of block names, got {show(names)}", field="names")


def without(
    blocks: Iterable[SomeBlock], names: Iterable[str]
) -> tuple[NDArray[np.int64], tuple[SomeBlock, ...]]:
    """Return the indices of the entries outside of the blocks called `names`, and their blocks."""
    drop = block_names(names)
    take, remaining, start = [np.empty(0, np.int64)], [], 0
    for block in blocks:
        if block.name not in drop:
            take.append(np.arange(block.start, block.start + block.size))
            remaining.append(replace(block, start=start))
            start += block.size
    return np.concatenate(take), tuple(remaining)


@dataclass(frozen=True)
class Blocks(Spec):
    """Blocks that cover all rows or columns in order; not part of the content."""

    content: bool = False

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> tuple[Block, ...]:
        if not isinstance(value, list | tuple):
            raise InvalidData(f"{name} must be a list of blocks, got {show(value)}", field=name)
        blocks = tuple(
            block if isinstance(block, Block) else self._read(f"{name}[{k}]", block)
            for k, block in enumerate(value)
        )
        next_start = 0
        for block in blocks:
            if block.start != next_start:
                raise InvalidData(
                    f"{name}: block {block.name!r} starts at {block.start}, {next_start} is next",
                    field=name,
                )
            next_start += block.size
        names = [block.name for block in blocks]
        if len(set(names)) != len(names):
            raise InvalidData(f"{name}: two blocks bear one name: {names}", field=name)
        return blocks

    kind: ClassVar[type[Block]] = Block

    @classmethod
    def _read(cls, name: str, data: Any) -> Block:
        field = name.partition("[")[0]
        try:
            block = cls.kind.from_data(data)
        except InvalidData as error:
            raise InvalidData(f"{name}: {error}", field=field) from None
        # Files name every key, so that a truncated block is no block with other places or units.
        for key in block.data():
            if key not in data:
                raise InvalidData(
                    f"{name}: key {key!r} is missing in the data of a block", field=field
                )
        return block

    def encode(self, value: tuple[Block, ...]) -> Any:
        return [block.data() for block in value]


#: Specifications of the parts of a matrix in compressed rows, in SciPy's order.
_SPARSE = {
    "data": Array(("entries",)),
    "indices": Array(("entries",), int, lower=0),
    "indptr": Array(("rows + 1",), int, lower=0),
    "shape": Array((2,), int, lower=0),
}


@dataclass(frozen=True)
class Sparse(Spec):
    """Sparse matrix in compressed rows, canonical (sorted, summed, no stored zeros)."""

    #: Names of the two dimensions.
    shape: tuple[str, str]

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> sp.csr_array:
        if isinstance(value, Mapping):
            value = self._read(name, value)
        elif not sp.issparse(value):
            value = Array(self.shape).coerce(name, value, dict(sizes))
        if value.ndim != 2 or value.dtype.kind not in "iufb":
            raise InvalidData(
                f"{name} must be a matrix of numbers, got {value.ndim} dimensions of {value.dtype}",
                field=name,
            )
        matrix = sp.csr_array(value, dtype=float, copy=True)
        with np.errstate(over="ignore", invalid="ignore"):
            matrix.sum_duplicates()
        matrix.eliminate_zeros()
        for actual, expected in zip(matrix.shape, self.shape, strict=True):
            known, source = sizes.setdefault(expected, (actual, name))
            if known != actual:
                raise InvalidData(
                    f"{name} has shape {matrix.shape}, but {source} has {known} entries", field=name
                )
        bad = np.flatnonzero(~np.isfinite(matrix.data))
        if bad.size:
            row = int(np.searchsorted(matrix.indptr, bad[0], side="right")) - 1
            raise InvalidData(
                f"{name}[{row}, {matrix.indices[bad[0]]}] must be finite, got {matrix.data[bad[0]]}",
                field=name,
            )
        return self.refreeze(matrix)

    @staticmethod
    def _read(name: str, data: Mapping[str, Any]) -> sp.csr_array:
        if set(data) != {"shape", "indptr", "indices", "data"}:
            raise InvalidData(f"{name} needs the keys shape, indptr, indices, data", field=name)
        try:
            parts = {key: spec.coerce(key, data[key], {}) for key, spec in _SPARSE.items()}
            last, count = parts["indptr"][-1:], parts["data"].size
            if (last != count).any():
                raise InvalidData(f"indptr ends at {last[0]}, {count} entries are given")
            shape = tuple(parts.pop("shape").tolist())
            matrix = sp.csr_array(tuple(parts.values()), shape=shape)
            matrix.check_format()
        except (ValueError, TypeError, OverflowError) as error:
            raise InvalidData(f"{name} is no sparse matrix: {error}", field=name) from None
        return matrix

    def encode(self, value: sp.csr_array) -> Any:
        return {
            "shape": list(value.shape),
            "indptr": value.indptr.tolist(),
            "indices": value.indices.tolist(),
            "data": value.data.tolist(),
        }

    def feed(self, value: sp.csr_array) -> Iterable[bytes]:
        yield repr(value.shape).encode()
        yield value.indptr.astype(np.int64).tobytes()
        yield value.indices.astype(np.int64).tobytes()
        yield value.data.tobytes()

    def refreeze(self, value: sp.csr_array) -> sp.csr_array:
        for part in ("data", "indices", "indptr"):
            setattr(value, part, frozen(getattr(value, part)))
        return value
