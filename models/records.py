"""Stored records, such as solutions and verifications: what reading one back checks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from ..errors import InvalidData
from .fields import Spec, show

__all__ = ["Anything", "Member", "Sequence", "Table", "given", "recorded"]


@dataclass(frozen=True)
class Anything(Spec):
    """What is read and checked elsewhere."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Any:
        return value


@dataclass(frozen=True)
class Sequence(Spec):
    """A list of anything, as a tuple."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> tuple[Any, ...]:
        if not isinstance(value, list | tuple):
            raise InvalidData(f"{name} must be a list, got {show(value)}", field=name)
        return tuple(value)


@dataclass(frozen=True)
class Table(Spec):
    """A mapping from words to anything, as a dict.

    Parameters
    ----------
    known : mapping of str to Spec
        What certain entries must be, where they are there.
    others : Spec
        What all others must be.
    """

    known: Mapping[str, Spec] = field(default_factory=dict)
    others: Spec = field(default_factory=Anything)

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> dict[str, Any]:
        if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
            raise InvalidData(f"{name} must be an object, got {show(value)}", field=name)
        for key, one in value.items():  # checked, and kept as they stand
            self.known.get(key, self.others).coerce(f"{name}.{key}", one, sizes)
        return dict(value)


@dataclass(frozen=True)
class Member(Spec):
    """A member of a ``StrEnum``, or its word."""

    kind: type[StrEnum]

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> StrEnum:
        if isinstance(value, str) and value in tuple(self.kind):
            return self.kind(value)
        raise InvalidData(
            f"{name} must be one of {', '.join(self.kind)}, got {show(value)}", field=name
        )


def given(name: str, value: Any) -> dict[str, Any]:
    """Return the options `value`, none where it is None; what is no mapping raises."""
    return {} if value is None else Table().coerce(name, value, {})


def recorded(
    what: str, data: Any, specs: Mapping[str, Spec], defaults: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the entries of a stored record, checked; what a later version adds is left out.

    Parameters
    ----------
    what : str
        What messages call the record.
    data : mapping
        The record.
    specs : mapping of str to Spec
        How each entry is checked.
    defaults : mapping
        What stands for an entry that older records lack; others must be there.
    """
    if not isinstance(data, Mapping):
        raise InvalidData(f"{what} must be an object, got {show(data)}", field="data")
    for key in specs:
        if key not in data and key not in defaults:
            raise InvalidData(f"key {key!r} is missing in {what}", field=key)
    return {
        key: spec.coerce(key, data[key], {}) if key in data else defaults[key]
        for key, spec in specs.items()
    }
