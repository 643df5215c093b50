"""Specifications of composite values: lists, tables and members."""

from __future__ import annotations

from collections import abc
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from ..errors import InvalidData
from ..lazy import moved
from .specs import Spec, count_rows, show

__all__ = ["Anything", "Member", "Sequence", "Several", "Table", "given"]

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__ = moved(__name__, {".stored": "recorded"})


@dataclass(frozen=True)
class Anything(Spec):
    """Any value; it is checked elsewhere."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Any:
        return value


@dataclass(frozen=True)
class Several(Spec):
    """Tuple of values with one specification; the dimensions of an entry are its own.

    Parameters
    ----------
    spec : Spec
        Specification of each entry.
    rows : str
        Name of the dimension that the entries count; empty if no other field counts them.
    """

    spec: Spec
    rows: str = ""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> tuple[Any, ...]:
        if isinstance(value, str | bytes | Mapping) or not isinstance(value, abc.Sequence):
            raise InvalidData(f"{name} must be a list, got {show(value)}", field=name)
        entries = tuple(self.spec.coerce(f"{name}[{k}]", v, {}) for k, v in enumerate(value))
        if self.rows:
            count_rows(name, len(entries), self.rows, sizes)
        return entries

    def encode(self, value: tuple[Any, ...]) -> Any:
        return [self.spec.encode(entry) for entry in value]

    def feed(self, value: tuple[Any, ...]) -> Iterable[bytes]:
        yield repr(len(value)).encode()
        for entry in value:
            yield from self.spec.feed(entry)

    def refreeze(self, value: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(map(self.spec.refreeze, value))


class Sequence(Several):
    """List of any values, read as a tuple."""

    def __init__(self) -> None:
        super().__init__(Anything())


@dataclass(frozen=True)
class Table(Spec):
    """Mapping with string keys, read as a dict.

    Parameters
    ----------
    known : mapping of str to Spec
        Specifications of certain entries, applied if they are present.
    others : Spec
        Specification of all other entries.
    """

    known: Mapping[str, Spec] = field(default_factory=dict)
    others: Spec = field(default_factory=Anything)

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> dict[str, Any]:
        if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
            raise InvalidData(f"{name} must be an object, got {show(value)}", field=name)
        for key, entry in value.items():  # checked only: the values are kept uncoerced
            self.known.get(key, self.others).coerce(f"{name}.{key}", entry, sizes)
        return dict(value)


@dataclass(frozen=True)
class Member(Spec):
    """Member of a ``StrEnum``, or its value.

    Parameters
    ----------
    kind : type
        The enumeration.
    """

    kind: type[StrEnum]

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> StrEnum:
        if isinstance(value, str) and value in tuple(self.kind):
            return self.kind(value)
        raise InvalidData(
            f"{name} must be one of {', '.join(self.kind)}, got {show(value)}", field=name
        )

    def encode(self, value: StrEnum) -> str:
        return str(value)


def given(name: str, value: Any) -> dict[str, Any]:
    """Return `value` as a dict of options, empty for None, or raise if it is not a mapping."""
    return {} if value is None else Table().coerce(name, value, {})
