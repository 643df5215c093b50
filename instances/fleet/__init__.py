"""Instances of fleet routing: small ones of every kind, the paper's sizes, TSPLIB and VRPLIB."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .exports import (
        write_routes_csv as write_routes_csv,
        write_routes_geojson as write_routes_geojson,
        write_vrplib as write_vrplib,
    )
    from .generator import generate as generate
    from .readers import read_nodes as read_nodes, read_tsplib as read_tsplib
    from .solomon import read_solomon as read_solomon
    from .vrplib import read_vrplib as read_vrplib

CATALOGUE = {"fleet": ".listing:catalogue_entries"}
REFERENCES = {"fleet-routing": ".readers:resolve_references"}
TABLE_FILES = {"fleet-routing": ".readers:table_file"}
TABLE_COLUMNS = {
    "fleet-routing": {"x": "points.0", "y": "points.1", "demand": "demands", "id": "ids"}
}
TEMPLATES = {"fleet-routing": "fleet/each-its-own"}
DEMOS = {"fleet": "fleet/max-10"}
EXPORTS = {"csv": ".exports:CSV", "geojson": ".exports:GEOJSON", "vrplib": ".exports:VRPLIB"}
PAPERS = {"fleet": ".paper:PAPER"}
PAPER_TABLES = {"fleet/table-1": ".paper_tables:table_1", "fleet/table-2": ".paper_tables:table_2"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
