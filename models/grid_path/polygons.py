"""Polygons with holes, for obstacles."""

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
    """Polygon with open rings: the last point of a ring differs from the first.

    Attributes
    ----------
    shell : ndarray, shape (k, 2)
        Points x, y of the outer ring in metres, in either direction.
    holes : tuple of ndarray, each of shape (k, 2), default ()
        Rings of the holes in metres.
    """

    shell: Floats
    holes: tuple[Floats, ...] = ()


@dataclass(frozen=True)
class Polygons(Spec):
    """Field of polygons that may touch, overlap and nest, as a tuple of :class:`Polygon`.

    Each input is an outer ring of shape (k, 2), ``{"shell": ring, "holes": [ring, …]}``, a pair (shell,
    holes), or a ``shapely.Polygon``. A ring may be open or closed. A ring must have at least three
    different points and an area, and must not cross or touch itself. Holes must be inside the shell.
    """

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Any:
        if isinstance(value, str | bytes | Mapping | set) or not isinstance(value, Iterable):
            raise InvalidData(f"{name} must be a list of polygons, got {show(value)}", field=name)
        polygons = tuple(_polygon(name, f"{name}[{k}]", item) for k, item in enumerate(value))
        _check(name, polygons)
        return polygons

    def encode(self, value: tuple[Polygon, ...]) -> list[Any]:
        return [
            {"shell": polygon.shell.tolist(), "holes": [hole.tolist() for hole in polygon.holes]}
            if polygon.holes
            else polygon.shell.tolist()
            for polygon in value
        ]

    def feed(self, value: tuple[Polygon, ...]) -> Iterable[bytes]:
        yield repr(
            [[len(ring) for ring in (polygon.shell, *polygon.holes)] for polygon in value]
        ).encode()
        for polygon in value:
            for ring in (polygon.shell, *polygon.holes):
                yield ring.tobytes()

    def refreeze(self, value: tuple[Polygon, ...]) -> tuple[Polygon, ...]:
        return tuple(
            Polygon(frozen(polygon.shell), tuple(map(frozen, polygon.holes))) for polygon in value
        )


def as_shapely(value: Iterable[Polygon]) -> NDArray[np.object_]:
    """Return polygons as ``shapely.Polygon`` objects.

    Parameters
    ----------
    value : iterable of Polygon
        Polygons, m.

    Returns
    -------
    ndarray of shapely.Polygon, shape (n,)
        Polygons in the same order.
    """
    import shapely

    polygons = tuple(value)
    rings = _rings(polygon.shell for polygon in polygons)
    shapes = np.asarray(shapely.polygons(rings), object).reshape(len(polygons))
    for k, polygon in enumerate(polygons):
        if polygon.holes:
            shapes[k] = shapely.polygons(rings[k], _rings(polygon.holes))
    return shapes


def _rings(rings: Iterable[Floats]) -> NDArray[np.object_]:
    import shapely

    sequence = tuple(rings)
    points = np.concatenate(sequence) if sequence else np.empty((0, 2))
    indices = np.repeat(np.arange(len(sequence)), [len(ring) for ring in sequence])
    return np.asarray(shapely.linearrings(points, indices=indices), object).reshape(len(sequence))


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
    """Raise if a polygon has no finite positive area, or its rings cross."""
    import shapely

    shapes = as_shapely(polygons)
    with np.errstate(over="ignore"):
        hulls = shapely.area(shapely.convex_hull(shapes))
    for bad, allowed in ((hulls <= 0, "> 0"), (~np.isfinite(hulls), "that a float can hold")):
        if bad.any():
            k = int(np.argmax(bad))
            raise InvalidData(
                f"{name}[{k}] must have an area {allowed}, got {hulls[k]:g} m²", field=name
            )
    valid = shapely.is_valid(shapes)
    if not valid.all():
        k = int(np.argmin(valid))
        reason = shapely.is_valid_reason(shapes[k])
        raise InvalidData(
            f"{name}[{k}] must be a polygon whose rings do not cross, got {reason}", field=name
        )
