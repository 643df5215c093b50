"""Specifications of arrays and tuples of numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidData, show
from .specs import Spec, as_number, count_rows, entry_name, frozen

__all__ = ["Array", "Broadcast", "NumberTuple"]


@dataclass(frozen=True)
class Array(Spec):
    """Numeric array with a declared shape.

    Parameters
    ----------
    shape : tuple of int or str
        Length of each dimension, or a name; equal names mean equal lengths in all fields.
    dtype : type
        ``float``, ``int`` or ``bool``.
    lower, upper : float, optional
        Closed range of the entries; None for no limit.
    infinity : {0, -1, 1}
        Infinite value that is allowed: none (0), -inf (-1) or inf (1). JSON writes it as null.
    unit : str
        Unit of the entries, for lists of the fields; empty for none.
    """

    shape: tuple[int | str, ...]
    dtype: type = float
    lower: float | None = None
    upper: float | None = None
    infinity: int = 0
    unit: str = ""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> NDArray[Any]:
        array = self._numbers(name, value)
        array = self._check_shape(name, array, sizes)
        if self.dtype is float:
            with np.errstate(over="ignore", invalid="ignore"):
                plain = math.isfinite(array.sum())  # one pass, which nearly always suffices
            if not plain:
                bad = ~np.isfinite(array)
                if self.infinity:
                    bad &= array != self.infinity * math.inf
                self._refuse(name, array, bad, "must be finite")
        if self.lower is not None:
            self._refuse(name, array, array < self.lower, f"must be >= {self.lower:g}")
        if self.upper is not None:
            self._refuse(name, array, array > self.upper, f"must be <= {self.upper:g}")
        return frozen(array)

    def _numbers(self, name: str, value: Any) -> NDArray[Any]:
        if isinstance(value, str | bytes | dict | set):
            raise InvalidData(f"{name} must be an array of numbers, got {show(value)}", field=name)
        if np.ma.is_masked(value):
            raise InvalidData(f"{name} must not hold masked entries", field=name)
        try:
            raw = np.asarray(value)
        except Exception:  # ragged, nested too deeply, or an error of a custom conversion
            raise InvalidData(f"{name} {self._ragged(value)}", field=name) from None
        if self.dtype is not bool and isinstance(value, list | tuple):
            _reject_booleans(name, value, ())
        if raw.size == 0:
            return np.empty(raw.shape, self.dtype)
        if self.dtype is bool:
            return self._booleans(name, raw)
        # A string turns the whole array into strings: search the original for the wrong entry.
        numbers = raw if raw.dtype.kind in "iuf" else self._objects(name, value)
        if self.dtype is int and numbers.dtype.kind == "i":
            return np.array(numbers, dtype=int)
        if self.dtype is int:
            whole = np.isfinite(numbers) & (numbers == np.floor(numbers))
            whole &= (numbers >= -(2.0**63)) & (numbers < 2.0**63)
            self._refuse(name, numbers, ~whole, "must be whole numbers of 64 bits")
            return numbers.astype(int)
        result = np.empty(numbers.shape)
        with np.errstate(over="ignore"):  # only numbers with more bits than a float can overflow
            np.add(numbers, 0.0, out=result, casting="same_kind")  # -0.0 becomes 0.0
        if numbers.dtype.itemsize > result.itemsize:
            beyond = np.isinf(result) & np.isfinite(numbers)
            self._refuse(name, numbers, beyond, "must be within the range of floats")
        return result

    def _booleans(self, name: str, raw: NDArray[Any]) -> NDArray[Any]:
        if raw.dtype.kind in "iu":
            self._refuse(name, raw, (raw != 0) & (raw != 1), "must be true or false")
        elif raw.dtype.kind != "b":
            raise InvalidData(f"{name} must hold true or false, got {show(raw)}", field=name)
        return raw.astype(bool)

    def _objects(self, name: str, value: Any) -> NDArray[Any]:
        """Return the numbers of a mixed array, with None as infinity if that is allowed."""
        objects = np.asarray(value, dtype=object)
        for place in np.ndindex(objects.shape):
            entry = objects[place]
            if entry is None and self.infinity:
                objects[place] = self.infinity * math.inf
            else:
                objects[place] = as_number(entry_name(name, place), entry, name)
        return objects.astype(float)

    def _ragged(self, value: Any) -> str:
        if len(self.shape) == 2 and isinstance(value, list | tuple):
            for row, entry in enumerate(value):
                size = len(entry) if isinstance(entry, list | tuple) else None
                if size is None or (isinstance(self.shape[1], int) and size != self.shape[1]):
                    return f"row {row} must hold {self.shape[1]} numbers, got {show(entry)}"
        return f"must be an array of shape {self._shape_text()}, got {show(value)}"

    def _check_shape(
        self, name: str, array: NDArray[Any], sizes: dict[str, tuple[int, str]]
    ) -> NDArray[Any]:
        if array.size == 0 and array.ndim == 1 and len(self.shape) > 1:
            rest = [d if isinstance(d, int) else sizes.get(d, (0, ""))[0] for d in self.shape[1:]]
            array = array.reshape([0, *rest])
        mismatch = array.ndim != len(self.shape) or any(
            isinstance(expected, int) and actual != expected
            for actual, expected in zip(array.shape, self.shape, strict=False)
        )
        if mismatch:
            raise InvalidData(
                f"{name} must have shape {self._shape_text()}, got {array.shape}", field=name
            )
        for actual, expected in zip(array.shape, self.shape, strict=True):
            if isinstance(expected, str):
                count_rows(name, actual, expected, sizes)
        return array

    def _shape_text(self) -> str:
        return "(" + ", ".join(map(str, self.shape)) + ("," if len(self.shape) == 1 else "") + ")"

    def _refuse(self, name: str, array: NDArray[Any], bad: NDArray[Any], rule: str) -> None:
        if bad.any():
            place = tuple(int(k) for k in np.argwhere(bad)[0])
            raise InvalidData(f"{entry_name(name, place)} {rule}, got {array[place]}", field=name)

    def encode(self, value: NDArray[Any]) -> Any:
        if self.infinity and not np.isfinite(value).all():
            objects = value.astype(object)
            objects[~np.isfinite(value)] = None
            return objects.tolist()
        return value.tolist()

    def feed(self, value: NDArray[Any]) -> Iterable[bytes]:
        yield repr((value.dtype.str, value.shape)).encode()
        yield value.tobytes()

    def refreeze(self, value: NDArray[Any]) -> NDArray[Any]:
        return frozen(value)


@dataclass(frozen=True)
class NumberTuple(Array):
    """Row of numbers, stored as a tuple of Python numbers.

    Parameters
    ----------
    shape : tuple of one int or str
        Number of entries, or its name.
    dtype, lower, upper, infinity, unit
        See :class:`Array`.
    """

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Any:
        return tuple(super().coerce(name, value, sizes).tolist())

    def encode(self, value: Any) -> Any:
        return list(value)

    def feed(self, value: Any) -> Iterable[bytes]:
        yield repr(value).encode()

    def refreeze(self, value: Any) -> Any:
        return value


def _reject_booleans(name: str, value: Any, place: tuple[int, ...]) -> None:
    """Raise if a list of numbers contains a Boolean, which NumPy would convert to 0 or 1."""
    if {bool, np.bool_, list, tuple}.isdisjoint(map(type, value)):
        return
    for index, entry in enumerate(value):
        if isinstance(entry, bool | np.bool_):
            raise InvalidData(
                f"{entry_name(name, (*place, index))} must be a number, got {entry}", field=name
            )
        if isinstance(entry, list | tuple):
            _reject_booleans(name, entry, (*place, index))


@dataclass(frozen=True)
class Broadcast(Array):
    """Table with one row per segment between two knots, given in full or by a broadcastable shape.

    A number applies to all entries, one row to all segments, and one column to all axes. The value
    is stored in full, with one row fewer than there are knots.

    Parameters
    ----------
    shape : tuple of str
        Names of the dimensions of the knots and of the columns, which an earlier field must fix.
    dtype, lower, upper, infinity, unit
        See :class:`Array`.
    """

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> NDArray[Any]:
        array = self._numbers(name, value)
        rows, columns = (sizes[str(part)][0] for part in self.shape)
        full = (max(rows - 1, 0), columns)
        fits = array.ndim <= 2 and all(
            actual in (1, expected)
            for actual, expected in zip(array.shape[::-1], full[::-1], strict=False)
        )
        if not fits:
            raise InvalidData(
                f"{name} must be a number, one for each of {columns} dimensions, or have shape "
                f"{full} (segments, dimensions), got shape {array.shape}",
                field=name,
            )
        place = {"knots": (full[0], name), "columns": (full[1], name)}
        inner = Array(("knots", "columns"), float, self.lower, self.upper, self.infinity)
        # Check before broadcasting, so that a message names the entry of the argument.
        shown = np.atleast_2d(array) if array.ndim else array.reshape(1, 1)
        inner.coerce(name, shown, {})
        return inner.coerce(name, np.broadcast_to(shown, full), place)
