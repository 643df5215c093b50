"""A paper's tables beside ours: the runs that stand for its columns, and what they gave."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from ...errors import UnknownName
from ...models.model import Model
from ...models.problems import resolve, table as table_of
from ..crosscheck import Comparison, compare
from ..solution import Solution
from ..verdict import Outcome, Verdict, judge
from .layout import Column, PaperTable, PaperTables
from .tables import number, seconds_text, table

__all__ = ["Reproduction", "reproduce", "reproduction_parts"]


@dataclass(frozen=True)
class Row:
    """One instance of a table: the paper's figures and our answers.

    Parameters
    ----------
    table : int
        Number of the table.
    published : mapping
        The paper's figures.
    verdict : Verdict
        On all answers.
    answers : tuple of tuple of Solution
        The answers of each column, one a seed; none where it was interrupted before.
    evaluations : int, optional
        What each run was granted, where the table varies it.
    """

    table: int
    published: Mapping[str, Any]
    verdict: Verdict
    answers: tuple[tuple[Solution[Any], ...], ...]
    evaluations: int | None = None

    @property
    def label(self) -> str:
        """What stands in front of it."""
        name = self.verdict.instance.rpartition("/")[2]
        return name if self.evaluations is None else f"{name}, {self.evaluations}"

    def to_dict(self) -> dict[str, Any]:
        """Return the row as JSON data."""
        granted = {} if self.evaluations is None else {"evaluations": self.evaluations}
        return {
            "table": self.table,
            "published": dict(self.published),
            **granted,
            **self.verdict.to_dict(),
        }


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
            "rows": [row.to_dict() for row in self.rows],
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
        layout = layouts[published["table"]]
        # Of repeated runs no seconds are shown, which runs beside others would lengthen.
        workers = (os.cpu_count() or 1) if layout.repeats > 1 else 1
        for evaluations in published.get("evaluations", (None,)):
            if interrupted:
                break
            found: list[Solution[Any]] = []
            answers: list[tuple[Solution[Any], ...]] = [()] * len(layout.columns)
            for warm, places in _turns(layout):
                if interrupted:
                    break
                columns = [layout.columns[place] for place in places]
                part = compare(
                    model,
                    list(dict.fromkeys(column.backend for column in columns)),
                    time_limit=time_limit,
                    tolerance=layout.tolerance,
                    evaluations=evaluations,
                    repeats=layout.repeats,
                    warm_start=judge(model.name, found, model).best if warm else None,
                    backend_options={_named(column): column.options for column in columns},
                    compiled=True,
                    workers=workers,
                    on_solution=on_solution,
                )
                interrupted = part.interrupted
                found.extend(part.solutions)
                for place, column in zip(places, columns, strict=True):
                    answers[place] = tuple(s for s in part.solutions if _stands(s, column))
            verdict = judge(model.name, found, model)
            rows.append(Row(published["table"], published, verdict, tuple(answers), evaluations))
    return Reproduction(problem, tuple(rows), interrupted)


def _named(column: Column) -> str:
    return column.backend.partition(":")[0]


def _stands(solution: Solution[Any], column: Column) -> bool:
    """Return whether `solution`, of a run with the options of `column`, stands below it."""
    formulation = column.backend.partition(":")[2]
    return solution.backend == _named(column) and formulation in ("", solution.formulation)


def _turns(layout: PaperTable) -> list[tuple[bool, list[int]]]:
    """Return the columns that run together, warm ones last; of one backend only with equal options."""
    turns: list[tuple[bool, list[int]]] = []
    for warm in (False, True):
        left = [place for place, column in enumerate(layout.columns) if column.warm is warm]
        while left:
            options: dict[str, Mapping[str, Any]] = {}
            together = []
            for place in left:
                column = layout.columns[place]
                if options.setdefault(_named(column), column.options) == column.options:
                    together.append(place)
            left = [place for place in left if place not in together]
            turns.append((warm, together))
    return turns


def reproduction_parts(result: Reproduction) -> list[Any]:
    """Return what to print: the paper's figures and ours, side by side."""
    parts: list[Any] = []
    layouts = paper_tables(result.problem)
    for key, layout in layouts.tables.items():
        rows = [row for row in result.rows if row.table == key]
        if not rows:
            continue
        lengths = any("optimum" in row.published for row in rows)
        head = ["row", *([f"optimum\n{layout.known}"] if lengths else []), "optimum\nours"]
        for column in layout.columns:
            head += [f"{column.label}\npaper"] if column.published else []
            head.append(f"{column.label}{'*' if column.warm else ''}\nours")
        lines = []
        for row in rows:
            best = row.verdict.best
            line = [row.label]
            line += [number(row.published.get("optimum"), 0)] if lengths else []
            line.append(number(None if best is None else best.primal_bound))
            for column, answers in zip(layout.columns, row.answers, strict=True):
                if column.figure and column.published:
                    line.append(number(row.published.get(column.published)))
                elif column.published:
                    line.append(seconds_text(row.published["seconds"].get(column.published)))
                once = _ours(answers) if layout.repeats == 1 else _median(answers)
                line.append(_figure(column.figure, answers) if column.figure else once)
            lines.append([*line, str(row.verdict.outcome)])
        parts.append(table(layout.title, [*head, "verdict"], lines, right=head[1:]))
    parts.append(layouts.note)
    return parts


def _ours(answers: Sequence[Solution[Any]]) -> str:
    """Return the seconds of our run, or how it ended without a proof."""
    for solution in answers:
        if solution.termination in ("optimal", "infeasible"):
            return seconds_text(solution.seconds.get("solve"))
        if solution.termination in ("locally_optimal", "feasible") and solution.gap is None:
            # Nothing is proven, so what was found stands beside how long it took.
            found = number(solution.primal_bound)
            return f"{found} in {seconds_text(solution.seconds.get('solve'))}"
        gap = "" if solution.gap is None else f", gap {solution.gap:.1%}"
        return f"{solution.limit or solution.termination}{gap}"
    return ""


def _figure(figure: str, answers: Sequence[Solution[Any]]) -> str:
    """Return the median of a figure of the plans, the first word where it is none, empty without plans."""
    read = [_read(s, figure) for s in answers]
    found = [value for value in read if value is not None]
    if not found:
        return ""
    return found[0] if isinstance(found[0], str) else number(float(median(found)))


def _read(solution: Solution[Any], figure: str) -> Any:
    """Return an attribute of a plan by its dotted name, or the objective; None where a part is missing."""
    if figure == "objective":
        return solution.primal_bound
    found = solution.plan
    for name in figure.split("."):
        found = None if found is None else getattr(found, name)
    return found


def _median(answers: Sequence[Solution[Any]]) -> str:
    """Return the median of what the seeds found, or how most of them ended without a plan."""
    values = [math.inf if s.primal_bound is None else s.primal_bound for s in answers]
    middle = median(values) if values else math.inf
    if math.isfinite(middle):
        return f"{middle:.3g}"
    return next((str(s.termination) for s in answers if s.primal_bound is None), "")
