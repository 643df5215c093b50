"""Instances of messenger tours: seeded instances of the paper's sizes, and readers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .dtspn import read_best_known as read_best_known, read_dtspn as read_dtspn
    from .generator import generate as generate
    from .samples import write_tour_samples as write_tour_samples
    from .vehicles import read_vehicles as read_vehicles

CATALOGUE = {"messenger": ".listing:catalogue_entries"}
REFERENCES = {"messenger-tour": ".vehicles:resolve_references"}
TABLE_FILES = {"messenger-tour": ".vehicles:read_vehicles"}
DEMOS = {"messenger": "messenger/B-10-05"}
EXPORTS = {"samples": ".samples:SAMPLES"}
PAPERS = {"messenger": ".paper:PAPER"}
PAPER_TABLES = {
    f"messenger/{name}": f".paper_tables:{name.replace('-', '_')}"
    for name in ("table-3", "table-4", "table-5", "table-6", "figure-5", "figure-7")
}
TABLE_COLUMNS = {
    "messenger-tour": {
        "x": "positions.0", "y": "positions.1", "vx": "velocities.0", "vy": "velocities.1",
        "radius": "radius", "id": "ids", "earliest": "windows.0", "latest": "windows.1",
    }
}  # fmt: skip

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
