"""Convex cones: kinds, blocks of cone rows, and distances of vectors from cones."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Whole, declared
from ..records import Member
from .blocks import Block, Blocks

__all__ = ["ConeBlock", "ConeKind", "Cones", "inside_dual", "missing", "symmetric", "triangle"]

Vector = NDArray[np.float64]


class ConeKind(StrEnum):
    """Kinds of cones, each in one convention."""

    #: ``(t, y)`` with ``t >= |y|`` in the Euclidean norm, of any dimension.
    SECOND_ORDER = "second-order"
    #: ``(x, y, z)`` with ``y exp(x / y) <= z`` and ``y > 0``, and the limit ``x <= 0, y = 0, z >= 0``.
    EXPONENTIAL = "exponential"
    #: Lower triangle of a positive semidefinite matrix, row by row (its upper triangle column by
    #: column), with off-diagonal entries times ``sqrt(2)``: the inner product of two vectors then
    #: equals that of the matrices.
    SEMIDEFINITE = "semidefinite"


@dataclass(frozen=True, eq=False, kw_only=True)
class ConeBlock(Block):
    """Named range of rows that contains cones of one kind and dimension, one after another.

    Parameters
    ----------
    kind : ConeKind
        Kind of the cones.
    dimension : int
        Rows per cone; 0 for a block with a single cone. `size` is the number of rows of the
        block, and `index` has one row per cone.
    """

    kind: ConeKind = declared(Member(ConeKind))
    dimension: int = declared(Whole(0), default=0)

    def check(self) -> None:
        """Reject rows that hold no cones of this kind and dimension."""
        object.__setattr__(self, "dimension", self.dimension or self.size)
        n = order(self.dimension)
        rows = {ConeKind.EXPONENTIAL: 3, ConeKind.SEMIDEFINITE: n * (n + 1) // 2}
        fits = self.dimension == rows.get(self.kind, self.dimension)
        if not fits or self.size < 1 or self.dimension < 1 or self.size % self.dimension:
            raise InvalidData(
                f"cones {self.name!r}: {self.size} rows hold no {self.kind} cones of "
                f"{self.dimension} rows",
                field="cones",
            )
        super().check()

    @property
    def count(self) -> int:
        """Number of cones."""
        return self.size // self.dimension

    def of(self, rows: Vector) -> Vector:
        """Return the entries of this block, one row per cone, from a vector over all cone rows."""
        return rows[self.slice].reshape(self.count, self.dimension)

    def place(self, entry: int) -> str:
        """Return the place of the cone `entry`, which is counted within the block."""
        return "" if self.index is None and self.count == 1 else super().place(entry)


@dataclass(frozen=True)
class Cones(Blocks):
    """Blocks that cover the cone rows in order; their kinds and sizes are part of the content."""

    content: bool = True

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Any:
        blocks = super().coerce(name, value, sizes)
        for block in blocks:
            if not isinstance(block, ConeBlock):
                raise InvalidData(f"{name}: {block.name!r} is no ConeBlock", field=name)
        return blocks

    kind: ClassVar[type[Block]] = ConeBlock

    def feed(self, value: tuple[Any, ...]) -> Iterable[bytes]:
        for block in value:
            for _ in range(block.count):
                yield f"{block.kind}:{block.dimension};".encode()


def order(dimension: int) -> int:
    """Return the order of the symmetric matrix with `dimension` entries in its triangle."""
    return int((np.sqrt(8 * dimension + 1) - 1) / 2 + 0.5)


def symmetric(rows: Vector) -> Vector:
    """Return the symmetric matrices, shape (k, n, n), for triangles of shape (k, n (n + 1) / 2)."""
    n = order(rows.shape[1])
    low, high = np.tril_indices(n)
    values = np.where(low == high, rows, rows / np.sqrt(2.0))
    result = np.zeros((rows.shape[0], n, n))
    result[:, low, high] = values
    result[:, high, low] = values
    return result


def triangle(matrices: Vector) -> Vector:
    """Return the triangles, shape (k, n (n + 1) / 2), of symmetric matrices of shape (k, n, n)."""
    low, high = np.tril_indices(matrices.shape[1])
    result: Vector = matrices[:, low, high] * np.where(low == high, 1.0, np.sqrt(2.0))
    return result


def missing(kind: ConeKind, rows: Vector) -> Vector:
    """Return the violation of each cone in rows of shape (k, dimension); see :meth:`.ConicProgram.verify`."""
    if kind == ConeKind.SECOND_ORDER:
        amount = np.linalg.norm(rows[:, 1:], axis=1) - rows[:, 0]
    elif kind == ConeKind.SEMIDEFINITE:
        amount = -np.linalg.eigvalsh(symmetric(rows))[:, 0]
    else:
        # A change of z alone would be misleading for large x / y.
        amount = np.abs(_exponential(rows) - rows).max(axis=1)
    violation: Vector = np.maximum(amount, 0.0)
    return violation


def inside(kind: ConeKind, rows: Vector) -> Vector:
    """Return a point of the cone near each of `rows`, the nearest except for exponential cones."""
    if kind == ConeKind.SECOND_ORDER:
        return _second_order(rows)
    return _semidefinite(rows) if kind == ConeKind.SEMIDEFINITE else _exponential(rows)


def inside_dual(kind: ConeKind, rows: Vector) -> Vector:
    """Return a point of the dual cone near each of `rows`.

    Second-order and semidefinite cones are self-dual. A point ``(u, v, w)`` is in the dual of the
    exponential cone if ``-u exp(v / u) <= e w`` and ``u < 0``, or in its limit (documentation of
    SCS). Equivalently, ``(u - v, -u, w)`` is in the cone itself.
    """
    if kind != ConeKind.EXPONENTIAL:
        return inside(kind, rows)
    u, v, w = rows.T
    x, y, z = _exponential(np.column_stack([u - v, -u, w])).T
    return np.column_stack([-y, -y - x, z])


def _second_order(rows: Vector) -> Vector:
    t, length = rows[:, 0], np.linalg.norm(rows[:, 1:], axis=1)
    # Outside of the cone and its polar, the projection is half-way (Parikh and Boyd 2014, 6.3).
    half = np.clip((t + length) / 2 / np.maximum(length, 1e-300), 0.0, 1.0)
    share = np.where(length <= t, 1.0, half)
    tail = rows[:, 1:] * share[:, None]
    head = np.maximum(np.where(length <= t, t, 0.0), np.linalg.norm(tail, axis=1))
    return np.column_stack([head, tail])


def _semidefinite(rows: Vector) -> Vector:
    values, vectors = np.linalg.eigh(symmetric(rows))
    positive = vectors * np.maximum(values, 0.0)[:, None, :]
    projected = triangle(positive @ vectors.transpose(0, 2, 1))
    result: Vector = np.where((values[:, 0] >= 0)[:, None], rows, projected)
    return result


def _exponential(rows: Vector) -> Vector:
    """Return the nearest of three points: z increased, x decreased, or the limit ``y = 0``."""
    x, y, z = rows.T
    positive = np.where(y > 0, y, 1.0)
    with np.errstate(over="ignore"):
        raised = np.maximum(z, positive * np.exp(x / positive))
    lowered = np.minimum(x, positive * np.log(np.where(z > 0, z, 1.0) / positive))
    result = np.column_stack([np.minimum(x, 0.0), np.zeros_like(y), np.maximum(z, 0.0)])
    for valid, candidate in (
        ((y > 0) & (z > 0), np.column_stack([lowered, y, z])),
        ((y > 0) & np.isfinite(raised), np.column_stack([x, y, raised])),
    ):
        distance = np.where(valid, np.abs(candidate - rows).max(axis=1), np.inf)
        nearer = distance < np.abs(result - rows).max(axis=1)
        result = np.where(nearer[:, None], candidate, result)
    return result
