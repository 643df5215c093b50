"""The paper's tables, and our runs beside their columns."""

from __future__ import annotations

from ..report.layout import Column, PaperTable, PaperTables

__all__ = ["REPEATS", "TABLES"]

#: Seeds that each backend runs from.
REPEATS = 10

#: The paper's algorithms, its own as printed, and then ours without its pull to the origin.
_FISH = (
    Column("afsa"),
    Column("haafsa"),
    Column("iafsa", options={"shrink": True}),
    Column("iafsa"),
)
_OTHERS = (Column("differential-evolution"), Column("direct"), Column("random-search"))


def _functions(title: str) -> PaperTable:
    return PaperTable(title, (*_FISH, *_OTHERS), repeats=REPEATS, known="known")


TABLES = PaperTables(
    {
        2: _functions("Tables 2 and 3: five functions, by evaluations (medians of 10 seeds)"),
        3: _functions("The same functions, their optima moved (medians of 10 seeds)"),
        4: PaperTable(
            "Tables 4 and 5: paths through waypoints, 10,000 evaluations (m, medians of 10 seeds)",
            (*_FISH, *_OTHERS),
            repeats=REPEATS,
            known="exact",
        ),
    },
    note=(
        "Every algorithm is granted the same evaluations: those of 100 fish in 50, 100 and 200 iterations. "
        "The paper counts iterations, and does not say how many evaluations one takes. iafsa with "
        "shrink=True is the paper's: it multiplies places by a factor below 1, which pulls to the origin. "
        "That finds optima that lie there and nothing else, as the second table shows; direct, which looks "
        "at the centre first, gains by these functions too. The paper has 50 runs, and its figures were "
        "not at hand, so none stands beside ours. 50 seeds, rank tests "
        "and the searches that take longer, of which some find more, are in a benchmark (make bench). "
        "The maps of paths are ours; values hold what is charged for blocked cells. What is exact there is "
        "the shortest path in any direction, which the search any-angle of grid paths proves."
    ),
)
