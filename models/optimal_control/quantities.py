"""Quantities and restrictions: named vectors with bounds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Declared
from ..fields import Array, Flag, Text, declared, show

__all__ = [
    "SIDES", "Quantity", "Restriction", "check_algebraic", "check_order", "entry_names", "entry_slices",
    "entry_units", "stacked",
]  # fmt: skip

Floats = NDArray[np.float64]

#: Bounds of a quantity at every instant and at both ends.
SIDES = ("lower", "upper", "initial_lower", "initial_upper", "final_lower", "final_upper")
_LOW = Array(("size",), infinity=-1)
_HIGH = Array(("size",), infinity=1)


def check_order(name: str, low: Any, high: Any, field: str = "") -> None:
    """Raise if a lower bound exceeds the upper one."""
    low, high = np.atleast_1d(low), np.atleast_1d(high)
    bad = np.flatnonzero(~(low <= high))
    if bad.size:
        raise InvalidData(
            f"{name}: lower {low[bad[0]]:g} exceeds upper {high[bad[0]]:g}", field=field or name
        )


def _check_entries(of: str, item: Any) -> None:
    if not item.name or any(c in item.name for c in "[]"):
        raise InvalidData(
            f"{of} must have a name without brackets, got {item.name!r}", field="name"
        )
    if not item.size:
        raise InvalidData(f"{of} {item.name!r} must have 1 entry at least, got 0", field="lower")
    if not (item.scale > 0).all():
        raise InvalidData(f"scale of {item.name!r} must be > 0, got {item.scale}", field="scale")


class _Bounded(Declared):
    """Base of vectors with bounds."""

    lower: Floats

    @property
    def size(self) -> int:
        """Number of entries."""
        return int(self.lower.size)


ItemT = TypeVar("ItemT", bound=_Bounded)


@dataclass(frozen=True, eq=False)
class Quantity(_Bounded):
    """State, control or parameter: a vector with bounds, whose fields have the shape (size,).

    The name has no brackets. Equal bounds at an end of the phase fix the value there, and `scale` is the
    positive typical size. All bounds of data (`given`) equal their value. Solvers relax `integer` controls, and
    :func:`~.rounding.round_controls` rounds them. `algebraic` controls are algebraic variables, which algebraic
    equations determine.
    """

    name: str = declared(Text())
    lower: Floats = declared(_LOW)
    upper: Floats = declared(_HIGH)
    initial_lower: Floats = declared(_LOW)
    initial_upper: Floats = declared(_HIGH)
    final_lower: Floats = declared(_LOW)
    final_upper: Floats = declared(_HIGH)
    scale: Floats = declared(Array(("size",), lower=0))
    unit: str = declared(Text(), default="")
    given: bool = declared(Flag(), default=False, added=True)
    integer: bool = declared(Flag(), default=False, added=True)
    algebraic: bool = declared(Flag(), default=False, added=True)

    def read(self, value: Any) -> Floats:
        """Return `value` as a value of this data, shape (size,); a number is broadcast, other sizes raise."""
        try:
            result = np.asarray(value)
            if result.dtype.kind not in "iuf" or np.ma.is_masked(value):
                raise TypeError
            result = np.broadcast_to(result.astype(float), (self.size,))
        except (TypeError, ValueError):
            result = np.array([np.nan])
        if not np.isfinite(result).all():
            words = "a finite number" if self.size == 1 else f"{self.size} finite numbers, or one"
            raise InvalidData(
                f"data {self.name!r} must be {words}, got {show(value)}", field=self.name
            )
        return result

    def holding(self, value: Any) -> Quantity:
        """Return this data with another value, converted by :meth:`read`."""
        changes: dict[str, Any] = dict.fromkeys(SIDES, self.read(value))
        return replace(self, **changes)

    def check(self) -> None:
        """Raise if bounds contradict one another."""
        _check_entries("a quantity", self)
        edges = np.concatenate([self.lower, self.upper])
        if self.integer and not (np.isfinite(edges) & (edges == np.round(edges))).all():
            raise InvalidData(
                f"bounds of the integer control {self.name!r} must be whole numbers, "
                f"got {show(edges.tolist())}",
                field="integer",
            )
        if self.given and (self.lower != self.upper).any():
            raise InvalidData(
                f"data {self.name!r} must have its value for both bounds, got {self.lower} and "
                f"{self.upper}",
                field="given",
            )
        for side in ("", "initial_", "final_"):
            low, high = getattr(self, f"{side}lower"), getattr(self, f"{side}upper")
            check_order(f"{side}bounds of {self.name!r}", low, high, f"{side}bounds")


def entry_names(quantities: Iterable[Quantity | Restriction]) -> tuple[str, ...]:
    """Return one name per entry: ``"x"`` for a scalar, ``"q[0]", "q[1]"`` for a vector."""
    names: list[str] = []
    for item in quantities:
        names += [item.name] if item.size == 1 else [f"{item.name}[{k}]" for k in range(item.size)]
    return tuple(names)


def entry_units(items: Iterable[Quantity | Restriction]) -> list[str]:
    """Return one unit per entry."""
    return [item.unit for item in items for _ in range(item.size)]


def stacked(items: Iterable[Quantity | Restriction], field: str) -> Floats:
    """Return a field of all items as a vector."""
    return np.concatenate([*(getattr(item, field) for item in items), np.empty(0)])


def entry_slices(items: Iterable[ItemT]) -> Iterator[tuple[ItemT, slice]]:
    """Yield each item with the places of its entries in the stacked vector."""
    start = 0
    for item in items:
        yield item, slice(start, start + item.size)
        start += item.size


@dataclass(frozen=True, eq=False)
class Restriction(_Bounded):
    """Bounds on an expression, shape (size,): a path or a boundary constraint.

    Equal bounds make an equality constraint, and `scale` is the positive typical size. `equation` is the number
    in the paper. An `algebraic` path constraint is an equation that determines algebraic variables.
    """

    name: str = declared(Text())
    equation: str = declared(Text())
    unit: str = declared(Text())
    lower: Floats = declared(_LOW)
    upper: Floats = declared(_HIGH)
    scale: Floats = declared(Array(("size",), lower=0))
    algebraic: bool = declared(Flag(), default=False, added=True)

    def check(self) -> None:
        """Raise if bounds contradict one another."""
        _check_entries("a constraint", self)
        check_order(f"bounds of {self.name!r}", self.lower, self.upper, "bounds")


def check_algebraic(label: str, controls: Iterable[Quantity], paths: Iterable[Restriction]) -> None:
    """Raise unless there is one algebraic equation per entry of an algebraic variable."""
    variables = [item for item in controls if item.algebraic]
    equations = [item for item in paths if item.algebraic]
    counts = [sum(item.size for item in items) for items in (variables, equations)]
    if counts[0] != counts[1] or any((item.lower != item.upper).any() for item in equations):
        names = ", ".join(repr(item.name) for item in variables) or "none"
        raise InvalidData(
            f"{label}: the algebraic variables ({names}) have {counts[0]} entries and need as many "
            f"algebraic equations, got {counts[1]}",
            field="algebraic",
        )
