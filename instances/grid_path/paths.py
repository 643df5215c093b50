"""Paths as tables and as GeoJSON, for other software."""

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
    """Write the points of every path as CSV, in one step; return the path.

    The columns are ``path,x,y``: the number of the path, from 0, and m.
    """
    paths = required("plan", plan, GridPlan).paths
    lines = [f"{k},{x!r},{y!r}" for k, one in enumerate(paths) for x, y in one.tolist()]
    return write_text(path, "\n".join(["path,x,y", *lines]) + "\n")


def write_paths_geojson(plan: GridPlan, path: str | os.PathLike[str]) -> Path:
    """Write every path as a LineString of a GeoJSON file, in one step; return the path.

    Coordinates are metres in the map's plane, not longitudes and latitudes. A path of one point, which
    GeoJSON does not have, is written as that point twice.
    """
    features = []
    for k, one in enumerate(required("plan", plan, GridPlan).paths):
        points = one.tolist()
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
