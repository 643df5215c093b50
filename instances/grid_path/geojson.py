"""Reader and writer of polygons in GeoJSON (RFC 7946).

Coordinates are metres in the map's plane. The standard prescribes longitudes and latitudes, which must
be projected before reading.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ...errors import InvalidData
from ...files import as_path, read_text
from ...models.fields import show
from ...models.grid_path.polygons import Polygon, Polygons
from ...models.json_text import parse_json
from ..exports import closed_ring, write_geojson

__all__ = ["read_geojson_polygons", "write_geojson_polygons"]

_TYPES = ("FeatureCollection", "Feature", "MultiPolygon", "Polygon")


def read_geojson_polygons(path: str | os.PathLike[str]) -> tuple[Polygon, ...]:
    """Return the polygons in a GeoJSON file, with their holes.

    The reader supports Polygon, MultiPolygon, Feature and FeatureCollection. It ignores properties and
    heights. Coordinates are metres.

    Parameters
    ----------
    path : path-like
        Path of the file.

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
    text = read_text(file)
    try:
        polygons = dict(_polygons(parse_json(text), ""))
        try:
            return tuple(Polygons().coerce("polygons", list(polygons.values()), {}))
        except InvalidData as error:
            raise InvalidData(_placed(str(error), list(polygons)), field="polygons") from None
    except InvalidData as error:
        raise InvalidData(f"{file}: {error}", field=error.field) from None


def _placed(message: str, places: list[str]) -> str:
    """Return a message about ``polygons[k]`` with the polygon's location in its file."""
    number = message.removeprefix("polygons[").partition("]")[0]
    if not number.isdigit():
        return message
    return message.replace(f"polygons[{number}]", places[int(number)], 1)


def _polygons(value: Any, place: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the location and the rings of every polygon."""
    kind = value.get("type") if isinstance(value, Mapping) else None
    if kind not in _TYPES:
        raise InvalidData(
            f"{place or 'the file'} must be an object of type {', '.join(_TYPES)}, got "
            f"{show(kind if isinstance(kind, str) else value)}",
            field="type",
        )
    dot = f"{place}." if place else ""
    if kind == "Feature":
        yield from _polygons(value.get("geometry"), f"{dot}geometry")
        return
    key = "features" if kind == "FeatureCollection" else "coordinates"
    parts = value.get(key)
    if not isinstance(parts, list):
        raise InvalidData(f"{dot}{key} must be a list, got {show(parts)}", field=key)
    if kind == "Polygon":
        yield _rings(parts, f"{dot}{key}")
    for k, part in enumerate(parts if kind != "Polygon" else ()):
        if kind == "MultiPolygon":
            yield _rings(part, f"{dot}{key}[{k}]")
        else:
            yield from _polygons(part, f"{dot}{key}[{k}]")


def _rings(value: Any, place: str) -> tuple[str, dict[str, Any]]:
    if not isinstance(value, list) or not value:
        raise InvalidData(
            f"{place} must be a list of rings, got {show(value)}", field="coordinates"
        )
    rings = []
    for k, ring in enumerate(value):
        if not isinstance(ring, list) or not all(
            isinstance(point, list) and len(point) >= 2 for point in ring
        ):
            raise InvalidData(
                f"{place}[{k}] must be a list of positions [x, y], got {show(ring)}",
                field="coordinates",
            )
        rings.append([point[:2] for point in ring])
    return place, {"shell": rings[0], "holes": rings[1:]}


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
