"""No-fly zones: discs and polygons, and how deep the lines and arcs of a path lead into them."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Spec, show

__all__ = ["Zones", "depth", "is_inside", "size_of"]

Floats = NDArray[np.float64]
#: Place, heading, curvature (0 for a line) and length of a primitive, in m and rad.
Piece = tuple[complex, float, float, float]


class Zones(Spec):
    """List of zones: x, y and radius of a disc, shape (3,), or the corners of a polygon, shape (k, 2)."""

    _spec = Array(("k",)), Array(("k", 2))

    def coerce(
        self, name: str, value: Any, sizes: dict[str, tuple[int, str]]
    ) -> tuple[Floats, ...]:
        if not isinstance(value, list | tuple | np.ndarray) or getattr(value, "ndim", 1) == 0:
            raise InvalidData(f"{name} must be a list of zones, got {show(value)}", field=name)
        return tuple(self._zone(f"{name}[{row}]", item, name) for row, item in enumerate(value))

    def _zone(self, label: str, value: Any, name: str) -> Floats:
        flat = (
            np.ndim(value) < 2
            if not isinstance(value, list | tuple)
            else not (value and isinstance(value[0], list | tuple | np.ndarray))
        )
        zone: Floats = self._spec[not flat].coerce(label, value, {})
        if flat and (zone.size != 3 or zone[2] <= 0):
            raise InvalidData(
                f"{label} must be x, y and a radius > 0, or the corners of a polygon, got {show(value)}",
                field=name,
            )
        if not flat and (len(zone) < 3 or np.linalg.matrix_rank(zone - zone[0]) < 2):
            raise InvalidData(
                f"{label} must be a polygon with an area: at least 3 corners that are not on one line, "
                f"got {show(value)}",
                field=name,
            )
        return zone

    def encode(self, value: tuple[Floats, ...]) -> Any:
        return [zone.tolist() for zone in value]

    def feed(self, value: tuple[Floats, ...]) -> Iterable[bytes]:
        yield repr(self.encode(value)).encode()

    def refreeze(self, value: tuple[Floats, ...]) -> Any:
        return tuple(self._spec[zone.ndim - 1].refreeze(zone) for zone in value)


def size_of(zone: Floats) -> float:
    """Return the radius of a disc, or half the diagonal of the box of a polygon, in m."""
    return float(zone[2]) if zone.ndim == 1 else 0.5 * float(np.hypot(*np.ptp(zone, axis=0)))


def is_inside(zone: Floats, place: complex) -> bool:
    """Return whether a place is inside a zone; for a polygon by the even-odd rule."""
    if zone.ndim == 1:
        return bool(abs(place - complex(*zone[:2])) < zone[2])
    inside = False
    for a, b in _edges(zone):
        if (a.imag > place.imag) != (b.imag > place.imag):
            share = (place.imag - a.imag) / (b.imag - a.imag)
            inside ^= place.real < a.real + share * (b.real - a.real)
    return bool(inside)


def depth(zone: Floats, piece: Piece) -> float:
    """Return how deep (m) a primitive leads into a zone; at most 0 if it stays outside.

    It is exact for a disc. For a polygon, the primitive is cut at its crossings with the edges, and the
    result is the largest of the parts inside: the least, over the edges, of the largest distance of the
    part from the edge. This is at least the true depth, and at most 0 only if the interior is not entered.
    """
    if zone.ndim == 1:
        middle = complex(*zone[:2])
        return float(zone[2]) - min(
            abs(_at(piece, s) - middle) for s in (0.0, piece[3], *_towards(piece, middle))
        )
    _, _, bend, length = piece
    middle = complex(*(0.5 * (zone.min(axis=0) + zone.max(axis=0))))
    room = abs(_at(piece, 0.5 * length) - middle) - 0.5 * length - size_of(zone)
    if room > 0.0:
        return -room
    if bend:
        length = min(length, 2.0 * math.pi / abs(bend))
    piece = (*piece[:3], length)
    cuts = sorted({0.0, length, *(s for edge in _edges(zone) for s in _crossings(piece, *edge))})
    worst = 0.0
    for low, high in zip(cuts, cuts[1:] or cuts, strict=False):
        if is_inside(zone, _at(piece, 0.5 * (low + high))):
            worst = max(worst, min(_farthest(piece, low, high, *edge) for edge in _edges(zone)))
    return worst


def _edges(zone: Floats) -> Iterator[tuple[complex, complex]]:
    corners = [complex(*corner) for corner in zone.tolist()]
    return zip(corners, corners[1:] + corners[:1], strict=True)


def _at(piece: Piece, s: float) -> complex:
    """Return the place after the length `s` of a primitive."""
    place, heading, bend, _ = piece
    half = 0.5 * bend * s
    chord = s * (math.sin(half) / half if half else 1.0)
    return place + cmath.rect(chord, heading + half)


def _towards(piece: Piece, goal: complex) -> list[float]:
    """Return the lengths at which the distance of a primitive from a place is stationary."""
    place, heading, bend, length = piece
    if bend == 0.0:
        roots = [((goal - place) * cmath.rect(1.0, -heading)).real]
    else:
        middle = place + cmath.rect(1.0 / bend, heading + 0.5 * math.pi)
        angle = cmath.phase((goal - middle) / (place - middle))
        roots = [_turned(bend, angle), _turned(bend, angle + math.pi)]
    return [s for s in roots if 0.0 < s < length]


def _turned(bend: float, angle: float) -> float:
    """Return the length at which an arc has turned by `angle` (rad) about its centre."""
    return math.copysign(1.0, bend) * angle % (2 * math.pi) / abs(bend)


def _crossings(piece: Piece, a: complex, b: complex) -> list[float]:
    """Return the lengths at which a primitive crosses the line through the edge from `a` to `b`.

    Cuts beyond the edge, and next to a line that an arc misses, are harmless and guard against rounding.
    """
    place, heading, bend, length = piece
    if a == b:
        return []
    across = (b - a).conjugate() / abs(b - a)
    way = cmath.rect(1.0, heading)
    if bend == 0.0:
        slope = (way * across).imag
        roots = [((a - place) * across).imag / slope] if slope else []
    else:
        middle = place + 1j * way / bend
        # The distance of the arc from the line is a sine of the angle about the centre.
        share = ((a - middle) * across).imag * abs(bend)
        angle = math.asin(min(max(share, -1.0), 1.0))
        begin = cmath.phase((place - middle) * across)
        roots = [_turned(bend, angle - begin), _turned(bend, math.pi - angle - begin)]
    return [s for s in roots if 0.0 < s < length]


def _farthest(piece: Piece, low: float, high: float, a: complex, b: complex) -> float:
    """Return the largest distance of a part of a primitive from the edge from `a` to `b`."""
    place, heading, bend, _ = piece
    trials = [low, high]
    if bend:
        middle = place + cmath.rect(1.0 / bend, heading + 0.5 * math.pi)
        normal = 1j * (b - a)
        for goal in (a, b, middle + normal):
            trials += _towards(piece, goal)
    return max(_apart(_at(piece, s), a, b) for s in trials if low <= s <= high)


def _apart(place: complex, a: complex, b: complex) -> float:
    """Return the distance of a place from an edge."""
    along = b - a
    square = abs(along) ** 2
    share = ((place - a) * along.conjugate()).real / square if square else 0.0
    return abs(place - a - along * min(max(share, 0.0), 1.0))
