"""Specifications of single values: how a field is coerced, checked, frozen and written as JSON."""

from __future__ import annotations

import dataclasses
import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidData, show

__all__ = [
    "TRUSTED",
    "Flag",
    "Optional",
    "Real",
    "Spec",
    "Text",
    "Whole",
    "as_number",
    "count_rows",
    "declared",
    "entry_name",
    "frozen",
    "required",
    "show",
    "unwritable",
]

Kind = TypeVar("Kind")

#: Whether the caller trusts the author of the data being read.
TRUSTED: ContextVar[bool] = ContextVar("trusted", default=False)


def required(name: str, value: Any, kind: type[Kind]) -> Kind:
    """Return `value`, or raise :class:`InvalidData` if it is not an instance of `kind`."""
    if not isinstance(value, kind):
        raise InvalidData(f"{name} must be a {kind.__name__}, got {show(value)}", field=name)
    return value


def unwritable(text: str) -> bool:
    """Return whether `text` contains a lone surrogate, which cannot be encoded as UTF-8."""
    return any("\ud800" <= character <= "\udfff" for character in text)


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """Return `array` in read-only memory, copied unless it already is.

    Clearing NumPy's write flag is not enough: a backend could set it again, and a verification must
    not read data that a backend has changed.
    """
    base: Any = array
    while isinstance(base, np.ndarray) and not base.flags.writeable:
        base = base.base
    if isinstance(base, bytes):
        return array
    # NumPy rejects an empty buffer even for a shape without entries.
    return np.ndarray(array.shape, array.dtype, array.tobytes() or bytes(array.itemsize))


class Spec(ABC):
    """Specification of one field: its check, its JSON form and its share of the digest."""

    #: Whether the field is part of the content that the digest identifies.
    content: bool = True

    @abstractmethod
    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Any:
        """Return the checked, coerced and frozen value, or raise :class:`InvalidData`.

        `sizes` maps the named dimensions so far to their length and the field that fixed it.
        """

    def encode(self, value: Any) -> Any:
        """Return the JSON value for `value`."""
        return value

    def feed(self, value: Any) -> Iterable[bytes]:
        """Yield the bytes that identify `value` in a digest."""
        yield repr(value).encode()

    def refreeze(self, value: Any) -> Any:
        """Return `value` frozen again after unpickling."""
        return value


def declared(spec: Spec, *, hidden: bool = False, added: bool = False, **options: Any) -> Any:
    """Return a dataclass field that carries `spec`.

    Parameters
    ----------
    spec : Spec
        Specification of the field.
    hidden : bool
        Whether only the verification may read the field. Backends receive the model without it, see
        :meth:`crosstrack.models.Model.blinded`. A value computed from it in the constructor must be
        hidden as well.
    added : bool
        Whether the field was added to a model that is in use. It then enters the digest and the JSON
        data only if it differs from its default, so that stored digests stay valid.
    **options
        Arguments for ``dataclasses.field``.
    """
    if hidden and "default" in options:
        # A default would be a class attribute, which a blinded model would return.
        value = options.pop("default")
        options["default_factory"] = lambda: value
    return dataclasses.field(metadata={"spec": spec, "hidden": hidden, "added": added}, **options)


#: Accepted types of numbers; Booleans, which are integers in Python, are excluded separately.
_NUMBER = int | float | np.integer | np.floating


def as_number(name: str, value: Any, field: str | None = None) -> float:
    """Return `value` as a float; errors name `field`, by default `name`."""
    field = name if field is None else field
    if isinstance(value, np.ndarray):
        if value.ndim or value.dtype.kind not in "iuf" or np.ma.is_masked(value):
            raise InvalidData(f"{name} must be a single number, got {show(value)}", field=field)
        value = value[()]
    if isinstance(value, bool | np.timedelta64) or not isinstance(value, _NUMBER):
        raise InvalidData(f"{name} must be a number, got {show(value)}", field=field)
    try:
        return float(value)
    except OverflowError:
        raise InvalidData(
            f"{name} must be within the range of floats, got {show(value)}", field=field
        ) from None


@dataclass(frozen=True)
class Real(Spec):
    """Finite real number.

    Parameters
    ----------
    lower, upper : float, optional
        Closed range of the value; None for no limit.
    strict : bool
        Whether `lower` itself is excluded.
    unit : str
        Unit shown in error messages.
    """

    lower: float | None = None
    upper: float | None = None
    strict: bool = False
    unit: str = ""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> float:
        number = as_number(name, value)
        unit = f" {self.unit}" if self.unit else ""
        if not math.isfinite(number):
            raise InvalidData(f"{name} must be finite, got {number}", field=name)
        if self.lower is not None and (
            number < self.lower or (self.strict and number == self.lower)
        ):
            sign = ">" if self.strict else ">="
            raise InvalidData(
                f"{name} must be {sign} {self.lower:g}{unit}, got {number:g}", field=name
            )
        if self.upper is not None and number > self.upper:
            raise InvalidData(f"{name} must be <= {self.upper:g}{unit}, got {number:g}", field=name)
        return number + 0.0


@dataclass(frozen=True)
class Whole(Spec):
    """Integer.

    Parameters
    ----------
    lower, upper : int, optional
        Closed range of the value; None for no limit.
    """

    lower: int | None = None
    upper: int | None = None

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> int:
        number = as_number(name, value)
        if not number.is_integer():
            raise InvalidData(f"{name} must be a whole number, got {show(value)}", field=name)
        if self.lower is not None and number < self.lower:
            raise InvalidData(f"{name} must be >= {self.lower}, got {number:g}", field=name)
        if self.upper is not None and number > self.upper:
            raise InvalidData(f"{name} must be <= {self.upper}, got {number:g}", field=name)
        return int(number) if isinstance(value, float | np.floating | np.ndarray) else int(value)


@dataclass(frozen=True)
class Flag(Spec):
    """True or False; numbers and strings are rejected."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> bool:
        if not isinstance(value, bool | np.bool_):
            raise InvalidData(f"{name} must be true or false, got {show(value)}", field=name)
        return bool(value)


@dataclass(frozen=True)
class Text(Spec):
    """String that can be encoded as UTF-8.

    Parameters
    ----------
    content : bool
        Whether the string is part of the content that the digest identifies.
    """

    content: bool = True

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> str:
        if not isinstance(value, str):
            raise InvalidData(f"{name} must be a string, got {show(value)}", field=name)
        if unwritable(value):
            raise InvalidData(f"{name} holds half a character: it is no UTF-8", field=name)
        return str(value)


@dataclass(frozen=True)
class Optional(Spec):
    """None, or a value that `spec` allows.

    Parameters
    ----------
    spec : Spec
        Specification of values other than None.
    """

    spec: Spec

    def __post_init__(self) -> None:
        object.__setattr__(self, "content", self.spec.content)

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Any:
        return None if value is None else self.spec.coerce(name, value, sizes)

    def encode(self, value: Any) -> Any:
        return None if value is None else self.spec.encode(value)

    def feed(self, value: Any) -> Iterable[bytes]:
        return [b"none"] if value is None else self.spec.feed(value)

    def refreeze(self, value: Any) -> Any:
        return None if value is None else self.spec.refreeze(value)


def count_rows(name: str, actual: int, rows: str, sizes: dict[str, tuple[int, str]]) -> None:
    """Fix the length of the dimension `rows`, or raise if an earlier field has another length."""
    known, source = sizes.setdefault(rows, (actual, name))
    if known != actual:
        raise InvalidData(f"{name} has {actual} entries where {source} has {known}", field=name)


def entry_name(name: str, place: tuple[int, ...]) -> str:
    """Return the name of an entry of an array in messages, such as ``points[0, 2]``."""
    return f"{name}[{', '.join(map(str, place))}]" if place else name
