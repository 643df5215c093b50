"""Maps in files of any kind, and instances that refer to them."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from ...errors import InvalidData, suggestion
from ...files import as_path, read_text, write_text
from ...models.fields import required, show
from ...models.grid_path.gridmap import GridMap, read_cells
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
    """Return the map in a text file, a character a cell.

    Parameters
    ----------
    path : path-like
        The file: ``.`` and ``G`` are free, ``@``, ``O``, ``T``, ``W`` and ``#`` blocked.
    cell : float
        Side of a cell, m.
    origin : array-like, shape (2,)
        As of :class:`~crosstrack.models.grid_path.GridMap`: the corner of the least x and y.
    upward : bool
        Whether y grows upward: then the last line is row 0, else the first.

    Raises
    ------
    InvalidData
        Naming file, line and column: unknown characters, lines of different lengths, no free cell.
    """
    file = as_path(path)
    lines = read_text(file).splitlines()
    while lines and not lines[-1]:
        lines.pop()
    blocked = read_cells(lines, str(file), (1, 1))
    if blocked.all():
        raise InvalidData(f"{file}: must hold at least one free cell, got none", field="blocked")
    return GridMap(blocked[::-1] if upward else blocked, cell, origin, upward)  # type: ignore[arg-type]


def write_text_map(grid: GridMap, path: str | os.PathLike[str]) -> Path:
    """Write the cells of a map as text, as pictures show them, in one step; return the path."""
    lines = required("grid", grid, GridMap).data()["blocked"]
    return write_text(path, "\n".join(lines[::-1] if grid.upward else lines) + "\n")


def read_polygon_map(
    path: str | os.PathLike[str], *, bounds: ArrayLike, cell: float, radius: float = 0.0
) -> GridMap:
    """Return the map of the polygons in a GeoJSON file.

    The parameters are those of :meth:`~crosstrack.models.grid_path.GridMap.from_polygons`.
    """
    return GridMap.from_polygons(read_geojson_polygons(path), bounds, cell, radius)


#: How each kind of file is read, by what its name ends in.
_READERS: dict[str, Callable[..., GridMap]] = {
    ".map": read_map,
    ".txt": read_text_map,
    ".geojson": read_polygon_map,
    ".json": read_polygon_map,
    **dict.fromkeys(SUFFIXES, read_image),
}


def read_grid(path: str | os.PathLike[str], /, **options: Any) -> GridMap:
    """Return the map in a file, read by what its name ends in.

    Parameters
    ----------
    path : path-like
        ``.map`` (MovingAI), ``.txt``, ``.geojson`` or ``.json`` (polygons), ``.png`` or another image.
    **options
        Those of the reader: :func:`read_map`, :func:`read_text_map`, :func:`read_polygon_map`,
        :func:`read_image`.

    Raises
    ------
    InvalidData
        Another suffix, an option that the reader does not have or lacks, a file that it refuses.
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
    """Return `data` of an instance with the map that it names read from its file.

    ``"map": "rooms.map"`` names a file; ``"map": {"file": "walls.geojson", "bounds": […], "cell": 1}``
    gives options of :func:`read_grid` as well.
    """
    found = dict(data)
    held = found.get("map")
    options = {"file": held} if isinstance(held, str) else held
    if isinstance(options, Mapping) and "file" in options:
        options = dict(options)
        name = options.pop("file")
        if not isinstance(name, str):
            raise InvalidData(f"map.file must name a file, got {show(name)}", field="map")
        found["map"] = read_grid(find(name), **options)
    return found
