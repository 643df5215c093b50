"""Formats of files that can become models.

:data:`_FORMATS` declares the formats of crosstrack. Other distributions declare theirs in the table
``FORMATS`` (``crosstrack.models.problems``), and :func:`register_format` adds one for a session.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..files import as_path
from ..models.fields import required
from ..models.problems import loadable, table
from .file_format import FileFormat, Head, Target

__all__ = ["file_formats", "recognise", "register_format"]


def _keys(*names: str) -> Callable[[Head], bool]:
    """Return a recogniser of JSON objects that have all these keys."""
    return lambda head: set(names) <= head.keys.keys()


_GEOJSON = re.compile(
    "FeatureCollection|Feature|GeometryCollection|(?:Multi)?(?:Point|LineString|Polygon)"
)
_GEOMETRY = re.compile(r'"type"\s*:\s*"(?:Multi)?(Point|LineString|Polygon)"')


def _is_geojson(head: Head) -> bool:
    """Return whether a file is GeoJSON; with sorted keys, the type of a long one is not in its head."""
    kind = "FeatureCollection" if "features" in head.keys else ""
    return bool(_GEOJSON.fullmatch(head.keys.get("type", kind)))


def _geometry(*kinds: str) -> Callable[[Head], bool]:
    """Return a recogniser of GeoJSON with these geometries."""

    def matches(head: Head) -> bool:
        return _is_geojson(head) and set(_GEOMETRY.findall(head.text)) == set(kinds)

    return matches


_UNITS = {"units": "metres"}
_DEPOT = {"depot": "[5, 5]", **_UNITS}
_PLACES = ".instances.places:"
_MAPS = ".instances.map_files:"
_ENDS = {"start": "[0, 0]", "goals": "[9, 9]"}
_SCENES = {"starts": "[[0, 0]]", "targets": "[[9, 9]]"}
_MISSION = {"bounds": "[0, 0, 100, 100]", "vehicles": "2"}
_ON_MAP = {
    "grid-path": Target(f"{_MAPS}path_on_map", _ENDS),
    "unknown-grid": Target(
        ".instances.unknown_grid.readers:scenes_on_map", _SCENES, {"view": "[3, 3]"}
    ),
}
_FLEET = Target(f"{_PLACES}fleet_of_places", {"vehicles": "2"}, _UNITS)
_WAYPOINTS = Target(f"{_PLACES}path_of_places", {"times": "[0, 1, 2]"}, _UNITS)
_NUMBERS = r"[ \t]*+[-+.\deE]++[ \t]++[-+.\deE]++[ \t]++[-+.\deE]++[ \t\r]*+"
_DEGREES = (
    "its coordinates are degrees: export its points as CSV with the columns lat,lon, or as GeoJSON "
    "projected to metres, e.g. with ogr2ogr -t_srs EPSG:32632"
)


def _xml(tag: str) -> str:
    """Return the pattern of an XML file with this root."""
    return rf"\A\s*+(?:<[?!][^>]*>\s*)*+<{tag}\b"


def _family(kinds: str) -> str:
    """Return the pattern of the TYPE of a file of the TSPLIB family."""
    return rf"^[ \t]*TYPE[ \t]*:[ \t]*(?:{kinds})\b"


#: Formats in the order of the attempts to match their content.
_FORMATS = (
    FileFormat(
        "map-json", "TopoJSON, or JSON of ArcGIS or Overpass",
        content=lambda head: (
            head.keys.get("type") == "Topology" or bool({"geometryType", "elements"} & head.keys.keys())
        ),
        remedy="convert it to GeoJSON, e.g. with ogr2ogr or osmtogeojson",
    ),
    FileFormat(
        "geojson-points", "GeoJSON of points",
        {
            "fleet-routing": _FLEET,
            "fleet-mission": Target(f"{_PLACES}mission_of_places", _MISSION, _DEPOT),
            "messenger-tour": Target(f"{_PLACES}tour_of_places", {"radius": "5"}, _UNITS),
            "minimum-snap": _WAYPOINTS,
        },
        _geometry("Point"),
    ),
    FileFormat(
        "geojson-lines", "GeoJSON of a line", {"minimum-snap": _WAYPOINTS}, _geometry("LineString")
    ),
    FileFormat(
        "geojson-polygons", "GeoJSON of polygons",
        {
            "grid-path": Target(
                f"{_PLACES}path_among_areas",
                {"bounds": "[0, 0, 100, 100]", "cell": "1", **_ENDS}, {"radius": "0", **_UNITS},
            ),
            # The points may follow the first 64 KiB.
            "fleet-mission": Target(
                f"{_PLACES}mission_of_places", _MISSION, {"nodes": "[[10, 10], [20, 5]]", **_DEPOT}
            ),
        },
        _geometry("Polygon"),
    ),
    FileFormat(
        "geojson", "GeoJSON of points and polygons",
        {"fleet-mission": Target(f"{_PLACES}mission_of_places", _MISSION, _DEPOT)},
        _is_geojson, (".geojson",),
    ),
    FileFormat(
        "solution", "a solution, which is no instance",
        content=_keys("plan"),
        remedy="it belongs to an instance: crosstrack check INSTANCE {file}",
    ),
    FileFormat(
        "instance", "an instance of crosstrack (JSON)",
        {"": Target(".instances.reading:read_instance")},
        _keys("model"), (".json",),
    ),
    FileFormat(
        "bezier", "a trajectory of Bézier points (JSON)",
        {"minimum-snap": Target(".instances.minimum_snap.poly7:model_of_trajectory")},
        _keys("times", "points"),
    ),
    FileFormat(
        "poly7", "a trajectory of Crazyflie pieces (poly7, CSV)",
        {"minimum-snap": Target(".instances.minimum_snap.poly7:model_of_trajectory")},
        r"\A#?\s*[Dd]uration\s*,\s*x\^0\s*,",
    ),
    FileFormat("movingai-map", "a grid map of MovingAI", _ON_MAP, r"\Atype\s+octile", (".map",)),
    FileFormat(
        "movingai-scen", "scenarios on a grid map of MovingAI (also of MAPF: one agent)",
        {"grid-path": Target(f"{_MAPS}path_of_scenario", {}, {"scenario": "0"})},
        r"\Aversion 1(?:\.0)?\s*$", (".scen",),
    ),
    FileFormat("ros-map", "a map of ROS (YAML beside its image)", _ON_MAP, r"(?s)\A(?=.*^image:).*^resolution:"),
    FileFormat(
        "image", "an image of a map, with dark pixels blocked", _ON_MAP,
        r"\A(?:\x89PNG|GIF8|BM[\s\S]{4}\0\0\0\0|\xff\xd8\xff|P[1-6]\s+[#\d]|RIFF[\s\S]{4}WEBP)",
        (".png", ".bmp", ".gif", ".jpg", ".jpeg", ".pgm", ".pbm", ".ppm", ".webp"),
    ),
    FileFormat(
        "drawings", "drawings of scenes with S and T",
        {"unknown-grid": Target(".instances.unknown_grid.readers:read_scenes", {}, {"view": "[3, 3]"})},
        r"\A(?=[^S]*+S)(?=[^T]*+T)(?=[^.]*+\.)(?:[.@#GOTWS]{2,}+[ \t]*+\r?(?:\n\s*+|\Z))++\Z",
    ),
    FileFormat(
        "text-map", "a grid map in text, one character per cell", _ON_MAP,
        r"\A(?=[^.G]*+[.G])(?:[.@#GOTW]{2,}+\r?(?:\n|\Z))++\s*\Z",
    ),
    FileFormat(
        "sop", "a sequential ordering problem of TSPLIB",
        {
            "guided-path-tour": Target(".instances.guided_path.sop:read_sop"),
            "sequential-ordering": Target(".instances.sequential_ordering.files:load_ordering"),
        },
        _family("SOP"), (".sop",),
    ),
    FileFormat(
        "tour", "a tour of TSPLIB or routes of CVRPLIB, which is a plan",
        content=rf"{_family('TOUR')}|\A\s*+Route\s*#\s*1\b", suffixes=(".tour", ".sol"),
        remedy="solve the instance instead, such as its .tsp or .vrp file; crosstrack check reads plans as JSON",
    ),
    FileFormat(
        "vrplib", "a vehicle routing problem of VRPLIB",
        {"fleet-routing": Target(".instances.fleet.vrplib:read_vrplib", {}, {"vehicles": "4"})},
        rf"{_family('[A-Z]*VRP[A-Z]*')}|^[ \t]*CAPACITY[ \t]*:|^(?:DEMAND|DEPOT)_SECTION", (".vrp",),
        "write what the file lacks, or expresses otherwise, as an instance (JSON)",
    ),
    FileFormat(
        "tsplib", "a travelling salesman problem of TSPLIB",
        {"fleet-routing": Target(".instances.fleet.readers:read_tsplib", {"vehicles": "2"})},
        rf"{_family('A?TSP')}|^[ \t]*EDGE_WEIGHT_TYPE[ \t]*:", (".tsp", ".atsp"),
        "write the distances of other types as a matrix (EDGE_WEIGHT_FORMAT: FULL_MATRIX)",
    ),
    FileFormat(
        "dtspn", "a Dubins tour over discs (x y radius)",
        {"messenger-tour": Target(".instances.messenger.dtspn:read_dtspn", {}, {"turning_radius": "0.25"})},
        rf"\A\s*+(?:{_NUMBERS}(?:\n\s*+|\Z))++\Z",
    ),
    FileFormat(
        "rcsp", "a constrained shortest path of the OR-Library",
        {"resource-routing": Target(".instances.resource_routing.readers:read_rcsp")},
        r"\A\s*+\d+ +\d+ +\d+[ \t\r]*\n(?:[-+.\d \t]++\r?(?:\n|\Z))++\s*\Z",
    ),
    FileFormat(
        "spprclib", "a path problem of SPPRCLIB or PathWyse",
        {"resource-routing": Target(".instances.resource_routing.spprclib:read_spprclib")},
        r"^(?:RES_BOUND|EDGE_COST|NODE_CONSUMPTION)[ \t\r]*$",
    ),
    FileFormat(
        "solomon", "a routing problem with time windows in Solomon's form",
        {"fleet-routing": Target(".instances.fleet.solomon:read_solomon")},
        r"(?s)\A(?=.*^VEHICLE[ \t\r]*$).*^CUSTOMER[ \t\r]*$",
    ),
    FileFormat("gpx", "GPX of a GPS receiver", content=_xml("gpx"), suffixes=(".gpx",), remedy=_DEGREES),
    FileFormat("kml", "KML of Google Earth", content=_xml("kml"), suffixes=(".kml", ".kmz"), remedy=_DEGREES),
    FileFormat("osm", "OpenStreetMap XML", content=_xml("osm"), suffixes=(".osm",), remedy=_DEGREES),
    FileFormat(
        "qgc-mission", "a mission of QGroundControl or ArduPilot",
        content=lambda head: head.text.startswith("QGC WPL") or "fileType" in head.keys,
        remedy=_DEGREES,
    ),
    FileFormat(
        "geodata", "a shapefile, GeoPackage or GeoTIFF",
        content=r"\A(?:\0\0\x27\n|SQLite format 3|II\*\0|MM\0\*)", suffixes=(".shp", ".gpkg", ".tif", ".tiff"),
        remedy="convert it with ogr2ogr or gdal_translate: vectors to GeoJSON in metres, rasters to PNG",
    ),
    FileFormat(
        "log", "a log of PX4 or ROS", content=r"\A(?:ULog\x01|#ROSBAG|\x89MCAP)", suffixes=(".ulg", ".bag"),
        remedy="convert the topic to CSV first, e.g. with ulog2csv or the ROS command for exports",
    ),
    FileFormat(
        "workbook", "an old Excel workbook", content=r"\A\xd0\xcf\x11\xe0", suffixes=(".xls", ".ods", ".xlsm"),
        remedy="save it as .xlsx or CSV",
    ),
    FileFormat(
        "pickle", "a pickle of Python", content=r"\A\x80[\x02-\x05]", suffixes=(".pkl", ".pickle"),
        remedy="reading it can run code: save the model with crosstrack.instances.write_model",
    ),
    FileFormat(
        "program-unread", "a program in OSiL or SIF, to be converted first", {"": Target(".instances.programs.reading:read_program")},
        suffixes=(".osil", ".sif"),
    ),
    FileFormat(
        "table", "a table (CSV or Excel)", {"": Target(".instances.reading:read_table_file")}, suffixes=(".csv", ".xlsx", ".tsv"),
    ),
)  # fmt: skip

#: Content of files of programs whose suffix is another one, by their usual suffix.
_PROGRAMS = {
    ".mps": r"(?s)\A(?=.*^ROWS[ \t\r]*$).*^COLUMNS[ \t\r]*$",
    ".lp": r"(?i)\A(?:[ \t]*(?:\\.*)?\n)*+[ \t]*(?:min|max)[a-z]*\b(?s:.*)^[ \t]*(?:subject to|such that|st|s\.t\.)[\s:]",
    ".nl": r"\A[gb]\d+ \d+ \d+ \d+",
    ".cbf": r"^VER[ \t\r]*\n[ \t]*\d",
    ".mat": r"\AMATLAB 5\.0 MAT-file",
    ".qplib": r"(?i)\A.*\n\s*[LDCQ][CBMIG][NBLDCQ]\b.*\n\s*(?:mini|maxi)mi[sz]e",
}

#: Formats registered by the user, by name.
_SESSION: dict[str, FileFormat] = {}


def register_format(new: FileFormat) -> FileFormat:
    """Add a format of files for this session; it is tried before those of crosstrack.

    Parameters
    ----------
    new : FileFormat
        The format. A format of the same name is replaced.

    Returns
    -------
    FileFormat
        `new`.

    Raises
    ------
    InvalidData
        `new` is not a :class:`FileFormat`.
    """
    _SESSION[required("format", new, FileFormat).name] = new
    return new


def file_formats() -> tuple[FileFormat, ...]:
    """Return all formats of files that crosstrack recognises, in the order of the attempts.

    Returns
    -------
    tuple of FileFormat
        Formats of the user, of other distributions, and of crosstrack, without repeated names.
    """
    declared = (
        item for _, item in loadable(__package__, "FORMATS") if isinstance(item, FileFormat)
    )
    programs = (
        FileFormat(
            f"program{suffix}", f"a program ({suffix})",
            {"": Target(reader)}, _PROGRAMS.get(suffix, ""), (suffix,),
        )
        for suffix, reader in table(__package__, "FILES").items()
    )  # fmt: skip
    result: dict[str, FileFormat] = {}
    for item in (*_SESSION.values(), *declared, *programs, *_FORMATS):
        result.setdefault(item.name, item)
    return tuple(result.values())


def recognise(path: Any) -> FileFormat | None:
    """Return the format of a file: by content, and by suffix if no content matches.

    Parameters
    ----------
    path : path-like
        The file; at most its first 64 KiB are read.

    Returns
    -------
    FileFormat or None
        The first format that matches; None if the format is unknown.

    Raises
    ------
    InvalidData
        The file cannot be read.
    """
    file = as_path(path)
    head, known = Head.of(file), file_formats()
    name = file.stem if file.suffix.casefold() == ".gz" else file.name
    suffix = Path(name).suffix.casefold()
    result = next(
        (item for item in known if item.matches(head)),
        next((item for item in known if suffix in item.suffixes), None),
    )
    if result is None:
        # Any text may be a table, so its content decides last.
        guess = "instance" if re.match(r"\s*(?:[\[{]|\Z)", head.text) else ""
        if not guess and "\0" not in head.text and re.match(r"\s*+[^\n]*[,;\t]", head.text):
            guess = "table"
        result = next((item for item in known if item.name == guess), None)
    return result
