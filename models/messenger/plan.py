"""Plan of a messenger tour: times and places of the encounters, and the path between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Plan
from ..fields import Array, NumberTuple, Optional, Real, Spec, Whole, declared, show
from ..inputs import FloatsOrNone
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
    shares : tuple of int
        With several UAVs, the number of vehicles that each meets: `order` lists those of the first
        UAV, then those of the second. A UAV with k vehicles has k + 1 leg numbers, the last for the
        way back. Empty for one UAV.
    starts : ndarray, shape (m, 3), optional
        With several UAVs, the start of each.

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
    shares: tuple[int, ...] = declared(NumberTuple(("uavs",), int, 0), default=(), added=True)
    starts: FloatsOrNone = declared(Optional(Array(("uavs", 3))), default=None, added=True)

    def check(self) -> None:
        """Validate the shares of several UAVs."""
        if (len(self.shares) > 0) != (self.starts is not None):
            raise InvalidData("shares and starts must be given together", field="starts")
        if self.shares and sum(self.shares) != len(self.order):
            raise InvalidData(
                f"shares must sum to {len(self.order)}, the number of encounters, got "
                f"{show(self.shares)}",
                field="shares",
            )
        if self.starts is not None and not np.array_equal(self.start, self.starts[0]):
            raise InvalidData(
                f"start must be that of the first UAV, {show(self.starts[0].tolist())}, got "
                f"{show(self.start.tolist())}",
                field="start",
            )

    @property
    def length(self) -> float:
        """Length of the path, in m; with several UAVs, of the longest one."""
        # Overflow yields inf, which the verification reports as a violation.
        if self.shares:
            return max(part.length for part in self.parts())
        return float(sum(primitive.length for primitive in self.primitives))

    def parts(self) -> tuple[TourPlan, ...]:
        """Return the tour of each UAV, with its own leg numbers; `order` keeps the vehicles' indices."""
        if not self.shares or self.starts is None:
            return (self,)
        parts, row, leg = [], 0, 0
        for count, start in zip(self.shares, self.starts, strict=True):
            mine, after = slice(row, row + count), leg + count + 1
            pieces = tuple(
                piece._replace(leg=piece.leg - leg)
                for piece in self.primitives
                if leg <= piece.leg < after
            )
            parts.append(
                TourPlan(self.order[mine], self.times[mine], self.points[mine], start, pieces)
            )
            row, leg = row + count, after
        return tuple(parts)

    @classmethod
    def join(cls, parts: Sequence[TourPlan]) -> TourPlan:
        """Return the plan of several UAVs with these tours; see :meth:`parts`."""
        legs = np.cumsum([0, *(len(part.order) + 1 for part in parts)]).tolist()
        pieces = [
            piece._replace(leg=piece.leg + leg)
            for part, leg in zip(parts, legs, strict=False)
            for piece in part.primitives
        ]
        return cls(
            tuple(k for part in parts for k in part.order),
            np.concatenate([part.times for part in parts]),
            np.concatenate([part.points for part in parts]),
            parts[0].start,
            tuple(pieces),
            tuple(len(part.order) for part in parts),
            np.array([part.start for part in parts]),
        )

    def leg(self, number: int) -> tuple[Primitive, ...]:
        """Return the primitives of leg `number`."""
        return tuple(primitive for primitive in self.primitives if primitive.leg == number)

    def __str__(self) -> str:
        orders = ["-".join(map(str, part.order)) for part in self.parts()]
        return f"{' | '.join(orders)}, {self.length:.10g} m"
