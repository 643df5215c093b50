"""Obstacles as polygons, with holes where they have some."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Spec, frozen, show

__all__ = ["Polygon", "Polygons", "as_shapely"]

Floats = NDArray[np.float64]


class Polygon(NamedTuple):
    """One polygon; the rings are not closed: the last point differs from the first.

    Attributes
    ----------
    shell : ndarray, shape (k, 2)
        x, y (m) of the outer ring, in either direction.
    holes : tuple of ndarray, each of shape (k, 2)
        The rings of what is free within.
    """

    shell: Floats
    holes: tuple[Floats, ...] = ()


@dataclass(frozen=True)
class Polygons(Spec):
    """Polygons that may touch, overlap and nest, as a tuple of :class:`Polygon`.

    Each is an outer ring of shape (k, 2), ``{"shell": ring, "holes": [ring, …]}``, the pair of both,
    or a polygon of shapely. A ring may be closed or not. Refused are rings with fewer than three
    different points, that cross or touch themselves, without an area, and holes that leave the shell.
    """

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Any:
        if isinstance(value, str | bytes | Mapping | set) or not isinstance(value, Iterable):
            raise InvalidData(f"{name} must be a list of polygons, got {show(value)}", field=name)
        found = tuple(_polygon(name, f"{name}[{k}]", one) for k, one in enumerate(value))
        _check(name, found)
        return found

    def encode(self, value: tuple[Polygon, ...]) -> list[Any]:
        return [
            {"shell": one.shell.tolist(), "holes": [hole.tolist() for hole in one.holes]}
            if one.holes
            else one.shell.tolist()
            for one in value
        ]

    def feed(self, value: tuple[Polygon, ...]) -> Iterable[bytes]:
        yield repr([[len(ring) for ring in (one.shell, *one.holes)] for one in value]).encode()
        for one in value:
            for ring in (one.shell, *one.holes):
                yield ring.tobytes()

    def refreeze(self, value: tuple[Polygon, ...]) -> tuple[Polygon, ...]:
        return tuple(Polygon(frozen(one.shell), tuple(map(frozen, one.holes))) for one in value)


def as_shapely(value: Iterable[Polygon]) -> NDArray[np.object_]:
    """Return polygons as shapely's, in an array of their number."""
    import shapely

    polygons = tuple(value)
    rings = _rings(one.shell for one in polygons)
    found = np.asarray(shapely.polygons(rings), object).reshape(len(polygons))
    for k, one in enumerate(polygons):
        if one.holes:
            found[k] = shapely.polygons(rings[k], _rings(one.holes))
    return found


def _rings(rings: Iterable[Floats]) -> NDArray[np.object_]:
    import shapely

    given = tuple(rings)
    points = np.concatenate(given) if given else np.empty((0, 2))
    indices = np.repeat(np.arange(len(given)), [len(ring) for ring in given])
    return np.asarray(shapely.linearrings(points, indices=indices), object).reshape(len(given))


def _polygon(field: str, name: str, value: Any) -> Polygon:
    shell: Any = value
    holes: Any = ()
    if hasattr(value, "exterior") and hasattr(value, "interiors"):
        shell = np.asarray(value.exterior.coords)[:, :2]
        holes = tuple(np.asarray(ring.coords)[:, :2] for ring in value.interiors)
    elif isinstance(value, Mapping):
        if "shell" not in value or not set(value) <= {"shell", "holes"}:
            raise InvalidData(
                f"{name} must be an object with the keys shell and holes, got {show(value)}",
                field=field,
            )
        shell, holes = value["shell"], value.get("holes", ())
    elif isinstance(value, tuple) and len(value) == 2 and isinstance(value[1], list | tuple):
        shell, holes = value
    if not isinstance(holes, list | tuple):
        raise InvalidData(f"{name}.holes must be a list of rings, got {show(holes)}", field=field)
    rings = [_ring(field, f"{name}.holes[{k}]", hole) for k, hole in enumerate(holes)]
    return Polygon(_ring(field, name, shell), tuple(rings))


def _ring(field: str, name: str, value: Any) -> Floats:
    try:
        ring: Floats = Array(("k", 2)).coerce(name, value, {})
    except InvalidData as error:
        raise InvalidData(str(error), field=field) from None
    if len(ring) > 1 and (ring[0] == ring[-1]).all():
        ring = frozen(ring[:-1])
    different = len(set(map(tuple, ring.tolist())))
    if different < 3:
        raise InvalidData(
            f"{name} must have at least 3 different points, got {different}", field=field
        )
    return ring


def _check(name: str, polygons: tuple[Polygon, ...]) -> None:
    """Raise where a polygon has no area, or its rings cross."""
    import shapely

    found = as_shapely(polygons)
    with np.errstate(over="ignore"):
        hulls = shapely.area(shapely.convex_hull(found))
    for bad, wanted in ((hulls <= 0, "> 0"), (~np.isfinite(hulls), "that a float can hold")):
        if bad.any():
            k = int(np.argmax(bad))
            raise InvalidData(
                f"{name}[{k}] must have an area {wanted}, got {hulls[k]:g} m²", field=name
            )
    valid = shapely.is_valid(found)
    if not valid.all():
        k = int(np.argmin(valid))
        reason = shapely.is_valid_reason(found[k])
        raise InvalidData(
            f"{name}[{k}] must be a polygon whose rings do not cross, got {reason}", field=name
        )
