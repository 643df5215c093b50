"""Models of the points, lines and polygons in GeoJSON files."""

from __future__ import annotations

import logging
import math
import re
import tomllib
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import InvalidData
from ..files import read_text
from ..models.fields import Array, show
from ..models.json_text import parse_json
from .grid_path.geojson import as_polygons, geometries
from .projection import project_positions
from .storage import joined

if TYPE_CHECKING:
    from ..models.fleet.model import FleetRouting
    from ..models.fleet_mission.model import FleetMission
    from ..models.grid_path.model import GridPath
    from ..models.grid_path.polygons import Polygon
    from ..models.messenger.model import MessengerTour
    from ..models.minimum_snap.model import MinimumSnap

__all__ = [
    "Places", "fleet_of_places", "mission_of_places", "path_among_areas", "path_of_places",
    "planar", "read_places", "tour_of_places",
]  # fmt: skip

log = logging.getLogger("crosstrack")

#: Metres per unit of lengths that GeoJSON may have; degrees are projected.
_LENGTHS = {"metres": 1.0, "feet": 0.3048, "us-feet": 1200 / 3937}
_UNITS = (*_LENGTHS, "degrees")
#: Authority and code in the name of a reference system, such as ``urn:ogc:def:crs:EPSG::2263``.
_CODE = re.compile(r"(EPSG|ESRI)[:/. ](?:[\w.]*[:/#])?(\d+)\b", re.IGNORECASE)
#: Radius of Web Mercator, whose metres grow with the latitude, m.
_RADIUS = 6378137.0


class Places(NamedTuple):
    """Content of a GeoJSON file.

    Parameters
    ----------
    points : list of list of float
        Positions of the points, m.
    ids : list of int or str, optional
        Their property ``id``, ``name`` or ``node``, if each point has one of its own.
    depots : list of int
        Indices of the points with the property ``"depot": true``.
    demands : list
        Property ``demand`` of each point, None if a point has none.
    lines : list of list
        Positions of each line, m.
    areas : tuple of Polygon
        Polygons, m.
    others : list of list of float
        Positions that the user gave in the unit of the file, m.
    """

    points: list[list[float]]
    ids: list[Any] | None
    depots: list[int]
    demands: list[Any]
    lines: list[list[list[float]]]
    areas: tuple[Polygon, ...]
    others: list[list[float]]

    def require(self, file: Path, kind: str, *allowed: str) -> None:
        """Raise if the file has other geometries than those in `allowed`, which `kind` has no field for."""
        for name in {"points", "lines", "areas"} - set(allowed):
            if getattr(self, name):
                word = "polygons" if name == "areas" else name
                raise InvalidData(
                    f"{file}: {word} have no place in {kind}: remove them from the file, or choose another "
                    "model",
                    field="type",
                )


def read_places(path: Path, units: Any = None, others: list[list[float]] | None = None) -> Places:
    """Return the geometries in a GeoJSON file in metres; degrees are projected about their centre.

    Parameters
    ----------
    path : Path
        The file.
    units : {"metres", "feet", "us-feet", "degrees"}, optional
        Unit of the coordinates. By default that of the member ``"units"`` or of the reference system
        (``"crs"``), or metres if a coordinate cannot be in degrees.
    others : list of list of float, optional
        Further positions in the same unit.

    Raises
    ------
    InvalidData
        The file is not valid GeoJSON, or the unit of its coordinates is open.
    """
    try:
        content = parse_json(read_text(path))
        shapes = list(geometries(content))
        rings = [ring for s in shapes if s.kind == "Polygon" for ring in s.coordinates]
        paths = [s.coordinates for s in shapes if s.kind == "LineString"]
        marks = [s for s in shapes if s.kind == "Point"]
        groups = [others or [], [mark.coordinates for mark in marks], *paths, *rings]
        moved, *flat = planar(content, groups, units, str(path))
        left = iter(flat[1 + len(paths) :])
        areas = as_polygons(
            {s.place: [next(left) for _ in s.coordinates] for s in shapes if s.kind == "Polygon"}
        )
    except InvalidData as error:
        if str(error).startswith(str(path)):
            raise
        several = (
            ""
            if "Extra data" not in str(error)
            else (
                ": it may hold a feature per line, which ogr2ogr -f GeoJSON converts to one collection"
            )
        )
        raise InvalidData(f"{path}: {error}{several}", field=error.field) from None
    labels = (
        [mark.properties.get(key) for mark in marks] if marks else [None]
        for key in ("id", "name", "node")
    )
    ids = next((row for row in labels if _distinct(row)), None)
    depots = [k for k, mark in enumerate(marks) if mark.properties.get("depot") is True]
    demands = [mark.properties.get("demand") for mark in marks]
    return Places(flat[0], ids, depots, demands, flat[1 : 1 + len(paths)], areas, moved)


def _distinct(labels: list[Any]) -> bool:
    words = all(isinstance(label, str) and label for label in labels)
    whole = all(type(label) is int for label in labels)
    return (words or whole) and len(set(labels)) == len(labels)


def planar(content: Mapping[str, Any], groups: list[Any], units: Any, where: str) -> list[Any]:
    """Return groups of positions in metres, converted from feet and projected from degrees.

    Parameters
    ----------
    content : mapping
        GeoJSON object, whose members ``"units"`` or ``"crs"`` may state the unit.
    groups : list
        Lists of positions ``[x, y, …]``.
    units : {"metres", "feet", "us-feet", "degrees"}, optional
        Unit that the user states.
    where : str
        File of the positions, for messages.

    Raises
    ------
    InvalidData
        A coordinate is not a number, the unit is open or not supported, or degrees are out of range.
    """
    for group in groups:
        for position in group:
            if not all(isinstance(x, int | float) and not isinstance(x, bool) for x in position):
                raise InvalidData(
                    f"coordinates must be numbers, got {show(position)}", field="coordinates"
                )
    unit = content.get("units") if units is None else units
    if unit is not None and unit not in _UNITS:
        field = 'the member "units"' if units is None else "units"
        raise InvalidData(
            f"{field} must be one of {', '.join(_UNITS)}, got {show(unit)}: convert the coordinates, "
            "or give their unit by --data units=…",
            field="coordinates" if units is None else "units",
        )
    crs = content.get("crs")
    stated = crs.get("properties") if isinstance(crs, Mapping) else None
    name = stated.get("name") if isinstance(stated, Mapping) else crs
    name = name if isinstance(name, str) else ""
    far = any(abs(x) > 360 or abs(y) > 90 for group in groups for x, y, *_ in group)
    if unit is None:
        unit = _unit_of(name) or ("metres" if far else "")
        if unit == "mercator":
            unit, groups = "degrees", [list(map(_from_mercator, group)) for group in groups]
        if unit == "other":
            raise InvalidData(
                f"coordinates in {name} must be metres, feet or degrees: convert them, e.g. with "
                f"ogr2ogr -t_srs EPSG:4326 new.geojson {where}",
                field="units",
            )
        if name and unit in _LENGTHS:
            log.warning("%s: coordinates in %s are read as %s", where, name, unit)
    if unit == "metres" or not any(groups):
        return groups
    if unit in _LENGTHS:
        scale = _LENGTHS[unit]
        return [[[scale * x for x in position] for position in group] for group in groups]
    if not unit:
        raise InvalidData(
            "coordinates may be degrees, as GeoJSON prescribes, or metres: add --data units=degrees or "
            "--data units=metres (in Python: data={'units': 'degrees'})",
            field="units",
        )
    flat = [position for group in groups for position in group]
    latitudes, longitudes = [y for _, y, *_ in flat], [x for x, *_ in flat]
    places = project_positions(latitudes, longitudes, where).tolist()
    rows = ([*place, *position[2:]] for place, position in zip(places, flat, strict=True))
    return [[next(rows) for _ in group] for group in groups]


def _unit_of(name: str) -> str:
    """Return the unit of a reference system: one of ``_UNITS``, "mercator", "other", or "" if unknown."""
    match = _CODE.search(name)
    if match is None:
        return "degrees" if re.search(r"CRS:?(84|83|27)h?\b|WGS[ _]?(19)?84$", name) else ""
    text = (files(__package__) / "reference_systems.toml").read_text("utf-8")
    for unit, ranges in tomllib.loads(text)[match[1].upper()].items():
        for low, _, high in (part.partition("-") for part in ranges.split()):
            if int(low) <= int(match[2]) <= int(high or low):
                return str(unit)
    return "metres"


def _from_mercator(position: list[float]) -> list[float]:
    """Return a position in Web Mercator (m) as longitude and latitude (degrees) and its further entries."""
    x, y, *rest = position
    latitude = math.atan(math.sinh(y / _RADIUS)) if abs(y) < 20 * _RADIUS else math.inf
    return [math.degrees(x / _RADIUS), math.degrees(latitude), *rest]


def fleet_of_places(path: Path, *, units: Any = None, **data: Any) -> FleetRouting:
    """Return the routing of a fleet through the points in a GeoJSON file."""
    from ..models.fleet.model import FleetRouting

    places = read_places(path, units)
    places.require(path, FleetRouting.kind, "points")
    depots = {"depots": places.depots} if places.depots else {}
    if "demands" not in data and any(value is not None for value in places.demands):
        data["demands"] = Array(("n",)).coerce("demands", places.demands, {}).tolist()
    fields = {"points": [point[:2] for point in places.points]}
    return FleetRouting.from_data(
        joined(fields, {**_named(places), **depots, **data}), name=path.stem
    )


def tour_of_places(path: Path, *, units: Any = None, **data: Any) -> MessengerTour:
    """Return the tour over vehicles at rest at the points in a GeoJSON file."""
    from ..models.messenger.model import MessengerTour

    places = read_places(path, units)
    places.require(path, MessengerTour.kind, "points")
    fields = {"positions": [point[:2] for point in places.points]}
    return MessengerTour.from_data(joined(fields, {**_named(places), **data}), name=path.stem)


def mission_of_places(
    path: Path, *, units: Any = None, bounds: Any, depot: Any = None, nodes: Any = None, **data: Any
) -> FleetMission:
    """Return the mission among the polygons and through the points in a GeoJSON file.

    `bounds`, `depot` and `nodes` are in the unit of the file.
    """
    from ..models.fleet_mission.model import FleetMission

    stops = [] if nodes is None else Array(("n", 2)).coerce("nodes", nodes, {}).tolist()
    home = [] if depot is None else [Array((2,)).coerce("depot", depot, {}).tolist()]
    places, limits, rest = _read_within(path, units, bounds, home + stops)
    places.require(path, FleetMission.kind, "points", "areas")
    marked = places.depots[: 1 - len(home)]
    home = rest[: len(home)] or [places.points[k][:2] for k in marked]
    inner = [k for k in range(len(places.points)) if k not in marked]
    fields = joined({"obstacles": places.areas, "bounds": limits}, data)
    if home:
        fields["depot"] = home[0]
    if nodes is None and inner:
        fields["nodes"] = [places.points[k][:2] for k in inner]
        if places.ids is not None:
            fields.setdefault("ids", [places.ids[k] for k in inner])
    elif nodes is not None:
        if inner:
            raise InvalidData(
                f"{path}: nodes must not be given: the file holds them", field="nodes"
            )
        fields["nodes"] = rest[len(rest) - len(stops) :]
    return FleetMission.from_data(fields, name=path.stem)


def path_among_areas(
    path: Path, *, units: Any = None, bounds: Any, cell: Any, radius: Any = 0.0, **data: Any
) -> GridPath:
    """Return the path on the grid map of the polygons in a GeoJSON file.

    `bounds` are in the unit of the file; `start` and `goals` in `data` are cells.
    """
    from ..models.grid_path.gridmap import GridMap
    from ..models.grid_path.model import GridPath

    places, limits, _ = _read_within(path, units, bounds, [])
    places.require(path, GridPath.kind, "areas")
    grid = GridMap.from_polygons(places.areas, limits, cell, radius)
    return GridPath.from_data(joined({"map": grid}, data), name=path.stem)


def _read_within(
    path: Path, units: Any, bounds: Any, others: list[list[float]]
) -> tuple[Places, Any, list[list[float]]]:
    """Return the content of a file, and the bounds and other positions in metres."""
    west, south, east, north = Array((4,)).coerce("bounds", bounds, {}).tolist()
    given = [[x, y] for x in (west, east) for y in (south, north)] + others
    places = read_places(path, units, given)
    if places.others is given:  # in metres
        return places, bounds, others
    # West before east and south before north, so that models refuse reversed bounds.
    sw, nw, se, ne = places.others[:4]
    low, high = [min(sw[0], nw[0]), min(sw[1], se[1])], [max(se[0], ne[0]), max(nw[1], ne[1])]
    return places, low + high, places.others[4:]


def path_of_places(path: Path, *, units: Any = None, **data: Any) -> MinimumSnap:
    """Return the trajectory through the points, or along the only line, of a GeoJSON file."""
    from ..models.minimum_snap.model import MinimumSnap

    places = read_places(path, units)
    places.require(path, MinimumSnap.kind, "lines" if places.lines else "points")
    if len(places.lines) > 1:
        raise InvalidData(
            f"{path}: must have one line of waypoints, got {len(places.lines)}", field="waypoints"
        )
    rows = places.lines[0] if places.lines else places.points
    width = min(map(len, rows), default=2)
    fields = {"waypoints": [row[: min(width, 3)] for row in rows]}
    return MinimumSnap.from_data(joined(fields, data), name=path.stem)


def _named(places: Places) -> dict[str, Any]:
    """Return the field of the names of points, if they have names."""
    return {} if places.ids is None else {"ids": places.ids}
