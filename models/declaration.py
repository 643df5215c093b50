"""Frozen data classes with declared fields: plans, models and the parts of models."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ..errors import InvalidData, suggestion
from .records import Several
from .specs import Spec, show

__all__ = ["Declared", "Listed", "Nested", "Plan"]


class _Frozen:
    """Base whose instances have no other attributes than fields, whether a subclass is decorated or not."""

    if not TYPE_CHECKING:  # otherwise type checkers would accept every name

        def __setattr__(self, name: str, value: Any) -> None:
            raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")

        def __delattr__(self, name: str) -> None:
            raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")


@dataclass(frozen=True, eq=False)
class Declared(_Frozen):
    """Base of frozen data classes whose fields are declared with a :class:`Spec`.

    The constructor copies, coerces, checks and freezes the values. Unpickling does the same.
    :meth:`data` writes them as JSON data. Subclasses are frozen dataclasses with ``eq=False``.
    """

    @np.errstate(all="ignore")  # the specs reject values that overflow
    def __post_init__(self) -> None:
        sizes: dict[str, tuple[int, str]] = {}
        for name, spec in self._specs():
            object.__setattr__(self, name, spec.coerce(name, getattr(self, name), sizes))
        self.check()

    def check(self) -> None:
        """Raise :class:`~crosstrack.errors.InvalidData` if fields contradict one another."""

    @classmethod
    @cache  # plans are built in loops
    def _specs(cls) -> tuple[tuple[str, Spec], ...]:
        fields = (field for field in dataclasses.fields(cls) if "spec" in field.metadata)
        return tuple((field.name, field.metadata["spec"]) for field in fields)

    def _content(self) -> Iterator[tuple[str, Spec, Any]]:
        """Yield name, spec and value of each declared field, without added fields at their default."""
        for field in dataclasses.fields(self):
            if (spec := field.metadata.get("spec")) is not None:
                value: Any = getattr(self, field.name)
                default: Any = field.default
                if callable(field.default_factory):  # that of a hidden field
                    default = field.default_factory()
                may_omit = field.metadata.get("added") and type(value) is type(default)
                if not (may_omit and np.array_equal(value, default)):
                    yield field.name, spec, value

    def _feed(self) -> Iterator[bytes]:
        """Yield the bytes that identify the content.

        Texts are written with ``repr`` and arrays with their size, so that no value can imitate the name
        of an omitted field.
        """
        for name, spec, value in self._content():
            yield f"\0{name}\0".encode()
            yield from spec.feed(value)

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        specs = dict(self._specs())
        for name, value in state.items():
            object.__setattr__(self, name, specs[name].refreeze(value) if name in specs else value)

    def data(self) -> dict[str, Any]:
        """Return the content as JSON data (no NaN, no infinity).

        A field that a later version added is omitted at its default, so that older files keep their
        form.
        """
        return {name: spec.encode(value) for name, spec, value in self._content()}

    @classmethod
    def from_data(cls, data: Any) -> Self:
        """Return the object that :meth:`data` wrote; unknown and missing keys raise ``InvalidData``."""
        return cls._from_data(data)

    @classmethod
    def input_names(cls) -> frozenset[str]:
        """Return names of constructor arguments that are not fields."""
        return frozenset()

    @classmethod
    def _label(cls) -> str:
        """Return the name of the class in error messages."""
        return f"a {cls.__name__.lower()}"

    @classmethod
    def _from_data(cls, data: Any, **others: Any) -> Self:
        """Return the object with the fields in `data`; `others` are fields from other sources."""
        if not isinstance(data, Mapping):
            raise InvalidData(f"data must be an object, got {show(data)}", field="data")
        known = {f.name: f for f in dataclasses.fields(cls) if f.init and f.name not in others}
        extra = cls.input_names()
        for key in data:
            if key not in known and key not in extra:
                allowed = sorted({*known, *extra})
                raise InvalidData(
                    f"unknown key {key!r} in the data of {cls._label()}; "
                    f"{suggestion(key, allowed)}allowed: {', '.join(allowed)}",
                    field=str(key),
                )
        missing = [
            key
            for key, field in known.items()
            if key not in data
            and field.default is dataclasses.MISSING
            and field.default_factory is dataclasses.MISSING
        ]
        if missing:
            phrase = "key {} is" if len(missing) == 1 else "keys {} are"
            raise InvalidData(
                f"{phrase.format(', '.join(map(repr, missing)))} missing in the data of "
                f"{cls._label()}; allowed: {', '.join(sorted({*known, *extra}))}",
                field=missing[0],
            )
        return cls(**{str(key): value for key, value in data.items()}, **others)


@dataclass(frozen=True)
class Nested(Spec):
    """Field that holds another declared object, given as such or as its JSON data.

    Parameters
    ----------
    kind : type
        Class of the object.
    """

    kind: type[Declared]

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Declared:
        if isinstance(value, self.kind):
            return value
        if not isinstance(value, Mapping):
            raise InvalidData(f"{name} must be an object, got {show(value)}", field=name)
        return self.kind.from_data(value)

    def encode(self, value: Declared) -> Any:
        return value.data()

    def feed(self, value: Declared) -> Iterable[bytes]:
        return value._feed()


class Listed(Several):
    """Field that holds a tuple of declared objects of one class.

    Parameters
    ----------
    kind : type
        Class of the objects.
    """

    def __init__(self, kind: type[Declared]) -> None:
        super().__init__(Nested(kind))


@dataclass(frozen=True, eq=False)
class Plan(Declared):
    """Base of plans: frozen data classes with declared fields that are compared by content."""

    def to_data(self) -> dict[str, Any]:
        """Return the plan as JSON data."""
        return self.data()

    @classmethod
    def from_data(cls, data: Any) -> Self:
        """Return the plan that :meth:`to_data` wrote.

        Parameters
        ----------
        data : mapping
            JSON data, with one key per field.

        Raises
        ------
        InvalidData
            A key is missing or unknown, or a value is invalid; the error names both.
        """
        if not isinstance(data, Mapping):
            keys = [field.name for field in dataclasses.fields(cls) if "spec" in field.metadata]
            raise InvalidData(
                f"a plan must be an object with the key{'s' * (len(keys) > 1)} {', '.join(keys)}, "
                f"got {show(data)}",
                field="plan",
            )
        return cls._from_data(data)

    @classmethod
    def _label(cls) -> str:
        return "a plan"

    def __eq__(self, other: object) -> bool:
        """Return whether `other` is a plan of the same type with the same content."""
        if type(self) is not type(other):
            return NotImplemented
        return self is other or tuple(self._feed()) == tuple(other._feed())

    def __hash__(self) -> int:
        return hash(tuple(self._feed()))
