"""Missions whose obstacles are in a separate file."""

from __future__ import annotations

from ..grid_path.geojson import read_geojson_polygons
from ..storage import reference

__all__ = ["resolve_references"]

#: Replaces ``"obstacles": "file.geojson"`` in an instance by the polygons, whose coordinates are metres.
resolve_references = reference("obstacles", lambda file: {"obstacles": read_geojson_polygons(file)})
