"""Instances of grid paths: seeded maps, readers and writers of maps, polygons and paths."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .generators import (
        maze as maze,
        random_cells as random_cells,
        random_nodes as random_nodes,
        random_polygons as random_polygons,
        rooms as rooms,
    )
    from .geojson import (
        read_geojson_polygons as read_geojson_polygons,
        write_geojson_polygons as write_geojson_polygons,
    )
    from .images import read_image as read_image
    from .listing import paper_map as paper_map
    from .maps import (
        read_grid as read_grid,
        read_polygon_map as read_polygon_map,
        read_text_map as read_text_map,
        write_text_map as write_text_map,
    )
    from .movingai import (
        Scenario as Scenario,
        read_map as read_map,
        read_scenarios as read_scenarios,
        write_map as write_map,
    )
    from .paths import (
        write_paths_csv as write_paths_csv,
        write_paths_geojson as write_paths_geojson,
    )
    from .ros import read_ros_map as read_ros_map

#: Names that modules of other problems import, beside the public ones.
SHARED = ("listing.PAPER", "maps.resolve_references", "paper.PAPER")
CATALOGUE = {"grid-path": ".listing:catalogue_entries"}
TEMPLATES = {"grid-path": "grid-path/pocket"}
PAPERS = {"grid-path": ".paper:PAPER"}
REFERENCES = {"grid-path": ".maps:resolve_references"}
DEMOS = {"grid-path": ".demo:DEMO"}
EXPORTS = {"csv": ".paths:CSV", "geojson": ".paths:GEOJSON"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
