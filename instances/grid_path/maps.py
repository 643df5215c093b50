"""Readers of map files in all formats, and of instances that refer to map files."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from ...errors import InvalidData, suggestion
from ...files import as_path, read_text, write_text
from ...models.fields import Array, Flag, required, show
from ...models.grid_path.gridmap import GridMap, read_cells
from ..projection import project_rings
from ..storage import Find
from .geojson import read_geojson_polygons
from .images import SUFFIXES, read_image
from .movingai import read_map

__all__ = ["read_grid", "read_polygon_map", "read_text_map", "resolve_references", "write_text_map"]


def read_text_map(
    path: str | os.PathLike[str],
    *,
    cell: float = 1.0,
    origin: ArrayLike = (0.0, 0.0),
    upward: bool = False,
) -> GridMap:
    """Return the map in a text file with one character per cell.

    Parameters
    ----------
    path : path-like
        File with ``.`` and ``G`` for free cells, ``@``, ``O``, ``T``, ``W`` and ``#`` for blocked cells.
    cell : float, default 1
        Side of a cell, m.
    origin : array-like, shape (2,), default (0, 0)
        Corner of the map with the lowest x and y, m.
    upward : bool, default False
        Whether y points upward. If true, row 0 is the last line, otherwise the first line.

    Returns
    -------
    GridMap
        Map in the file.

    Raises
    ------
    InvalidData
        A character is unknown, the lengths of lines differ, or no cell is free. The message names file,
        line and column.
    """
    file = as_path(path)
    lines = read_text(file).rstrip("\r\n").splitlines()
    blocked = read_cells(lines, str(file), (1, 1))
    if blocked.all():
        raise InvalidData(f"{file}: must hold at least one free cell, got none", field="blocked")
    return GridMap(blocked[::-1] if upward else blocked, cell, origin, upward)  # type: ignore[arg-type]


def write_text_map(grid: GridMap, path: str | os.PathLike[str]) -> Path:
    """Write the cells of a map as text in the orientation of plots, atomically.

    Parameters
    ----------
    grid : GridMap
        Map to write.
    path : path-like
        Path of the file.

    Returns
    -------
    pathlib.Path
        Path of the file.

    Raises
    ------
    InvalidData
        The file cannot be written.
    """
    lines = required("grid", grid, GridMap).data()["blocked"]
    return write_text(path, "\n".join(lines[::-1] if grid.upward else lines) + "\n")


def read_polygon_map(
    path: str | os.PathLike[str],
    *,
    bounds: ArrayLike,
    cell: float,
    radius: float = 0.0,
    geographic: bool = False,
) -> GridMap:
    """Return the map of the polygons in a GeoJSON file.

    Parameters
    ----------
    path : path-like
        Path of the file.
    bounds, cell, radius
        See :meth:`~crosstrack.models.grid_path.GridMap.from_polygons`.
    geographic : bool, default False
        Whether the coordinates in the file are longitudes and latitudes, and `bounds` the lowest
        longitude and latitude and the highest ones, in degrees. They are projected to metres.

    Returns
    -------
    GridMap
        Map of the polygons within the bounds.

    Raises
    ------
    InvalidData
        The file or an argument is invalid.
    """
    polygons: Any = read_geojson_polygons(path)
    if Flag().coerce("geographic", geographic, {}):
        west, south, east, north = Array((4,)).coerce("bounds", bounds, {})
        corners = [(x, y) for x in (west, east) for y in (south, north)]
        polygons, plane = project_rings(polygons, corners, str(path))
        bounds = [*plane.min(axis=0), *plane.max(axis=0)]
    return GridMap.from_polygons(polygons, bounds, cell, radius)


#: Reader of each file format by suffix.
_READERS: dict[str, Callable[..., GridMap]] = {
    ".map": read_map,
    ".txt": read_text_map,
    ".geojson": read_polygon_map,
    ".json": read_polygon_map,
    **dict.fromkeys(SUFFIXES, read_image),
}


def read_grid(path: str | os.PathLike[str], /, **options: Any) -> GridMap:
    """Return the map in a file. The suffix selects the reader.

    Parameters
    ----------
    path : path-like
        ``.map`` (MovingAI), ``.txt``, ``.geojson`` or ``.json`` (polygons), ``.png`` or another image.
    **options
        Options of the reader: :func:`read_map`, :func:`read_text_map`, :func:`read_polygon_map` or
        :func:`read_image`.

    Returns
    -------
    GridMap
        Map in the file.

    Raises
    ------
    InvalidData
        The suffix or an option is unknown, a required option is missing, or the file is invalid.
    """
    file = as_path(path)
    suffix = file.suffix.casefold()
    if suffix not in _READERS:
        raise InvalidData(
            f"{file}: the name of a map's file must end in {', '.join(_READERS)}", field="map"
        )
    known = dict(inspect.signature(_READERS[suffix]).parameters)
    del known["path"]
    for name in options:
        if name not in known:
            raise InvalidData(
                f"{show(name)} is no option of maps in {suffix} files; "
                f"{suggestion(name, known)}its options: {', '.join(known)}",
                field="map",
            )
    lacking = [n for n, p in known.items() if p.default is p.empty and n not in options]
    if lacking:
        raise InvalidData(
            f"maps in {suffix} files need {', '.join(lacking)} beside the file", field="map"
        )
    return _READERS[suffix](file, **options)


def resolve_references(data: Mapping[str, Any], find: Find) -> dict[str, Any]:
    """Return the data of an instance after replacing a reference to a map file by the map.

    ``"map": "rooms.map"`` names a file. ``"map": {"file": "walls.geojson", "bounds": […], "cell": 1}``
    also passes options of :func:`read_grid`.
    """
    result = dict(data)
    entry = result.get("map")
    options = {"file": entry} if isinstance(entry, str) else entry
    if isinstance(options, Mapping) and "file" in options:
        options = dict(options)
        name = options.pop("file")
        if not isinstance(name, str):
            raise InvalidData(f"map.file must name a file, got {show(name)}", field="map")
        result["map"] = read_grid(find(name), **options)
    return result
