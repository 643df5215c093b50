"""What is used up on the way: its rate, and by kind of point its limit, its gain and its reset."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from ...errors import InvalidData
from ..declaration import Declared
from ..fields import Real, Spec, Text, declared, show

__all__ = ["ByKind", "Resource"]


@dataclass(frozen=True)
class ByKind(Spec):
    """Numbers >= 0 by kind of point: a mapping, kept as pairs in the order of the words."""

    def coerce(
        self, name: str, value: Any, sizes: dict[str, tuple[int, str]]
    ) -> tuple[tuple[str, float], ...]:
        if isinstance(value, tuple) and all(
            isinstance(pair, tuple) and len(pair) == 2 for pair in value
        ):
            value = dict(value)
        if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
            raise InvalidData(
                f"{name} must be an object of numbers by kind of point, got {show(value)}",
                field=name,
            )
        return tuple(
            (str(key), Real(lower=0).coerce(f"{name}[{key!r}]", value[key], {}))
            for key in sorted(value)
        )

    def encode(self, value: tuple[tuple[str, float], ...]) -> Any:
        return dict(value)

    def feed(self, value: tuple[tuple[str, float], ...]) -> Iterable[bytes]:
        yield repr(value).encode()


@dataclass(frozen=True, eq=False)
class Resource(Declared):
    """One resource of a :class:`~crosstrack.models.ResourceRouting`, such as an error, time, energy.

    It grows by `rate` times the length of an arc, by what the arc list says of it, and by the gain
    of the point that is reached. Then it must not exceed the point's limit. Then the point resets it
    to the lesser of what there is and the reset: 0 resets it altogether.

    Parameters
    ----------
    name : str
        What it is called in checks.
    rate : float
        Used for each unit of length.
    initial : float
        What there is of it at the start.
    limits, gains, resets : mapping of str to float
        By kind of point. Without a limit nothing is refused, without a gain nothing is added, and
        without a reset it is kept.
    unit : str
        Its unit, for checks and pictures.
    """

    name: str = declared(Text())
    rate: float = declared(Real(lower=0), default=0.0)
    initial: float = declared(Real(lower=0), default=0.0)
    limits: Any = declared(ByKind(), default=())
    gains: Any = declared(ByKind(), default=())
    resets: Any = declared(ByKind(), default=())
    unit: str = declared(Text(), default="")
