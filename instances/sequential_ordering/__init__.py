"""Instances of sequential ordering: random ones as in SOPLIB, special cases, files of TSPLIB and SOPLIB."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .files import (
        read_ordering as read_ordering,
        write_ordering as write_ordering,
        write_ordering_csv as write_ordering_csv,
        write_path as write_path,
    )
    from .listing import generate_ordering as generate_ordering

CATALOGUE = {"sequential-ordering": ".listing:catalogue_entries"}
REFERENCES = {"sequential-ordering": ".files:resolve_references"}
DEMOS = {"sequential-ordering": "sequential-ordering/random-20-1000-15"}
EXPORTS = {"csv": ".files:CSV", "tsplib": ".files:TSPLIB"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
