"""Plan of a messenger tour: times and places of the encounters, and the path between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Real, Whole, show

__all__ = ["Primitive", "TourPlan"]

Floats = NDArray[np.float64]

#: Curvature by the letter of the turn, in units of the largest curvature.
SIGNS = {"L": 1.0, "S": 0.0, "R": -1.0}
#: Upper limit on the leg number of a primitive.
MOST_LEGS = 2**31


class Primitive(NamedTuple):
    """Piece of the path: a turn at the turning radius, or a straight line.

    Parameters
    ----------
    leg : int
        Leg number: 0 leads to the first vehicle of the order, k to the next k-th vehicle. The last
        leg of a closed tour leads back.
    turn : {"L", "S", "R"}
        Left turn, straight line or right turn.
    length : float
        Length, in m.
    heading : float
        Heading at the beginning, in rad, counter-clockwise from the x axis.
    """

    leg: int
    turn: str
    length: float
    heading: float


@dataclass(frozen=True, eq=False)
class TourPlan:
    """Flight over the vehicles.

    Parameters
    ----------
    order : tuple of int
        Indices of the vehicles in the order of their encounters.
    times : ndarray, shape (n,)
        Time of each encounter, in that order, in s.
    points : ndarray, shape (n, 2)
        Position of the UAV at each encounter, in m.
    start : ndarray, shape (3,)
        Start of the path: x, y (m), heading (rad).
    primitives : tuple of Primitive
        The path.

    Raises
    ------
    InvalidData
        A field has a wrong shape or type, or a primitive has an unknown turn.
    """

    order: tuple[int, ...]
    times: Floats
    points: Floats
    start: Floats
    primitives: tuple[Primitive, ...]

    def __post_init__(self) -> None:
        sizes: dict[str, tuple[int, str]] = {}
        order = Array(("vehicles",), int).coerce("order", self.order, sizes)
        fields = {
            "order": tuple(order.tolist()),
            "times": Array(("vehicles",)).coerce("times", self.times, sizes),
            "points": Array(("vehicles", 2)).coerce("points", self.points, sizes),
            "start": Array((3,)).coerce("start", self.start, sizes),
            "primitives": _primitives(self.primitives),
        }
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    @property
    def length(self) -> float:
        """Length of the path, in m."""
        # Overflow yields inf, which the verification reports as a violation.
        return float(sum(primitive.length for primitive in self.primitives))

    def leg(self, number: int) -> tuple[Primitive, ...]:
        """Return the primitives of leg `number`."""
        return tuple(primitive for primitive in self.primitives if primitive.leg == number)

    def to_data(self) -> dict[str, Any]:
        """Return the plan as JSON data."""
        return {
            "order": list(self.order),
            "times": self.times.tolist(),
            "points": self.points.tolist(),
            "start": self.start.tolist(),
            "primitives": [primitive._asdict() for primitive in self.primitives],
        }

    @classmethod
    def from_data(cls, data: Any) -> TourPlan:
        """Return the plan that :meth:`to_data` wrote; raise ``InvalidData`` if the data is malformed."""
        keys = ("order", "times", "points", "start", "primitives")
        if not isinstance(data, Mapping):
            raise InvalidData(f"a plan must be an object, got {show(data)}", field="plan")
        for key in data:
            if key not in keys:
                raise InvalidData(
                    f"unknown key {key!r} in a plan; allowed: {', '.join(keys)}", field=str(key)
                )
        for key in keys:
            if key not in data:
                raise InvalidData(f"a plan needs the key {key!r}", field=key)
        return cls(**data)

    def __str__(self) -> str:
        return f"{'-'.join(map(str, self.order))}, {self.length:.10g} m"


def _primitives(value: Any) -> tuple[Primitive, ...]:
    if isinstance(value, str | Mapping) or not isinstance(value, Sequence):
        raise InvalidData(f"primitives must be a list, got {show(value)}", field="primitives")
    primitives = []
    for row, entry in enumerate(value):
        name = f"primitives[{row}]"
        if isinstance(entry, Mapping):
            if set(entry) != set(Primitive._fields):
                raise InvalidData(
                    f"{name} must have the keys {', '.join(Primitive._fields)}, got {show(entry)}",
                    field=name,
                )
            entry = tuple(entry[key] for key in Primitive._fields)
        if not isinstance(entry, list | tuple) or len(entry) != len(Primitive._fields):
            raise InvalidData(
                f"{name} must be {', '.join(Primitive._fields)}, got {show(entry)}", field=name
            )
        leg, turn, length, heading = entry
        if not isinstance(turn, str) or turn not in SIGNS:
            raise InvalidData(f"{name}.turn must be L, S or R, got {show(turn)}", field=name)
        primitives.append(
            Primitive(
                Whole(0, MOST_LEGS).coerce(f"{name}.leg", leg, {}),
                turn,
                Real().coerce(f"{name}.length", length, {}),
                Real().coerce(f"{name}.heading", heading, {}),
            )
        )
    return tuple(primitives)
