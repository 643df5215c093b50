"""Reader and writer of polygons in GeoJSON (RFC 7946).

Coordinates are metres in the map's plane, or with ``geographic=True`` longitudes and latitudes as the
standard prescribes, which are projected to metres.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from ...errors import InvalidData
from ...files import as_path, read_text
from ...models.fields import Flag, show
from ...models.grid_path.polygons import Polygon, Polygons
from ...models.json_text import parse_json
from ..exports import closed_ring, write_geojson
from ..projection import project_rings

__all__ = [
    "Shape", "as_polygons", "geometries", "read_geojson_polygons", "write_geojson_polygons",
]  # fmt: skip
#: Kinds of single geometries.
_KINDS = ("Point", "LineString", "Polygon")
#: Key of the members of a collection, by its type.
_COLLECTIONS = {"FeatureCollection": "features", "GeometryCollection": "geometries"}

log = logging.getLogger("crosstrack")


def read_geojson_polygons(
    path: str | os.PathLike[str], *, geographic: bool = False
) -> tuple[Polygon, ...]:
    """Return the polygons in a GeoJSON file, with their holes.

    The reader supports Polygon, MultiPolygon, Feature and FeatureCollection. It ignores properties and
    heights.

    Parameters
    ----------
    path : path-like
        Path of the file.
    geographic : bool, default False
        Whether coordinates are longitudes and latitudes in degrees, which are projected, instead of
        metres. See :func:`~crosstrack.instances.project_positions`.

    Returns
    -------
    tuple of Polygon
        Polygons in the order of the file.

    Raises
    ------
    InvalidData
        The file is not valid GeoJSON, or a geometry or polygon is invalid. The message names file and
        location.
    """
    file = as_path(path)
    if Flag().coerce("geographic", geographic, {}):
        rings, _ = project_rings(read_geojson_polygons(file), (), str(file))
        return tuple(Polygons().coerce("polygons", rings, {}))
    text = read_text(file)
    try:
        shapes = geometries(parse_json(text), ("Polygon",))
        return as_polygons({shape.place: shape.coordinates for shape in shapes})
    except InvalidData as error:
        raise InvalidData(f"{file}: {error}", field=error.field) from None


class Shape(NamedTuple):
    """Geometry in a GeoJSON file: its place for messages, a name of ``_KINDS``, and the properties of its feature.

    The coordinates are a position, the positions of a line, or the rings of a polygon.
    """

    place: str
    kind: str
    coordinates: list[Any]
    properties: Mapping[str, Any]


def as_polygons(rings: Mapping[str, list[Any]]) -> tuple[Polygon, ...]:
    """Return the polygons with these rings, by their location in the file."""
    parts = [{"shell": first, "holes": holes} for first, *holes in rings.values()]
    try:
        return tuple(Polygons().coerce("polygons", parts, {}))
    except InvalidData as error:
        raise InvalidData(_placed(str(error), list(rings)), field="polygons") from None


def _placed(message: str, places: list[str]) -> str:
    """Return a message about ``polygons[k]`` with the polygon's location in its file."""
    number = message.removeprefix("polygons[").partition("]")[0]
    if not number.isdigit():
        return message
    return message.replace(f"polygons[{number}]", places[int(number)], 1)


def geometries(
    value: Any,
    kinds: Sequence[str] = _KINDS,
    place: str = "",
    properties: Mapping[str, Any] = MappingProxyType({}),
) -> Iterator[Shape]:
    """Yield the geometries of GeoJSON; those in collections one by one, and none of a feature without one.

    Kinds that are not in `kinds` are refused by name. `place` and `properties` are those of the feature.
    """
    kind = value.get("type") if isinstance(value, Mapping) else None
    types = (*_COLLECTIONS, "Feature", *(f"Multi{name}" for name in kinds), *kinds)
    if kind not in types:
        raise InvalidData(
            f"{place or 'the file'} must be an object of type {', '.join(types)}, got "
            f"{show(kind if isinstance(kind, str) else value)}",
            field="type",
        )
    dot = f"{place}." if place else ""
    if kind == "Feature":
        if value.get("geometry", ()) is None:  # RFC 7946, section 3.2: a feature without a place
            log.warning("%s has no geometry and is not read", place or "the feature")
            return
        extra = value.get("properties")
        labels = {"id": value["id"]} if "id" in value else {}
        yield from geometries(
            value.get("geometry"),
            kinds,
            f"{dot}geometry",
            {**labels, **extra} if isinstance(extra, dict) else labels,
        )
        return
    key = _COLLECTIONS.get(str(kind), "coordinates")
    parts = value.get(key)
    if not isinstance(parts, list):
        raise InvalidData(f"{dot}{key} must be a list, got {show(parts)}", field=key)
    if kind in kinds:
        yield Shape(f"{dot}{key}", str(kind), _nested(kind, parts, f"{dot}{key}"), properties)
        return
    for k, part in enumerate(parts):
        inner = f"{dot}{key}[{k}]"
        if key == "coordinates":
            single = str(kind).removeprefix("Multi")
            yield Shape(inner, single, _nested(single, part, inner), properties)
        else:
            yield from geometries(part, kinds, inner, properties)


def _nested(kind: Any, value: Any, place: str) -> list[Any]:
    """Return the coordinates of a geometry without heights of rings, or raise for another nesting."""
    if kind == "Polygon":
        if not isinstance(value, list) or not value:
            raise InvalidData(
                f"{place} must be a list of rings, got {show(value)}", field="coordinates"
            )
        return [
            [point[:2] for point in _positions(ring, f"{place}[{k}]")]
            for k, ring in enumerate(value)
        ]
    if kind == "Point":
        return list(_positions([value], place)[0])
    return _positions(value, place)


def _positions(value: Any, place: str) -> list[Any]:
    """Return the positions of a line or ring, or raise for another nesting."""
    if not isinstance(value, list) or not all(
        isinstance(point, list) and len(point) >= 2 for point in value
    ):
        raise InvalidData(
            f"{place} must be a list of positions [x, y], got {show(value)}", field="coordinates"
        )
    return list(value)


def write_geojson_polygons(polygons: Any, path: str | os.PathLike[str]) -> Path:
    """Write polygons as a FeatureCollection, atomically.

    Parameters
    ----------
    polygons : list
        Polygons in any form that :class:`~crosstrack.models.grid_path.Polygons` accepts, m.
    path : path-like
        Path of the file.

    Returns
    -------
    pathlib.Path
        Path of the file.

    Raises
    ------
    InvalidData
        A polygon is invalid, or the file cannot be written.
    """
    return write_geojson(
        path,
        (
            (
                "Polygon",
                [closed_ring(ring) for ring in (polygon.shell, *polygon.holes)],
                {"polygon": k},
            )
            for k, polygon in enumerate(Polygons().coerce("polygons", polygons, {}))
        ),
    )
