"""The paper's tables, and our runs beside their columns."""

from __future__ import annotations

from ..report.layout import Column, PaperTable, PaperTables

__all__ = ["TABLES"]

_PAPERS = (
    Column("fleet-search"),
    Column("pso-ac"),
    Column("pso-ac-serial"),
    Column("tpha"),
    Column("kmeans-ac"),
    Column("ortools-routing"),
)

TABLES = PaperTables(
    {
        2: PaperTable(
            "Table 2: parallel PSO-AC against its serial form, TPHA and k-means-AC on TSPLIB",
            (*_PAPERS, Column("pyvrp")),
        ),
        3: PaperTable(
            "Table 3: the sum of all lengths and q times their deviation, 4 robots, 75 nodes, 28 obstacles",
            _PAPERS,
        ),
    },
    note=(
        "Nothing of the paper's table 2 compares with ours: it prints neither the number of robots nor "
        "its fitness. Three robots with nearly equal loads from city 1 fit its best figures of bayg29, "
        "berlin52, st70, eil101, ch150 and kroA200 (10403.2, 8470.35, 826.925, 681.1, 6673.28, 31271.1) "
        "best; its mean of st70, 77.47, is a running time. TSPLIB's files are not ours to ship: "
        "make bench compares all algorithms on them, at equal time, by total, deviation and longest "
        "route. The map and nodes of table 3 are not published: ours have their numbers and come from a "
        "seed, so only what q does compares. The deviation there divides by m - 1, as the paper's "
        "figures do, and not by m, as its eq. 16. Each cell is one run: the objective and the seconds of "
        "the search; OR-Tools searches until the time limit. Table 1, the speed-up of parallel "
        "evaluation by the size of the swarm, is a benchmark (make bench)."
    ),
)
