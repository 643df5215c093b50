"""Export of paths as tables and as GeoJSON."""

from __future__ import annotations

import os
from pathlib import Path

from ...models.fields import required
from ...models.grid_path.plan import GridPlan
from ..exports import ExportFormat, write_geojson
from ..tables import write_rows

__all__ = ["CSV", "GEOJSON", "write_paths_csv", "write_paths_geojson"]


def write_paths_csv(plan: GridPlan, path: str | os.PathLike[str]) -> Path:
    """Write the points of every path as CSV, atomically.

    The columns are ``path,x,y``: the index of the path, from 0, and coordinates in metres.

    Parameters
    ----------
    plan, path
        Paths, and file to write.

    Returns
    -------
    pathlib.Path
        Path of the file.

    Raises
    ------
    InvalidData
        The file cannot be written.
    """
    paths = required("plan", plan, GridPlan).paths
    rows = [(k, x, y) for k, points in enumerate(paths) for x, y in points.tolist()]
    return write_rows(path, ("path", "x", "y"), rows)


def write_paths_geojson(plan: GridPlan, path: str | os.PathLike[str]) -> Path:
    """Write every path as a LineString of a GeoJSON file, atomically.

    Coordinates are metres in the map's plane instead of longitudes and latitudes. GeoJSON requires two
    points per line, so a path of one point is written with the point twice.

    Parameters
    ----------
    plan, path
        Paths, and file to write.

    Returns
    -------
    pathlib.Path
        Path of the file.

    Raises
    ------
    InvalidData
        The file cannot be written.
    """
    lines = [array.tolist() for array in required("plan", plan, GridPlan).paths]
    return write_geojson(
        path,
        (
            ("LineString", points if len(points) > 1 else points * 2, {"path": k})
            for k, points in enumerate(lines)
        ),
    )


CSV = ExportFormat("points of the paths (CSV)", ".csv", write_paths_csv)
GEOJSON = ExportFormat("paths as lines (GeoJSON, in metres)", ".geojson", write_paths_geojson)
