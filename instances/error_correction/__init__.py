"""Instances of error-correction routing: the paper's settings, generators, files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .files import (
        PointTable as PointTable,
        read_csv as read_csv,
        read_points as read_points,
        write_csv as write_csv,
        write_json as write_json,
    )
    from .generator import (
        generate as generate,
        generate_with_route as generate_with_route,
        random_small as random_small,
        uniform_slab as uniform_slab,
        with_suspects as with_suspects,
    )
    from .listing import example_1 as example_1, setting_model as setting_model
    from .settings import (
        SETTINGS as SETTINGS,
        TABLE_2 as TABLE_2,
        TABLE_3 as TABLE_3,
        Setting as Setting,
        Thresholds as Thresholds,
    )

CATALOGUE = {"error-correction": ".listing:catalogue_entries"}
REFERENCES = {"error-correction": ".files:resolve_references"}
TABLE_FILES = {"error-correction": ".files:points_of_table"}
TABLE_COLUMNS = {
    "error-correction": {
        "id": "ids",
        **{x: f"points.{k}" for k, x in enumerate("xyz")},
        "kind": "kinds",
    }
}
PAPERS = {"error-correction": ".paper:PAPER"}
PAPER_TABLES = {f"error-correction/table-{k}": f".paper_tables:table_{k}" for k in (1, 2, 3)}
DEMOS = {"error-correction": ".demo:DEMO"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
