"""The paper's tables, and our runs beside their columns."""

from __future__ import annotations

from ..report.layout import Column, PaperTable, PaperTables

__all__ = ["TABLES"]

TABLES = PaperTables(
    {
        1: PaperTable(
            "The rapid slew: the paper's method and its kin, and the field's steering laws",
            (
                Column("ipopt:paper", "paper"),
                Column("ipopt:gauss"),
                Column("ipopt:radau"),
                Column("ipopt:hermite-simpson"),
                Column("slew-pseudo-inverse"),
                Column("slew-generalised"),
            ),
            tolerance=1e-4,
        ),
    },
    note=(
        "The paper prints a final time of 7.836 s at a tolerance of 1e-3, after 4.1 minutes, but "
        "neither the momentum of a wheel nor the weight of the gimbal rates: both are ours. Each "
        "cell gives ours J and the seconds of the search, to a tolerance of 1e-4. One interval, as "
        "the paper has it, is rejected where no degree resolves the corners that limits leave in the "
        "controls: the plan meets its limits at the nodes, and not between them."
    ),
)
