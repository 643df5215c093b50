"""Instances of a guided vehicle's tour: the paper's example and sizes, special cases, SOP files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .exports import write_stops_csv as write_stops_csv, write_tour as write_tour
    from .generator import generate as generate, generate_relation as generate_relation
    from .sop import read_sop as read_sop, write_sop as write_sop
    from .stops import read_stops as read_stops
    from .supersequence import (
        supersequence_of as supersequence_of,
        supersequence_tour as supersequence_tour,
    )

#: Names that modules of other problems import, beside the public ones.
SHARED = ("sop.INFINITE", "sop.read_matrix", "sop.sop_text", "sop.tour_text")
CATALOGUE = {"guided-path": ".listing:catalogue_entries"}
REFERENCES = {"guided-path-tour": ".stops:resolve_references"}
TABLE_FILES = {"guided-path-tour": ".stops:read_stops"}
DEMOS = {"guided-path": "guided-path/table-1-k8"}
EXPORTS = {"csv": ".exports:CSV", "tsplib": ".exports:TSPLIB"}
PAPERS = {"guided-path": ".paper:PAPER"}
PAPER_TABLES = {
    "guided-path/table-1a": ".paper_tables:table_1a",
    "guided-path/table-1b": ".paper_tables:table_1b",
}
TABLE_COLUMNS = {"guided-path-tour": {"coordinate": "coordinates", "id": "ids"}}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
