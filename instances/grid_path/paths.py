"""Export of paths as tables and as GeoJSON."""

from __future__ import annotations

import os
from pathlib import Path

from ...files import write_text
from ...models.fields import required
from ...models.grid_path.plan import GridPlan
from ..exports import ExportFormat
from .geojson import collection

__all__ = ["CSV", "GEOJSON", "write_paths_csv", "write_paths_geojson"]


def write_paths_csv(plan: GridPlan, path: str | os.PathLike[str]) -> Path:
    """Write the points of every path as CSV, atomically.

    The columns are ``path,x,y``: the index of the path, from 0, and coordinates in metres.

    Parameters
    ----------
    plan : GridPlan
        Paths to write.
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
    paths = required("plan", plan, GridPlan).paths
    lines = [f"{k},{x!r},{y!r}" for k, points in enumerate(paths) for x, y in points.tolist()]
    return write_text(path, "\n".join(["path,x,y", *lines]) + "\n")


def write_paths_geojson(plan: GridPlan, path: str | os.PathLike[str]) -> Path:
    """Write every path as a LineString of a GeoJSON file, atomically.

    Coordinates are metres in the map's plane instead of longitudes and latitudes. GeoJSON requires two
    points per line, so a path of one point is written with the point twice.

    Parameters
    ----------
    plan : GridPlan
        Paths to write.
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
    features = []
    for k, array in enumerate(required("plan", plan, GridPlan).paths):
        points = array.tolist()
        features.append(
            {
                "type": "Feature",
                "properties": {"path": k},
                "geometry": {
                    "type": "LineString",
                    "coordinates": points if len(points) > 1 else points * 2,
                },
            }
        )
    return write_text(path, collection(features))


CSV = ExportFormat("points of the paths (CSV)", ".csv", write_paths_csv)
GEOJSON = ExportFormat("paths as lines (GeoJSON, in metres)", ".geojson", write_paths_geojson)
