"""A paper's tables beside ours: the runs that stand for its columns, and what they gave."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...errors import UnknownName
from ...models.model import Model
from ...models.problems import resolve, table as table_of
from ..crosscheck import Comparison, compare
from ..solution import Solution
from ..verdict import Outcome, Verdict, judge
from .layout import Column, PaperTables
from .tables import number, seconds_text, table

__all__ = ["Reproduction", "reproduce", "reproduction_parts"]


@dataclass(frozen=True)
class Row:
    """One instance of a table: the paper's figures and our answers."""

    table: int
    published: Mapping[str, Any]
    verdict: Verdict


@dataclass(frozen=True)
class Reproduction:
    """A paper's tables with our answers.

    Parameters
    ----------
    problem : str
        The problem.
    rows : tuple of Row
        In the paper's order.
    interrupted : bool
        Whether Ctrl-C ended it.
    """

    problem: str
    rows: tuple[Row, ...]
    interrupted: bool = False

    @property
    def comparison(self) -> Comparison:
        """All rows as one comparison."""
        return Comparison(tuple(row.verdict for row in self.rows), self.interrupted)

    @property
    def outcome(self) -> Outcome:
        """The worst of the verdicts."""
        return self.comparison.outcome

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON data."""
        return {
            "problem": self.problem,
            "verdict": str(self.outcome),
            "interrupted": self.interrupted,
            "note": paper_tables(self.problem).note,
            "rows": [
                {"table": row.table, "published": dict(row.published), **row.verdict.to_dict()}
                for row in self.rows
            ],
        }


def paper_tables(problem: str) -> PaperTables:
    """Return the tables that the paper of `problem` prints; ``UnknownName`` where there are none."""
    known = table_of(__package__.rpartition(".")[0], "PAPER_TABLES")
    if problem not in known:
        raise UnknownName("problem to reproduce", problem, known)
    found: PaperTables = resolve(known[problem])
    return found


def reproduce(
    problem: str,
    instances: Sequence[tuple[Model[Any], Mapping[str, Any]]],
    *,
    time_limit: float | None = 60.0,
    on_solution: Callable[[Solution[Any]], None] | None = None,
) -> Reproduction:
    """Run what stands beside each published figure.

    Parameters
    ----------
    problem : str
        A problem whose tables are known, such as ``"error-correction"``.
    instances : sequence of (Model, mapping)
        Models with their published figures, which name their ``"table"``.
    time_limit : float, optional
        Seconds for each run.
    on_solution : callable, optional
        Called with every answer.
    """
    layouts = paper_tables(problem).tables
    rows: list[Row] = []
    interrupted = False
    for model, published in instances:
        if interrupted:
            break
        layout = layouts[published["table"]]
        answers: list[Solution[Any]] = []
        for warm in (False, True):
            names = [column.backend for column in layout.columns if column.warm is warm]
            if names and not interrupted:
                start = judge(model.name, answers, model).best if warm else None
                part = compare(
                    model,
                    names,
                    time_limit=time_limit,
                    tolerance=layout.tolerance,
                    warm_start=start,
                    compiled=True,
                    on_solution=on_solution,
                )
                interrupted = part.interrupted
                answers.extend(part.solutions)
        rows.append(Row(published["table"], published, judge(model.name, answers, model)))
    return Reproduction(problem, tuple(rows), interrupted)


def reproduction_parts(result: Reproduction) -> list[Any]:
    """Return what to print: the paper's figures and ours, side by side."""
    parts: list[Any] = []
    layouts = paper_tables(result.problem)
    for key, layout in layouts.tables.items():
        rows = [row for row in result.rows if row.table == key]
        if not rows:
            continue
        lengths = any("optimum" in row.published for row in rows)
        head = ["row", *(["optimum\npaper"] if lengths else []), "optimum\nours"]
        for column in layout.columns:
            label = column.backend.replace(":", "\n")
            head += [f"{label}\npaper"] if column.published else []
            head.append(f"{label}{'*' if column.warm else ''}\nours")
        lines = []
        for row in rows:
            best = row.verdict.best
            line = [row.verdict.instance.rpartition("/")[2]]
            line += [number(row.published.get("optimum"), 0)] if lengths else []
            line.append(number(None if best is None else best.primal_bound))
            for column in layout.columns:
                if column.published:
                    line.append(seconds_text(row.published["seconds"].get(column.published)))
                line.append(_ours(column, row.verdict))
            lines.append([*line, str(row.verdict.outcome)])
        parts.append(table(layout.title, [*head, "verdict"], lines, right=head[1:]))
    parts.append(layouts.note)
    return parts


def _ours(column: Column, verdict: Verdict) -> str:
    """Return the seconds of our run, or how it ended without a proof."""
    name, _, formulation = column.backend.partition(":")
    for solution in verdict.solutions:
        if solution.backend == name and formulation in ("", solution.formulation):
            if solution.termination in ("optimal", "infeasible"):
                return seconds_text(solution.seconds.get("solve"))
            if solution.termination in ("locally_optimal", "feasible") and solution.gap is None:
                # Nothing is proven, so what was found stands beside how long it took.
                found = number(solution.primal_bound)
                return f"{found} in {seconds_text(solution.seconds.get('solve'))}"
            gap = "" if solution.gap is None else f", gap {solution.gap:.1%}"
            return f"{solution.limit or solution.termination}{gap}"
    return ""
