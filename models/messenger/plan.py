"""Plan of a messenger tour: times and places of the encounters, and the path between them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Plan
from ..fields import Array, NumberTuple, Real, Spec, Whole, declared, show
from ..records import Several

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
        Length in metres.
    heading : float
        Heading at the beginning in radians, counter-clockwise from the x axis.
    """

    leg: int
    turn: str
    length: float
    heading: float


class _Piece(Spec):
    """Primitive, given as such, as a list of its entries or as an object."""

    _leg, _number = Whole(0, MOST_LEGS), Real()

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Primitive:
        entry, fields = value, Primitive._fields
        if isinstance(entry, Mapping):
            if set(entry) != set(fields):
                raise InvalidData(
                    f"{name} must have the keys {', '.join(fields)}, got {show(entry)}", field=name
                )
            entry = tuple(entry[key] for key in fields)
        if not isinstance(entry, list | tuple) or len(entry) != len(fields):
            raise InvalidData(f"{name} must be {', '.join(fields)}, got {show(entry)}", field=name)
        leg, turn, length, heading = entry
        if not isinstance(turn, str) or turn not in SIGNS:
            raise InvalidData(f"{name}.turn must be L, S or R, got {show(turn)}", field=name)
        return Primitive(
            self._leg.coerce(f"{name}.leg", leg, {}),
            turn,
            self._number.coerce(f"{name}.length", length, {}),
            self._number.coerce(f"{name}.heading", heading, {}),
        )

    def encode(self, value: Primitive) -> dict[str, Any]:
        return value._asdict()


@dataclass(frozen=True, eq=False)
class TourPlan(Plan):
    """Flight over the vehicles.

    Parameters
    ----------
    order : tuple of int
        Indices of the vehicles in the order of their encounters.
    times : ndarray, shape (n,)
        Time of each encounter in seconds, in that order.
    points : ndarray, shape (n, 2)
        Position of the UAV at each encounter, in metres.
    start : ndarray, shape (3,)
        Start of the path: x and y, in metres, heading in radians.
    primitives : tuple of Primitive
        The path.

    Raises
    ------
    InvalidData
        A field has a wrong shape or type, or a primitive has an unknown turn.
    """

    order: tuple[int, ...] = declared(NumberTuple(("vehicles",), int))
    times: Floats = declared(Array(("vehicles",)))
    points: Floats = declared(Array(("vehicles", 2)))
    start: Floats = declared(Array((3,)))
    primitives: tuple[Primitive, ...] = declared(Several(_Piece()))

    @property
    def length(self) -> float:
        """Length of the path, in m."""
        # Overflow yields inf, which the verification reports as a violation.
        return float(sum(primitive.length for primitive in self.primitives))

    def leg(self, number: int) -> tuple[Primitive, ...]:
        """Return the primitives of leg `number`."""
        return tuple(primitive for primitive in self.primitives if primitive.leg == number)

    def __str__(self) -> str:
        return f"{'-'.join(map(str, self.order))}, {self.length:.10g} m"
