"""Data classes whose fields are declared with a Spec: models, and the parts that models consist of."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from ..errors import InvalidData, suggestion
from .fields import Spec, show

__all__ = ["Declared", "Listed", "Nested"]


@dataclass(frozen=True, eq=False)
class Declared:
    """Base of frozen data classes whose fields are declared with a :class:`Spec`.

    Values are copied, coerced, checked and frozen on the way in, also by unpickling, and
    :meth:`data` writes them as JSON data. Subclasses are frozen dataclasses with ``eq=False``.
    """

    @np.errstate(all="ignore")  # what overflows is refused where it counts
    def __post_init__(self) -> None:
        sizes: dict[str, tuple[int, str]] = {}
        for name, spec in self._specs():
            object.__setattr__(self, name, spec.coerce(name, getattr(self, name), sizes))
        self.check()

    def check(self) -> None:
        """Raise :class:`~crosstrack.errors.InvalidData` where fields contradict one another."""

    @classmethod
    def _specs(cls) -> Iterator[tuple[str, Spec]]:
        for field in dataclasses.fields(cls):
            if "spec" in field.metadata:
                yield field.name, field.metadata["spec"]

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        specs = dict(self._specs())
        for name, value in state.items():
            object.__setattr__(self, name, specs[name].refreeze(value) if name in specs else value)

    def data(self) -> dict[str, Any]:
        """Return the content as JSON data (no NaN, no infinity).

        A field that was added later is left out at its default, as files from before it do.
        """
        found = {}
        for field in dataclasses.fields(self):
            value, spec = getattr(self, field.name), field.metadata.get("spec")
            same = type(value) is type(field.default) and value == field.default
            if field.init and spec is not None and not (same and field.metadata.get("added")):
                found[field.name] = spec.encode(value)
        return found

    @classmethod
    def from_data(cls, data: Any) -> Self:
        """Return what :meth:`data` wrote; unknown and missing keys raise ``InvalidData``."""
        return cls._from_data(data)

    @classmethod
    def input_names(cls) -> frozenset[str]:
        """Return further names that the constructor takes beside the fields."""
        return frozenset()

    @classmethod
    def _label(cls) -> str:
        """Return what messages call the data of this class."""
        return f"a {cls.__name__.lower()}"

    @classmethod
    def _from_data(cls, data: Any, **others: Any) -> Self:
        """Return what `data` holds; `others` are fields that come from elsewhere."""
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
            words = "key {} is" if len(missing) == 1 else "keys {} are"
            raise InvalidData(
                f"{words.format(', '.join(map(repr, missing)))} missing in the data of "
                f"{cls._label()}; allowed: {', '.join(sorted({*known, *extra}))}",
                field=missing[0],
            )
        return cls(**{str(key): value for key, value in data.items()}, **others)


@dataclass(frozen=True)
class Nested(Spec):
    """A part of its own, or its data.

    Parameters
    ----------
    kind : type
        The part's class.
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
        for name, spec in value._specs():
            yield f"\0{name}\0".encode()
            yield from spec.feed(getattr(value, name))


@dataclass(frozen=True)
class Listed(Spec):
    """Several parts of one kind, as a tuple."""

    kind: type[Declared]

    def coerce(
        self, name: str, value: Any, sizes: dict[str, tuple[int, str]]
    ) -> tuple[Declared, ...]:
        if not isinstance(value, list | tuple):
            raise InvalidData(f"{name} must be a list, got {show(value)}", field=name)
        return tuple(Nested(self.kind).coerce(f"{name}[{k}]", v, {}) for k, v in enumerate(value))

    def encode(self, value: tuple[Declared, ...]) -> Any:
        return [one.data() for one in value]

    def feed(self, value: tuple[Declared, ...]) -> Iterable[bytes]:
        yield repr(len(value)).encode()
        for one in value:
            yield from Nested(self.kind).feed(one)
