"""Missions whose obstacles lie in a file of their own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..grid_path.geojson import read_geojson_polygons
from ..storage import Find

__all__ = ["resolve_references"]


def resolve_references(data: Mapping[str, Any], find: Find) -> dict[str, Any]:
    """Return `data` of an instance with ``"obstacles": "file.geojson"`` replaced by the polygons.

    Coordinates are taken as metres.
    """
    found = dict(data)
    if isinstance(found.get("obstacles"), str):
        found["obstacles"] = read_geojson_polygons(find(found["obstacles"]))
    return found
