"""Instances of fleet missions: seeded maps in the paper's manner, readers, and plans as files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .files import (
        write_mission_geojson as write_mission_geojson,
        write_mission_poly7 as write_mission_poly7,
        write_mission_samples as write_mission_samples,
    )
    from .generator import random_mission as random_mission
    from .table_3 import table_3_mission as table_3_mission

CATALOGUE = {"fleet-mission": ".listing:catalogue_entries"}
PAPERS = {"fleet-mission": ".paper:PAPER"}
PAPER_TABLES = {"fleet-mission/table-3": ".table_3:measure_table_3"}
REFERENCES = {"fleet-mission": ".files:resolve_references"}
TEMPLATES = {"fleet-mission": "fleet-mission/one-place"}
DEMOS = {"fleet-mission": "fleet-mission/example"}
EXPORTS = {"samples": ".files:SAMPLES", "poly7": ".files:POLY7", "geojson": ".files:GEOJSON"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
