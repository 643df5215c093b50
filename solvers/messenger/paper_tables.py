"""The paper's tables, and our runs beside their columns."""

from __future__ import annotations

from ..report.layout import Column, PaperTable, PaperTables

__all__ = ["TABLES"]

TABLES = PaperTables(
    {
        3: PaperTable(
            "Table III: direct sampling (DS) against the memetic algorithm (MA)",
            (Column("tour-search"), Column("direct-sampling"), Column("memetic")),
        ),
        4: PaperTable(
            "Tables IV and V: the memetic algorithm (MA), without its transformation (MA-T), its rivals",
            (
                Column("tour-search"),
                Column("memetic"),
                Column("memetic-untransformed"),
                Column("memetic-relaxed"),
                Column("variable-neighbourhood"),
                Column("greedy-boundary"),
                Column("greedy-centre"),
            ),
        ),
    },
    note=(
        "The paper does not publish its instances: ours have its numbers of vehicles and its range of "
        "sparsity, and come from a seed, so lengths compare by their magnitude only. Each cell is one "
        "run: the length in m and the seconds of the search. The paper's means are of 25 runs; of "
        "the memetic algorithm they are 205 to 480 m for 10 vehicles, 1770 to 3194 m for 20, 0.96e4 "
        "to 2.96e4 m for 30, 8.3e4 to 2.4e5 m for 40, and its tables IV and V disagree. Table VI, the "
        "effect of radii and of the period of the local search, is a benchmark (make bench)."
    ),
)
