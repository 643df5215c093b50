"""Resource of a route: its rate, and its limits, gains and resets by kind of point."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from ...errors import InvalidData
from ..declaration import Declared
from ..fields import Real, Spec, Text, declared, show

__all__ = ["ByKind", "Resource"]


@dataclass(frozen=True)
class ByKind(Spec):
    """Field that maps kinds of points to numbers >= 0, stored as sorted pairs."""

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
    """Resource of a :class:`~crosstrack.models.ResourceRouting`, such as an error, time or energy.

    On an arc the level increases by `rate` times the length, by the arc's entry in `uses`, and by the
    gain of the head. This level must not exceed the head's limit, nor be below its lower limit. Waiting
    then raises it to the floor of the head, such as the opening of a time window. Finally the head resets
    the level to the minimum of the level and the reset.

    Parameters
    ----------
    name : str
        Name in checks and figures.
    rate : float
        Use per unit of length; 0 by default.
    initial : float
        Level at the start; 0 by default.
    limits, gains, resets : mapping of str to float
        Values by kind of point. Without an entry, a point has no limit, no gain or no reset.
    unit : str
        Unit for checks and figures.
    floors, lower_limits : mapping of str to float
        Further values by kind of point: the level to which waiting raises a lower one, and the least level
        on arrival. A floor must not exceed the limit of the same kind, nor a lower limit.

    Raises
    ------
    InvalidData
        A number is negative or not finite, a mapping has another form, or a floor or lower limit exceeds
        the limit of its kind.
    """

    name: str = declared(Text())
    rate: float = declared(Real(lower=0), default=0.0)
    initial: float = declared(Real(lower=0), default=0.0)
    limits: Any = declared(ByKind(), default=())
    gains: Any = declared(ByKind(), default=())
    resets: Any = declared(ByKind(), default=())
    unit: str = declared(Text(), default="")
    floors: Any = declared(ByKind(), default=(), added=True)
    lower_limits: Any = declared(ByKind(), default=(), added=True)

    def check(self) -> None:
        """Raise if a window closes before it opens."""
        limits = dict(self.limits)
        for name in ("floors", "lower_limits"):
            for word, value in getattr(self, name):
                if value > limits.get(word, math.inf):
                    raise InvalidData(
                        f"{name}[{word!r}] must be <= limits[{word!r}] = {limits[word]:g}, got {value:g}",
                        field=name,
                    )
