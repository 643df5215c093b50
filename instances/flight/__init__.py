"""Instances of flights: seeded maps in three dimensions, and flights through maps of all forms."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .files import (
        write_flight_poly7 as write_flight_poly7,
        write_flight_samples as write_flight_samples,
    )
    from .generators import forest as forest, noise_map as noise_map

CATALOGUE = {"flight": ".listing:catalogue_entries"}
TEMPLATES = {"flight": "flight/wall"}
DEMOS = {"flight": "flight/wall"}
EXPORTS = {"samples": ".files:SAMPLES", "poly7": ".files:POLY7"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
