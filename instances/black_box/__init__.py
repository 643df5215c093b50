"""Instances of black boxes: the paper's functions, the same with moved optima, special cases, and paths."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .exports import write_point_csv as write_point_csv
    from .generator import generate as generate
    from .paths import path_grid as path_grid, path_instance as path_instance

CATALOGUE = {"black-box": ".listing:catalogue_entries"}
TEMPLATES = {"black-box": "black-box/all-fixed"}
DEMOS = {"black-box": "black-box/example"}
EXPORTS = {"csv": ".exports:CSV"}
PAPERS = {"black-box": ".paper:PAPER"}
PAPER_TABLES = {
    "black-box/table-2": ".paper_tables:table_2",
    "black-box/table-3": ".paper_tables:table_3",
    "black-box/table-4": ".paper_tables:table_4",
    "black-box/table-5": ".paper_tables:table_5",
    "black-box/equal-evaluations": ".paper_tables:equal_evaluations",
    "black-box/paths": ".paper_tables:paths",
}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
