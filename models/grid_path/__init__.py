"""Shortest path on a grid map."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .gridmap import GridMap as GridMap
    from .model import Connectivity as Connectivity, GridPath as GridPath, Reach as Reach
    from .plan import GridPlan as GridPlan
    from .polygons import Polygon as Polygon, Polygons as Polygons, as_shapely as as_shapely
    from .shortest import distances as distances, path_between as path_between, trail as trail
    from .sight import Sight as Sight, line_of_sight as line_of_sight

#: Private names that modules of other problems import.
SHARED = ("gridmap.MOST", "gridmap.enlarged", "gridmap.read_cells")
MODELS = {"grid-path": ".model:GridPath"}
PICTURES = {"grid-path": ".plot:draw"}
ANIMATIONS = {"grid-path": ".plot:animate_paths"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
