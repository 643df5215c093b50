"""Instances of attractors: known systems, noise, multirobot hunts, and series from files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .exports import write_states_csv as write_states_csv
    from .hunting import Hunt as Hunt, simulate_hunt as simulate_hunt
    from .readers import read_series as read_series
    from .systems import generate as generate

CATALOGUE = {"attractor": ".listing:catalogue_entries"}
TABLE_FILES = {"attractor": ".readers:table_file"}
TEMPLATES = {"attractor": "attractor/samples-50"}
DEMOS = {"attractor": "attractor/hunt"}
EXPORTS = {"csv": ".exports:CSV"}
PAPERS = {"attractor": ".paper:PAPER"}
PAPER_TABLES = {
    "attractor/figures": ".paper_tables:figures",
    "attractor/slopes": ".paper_tables:slopes",
    "attractor/systems": ".paper_tables:systems",
}
TABLE_COLUMNS = {"attractor": {"time [s]": "times", "value": "series"}}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
