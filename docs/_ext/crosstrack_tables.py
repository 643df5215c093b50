"""Tables of measured values from ``docs/measured`` and from the records of the campaign.

* ``crosstrack-measured PROBLEM/TABLE``: a table with date, script and versions of the measurement;
* ``crosstrack-beside PREFIX …``: known values of the catalogue's instances compared with the best verified values
  of the campaign, or with the column ``:measured: PROBLEM/TABLE COLUMN``. ``:figure:`` selects a published value
  other than the objective.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from crosstrack_site import Made, markdown_table
from docutils.parsers.rst import directives
from sphinx.application import Sphinx

#: Relative tolerance for equal objectives in the campaign.
EQUAL = 1e-6


def cell(value: Any, form: str) -> str:
    """Return the formatted value, a string unchanged, or an empty string for None."""
    if value is None:
        return ""
    return format(value, form) if isinstance(value, int | float) else str(value)


class Table(Made):
    """Base of directives that read a file in the source folder."""

    required_arguments = 1
    wide = True

    def path(self, *parts: str) -> Path:
        """Return the path of a file and register it as a dependency of the page."""
        path = Path(self.env.app.srcdir, *parts)
        self.env.note_dependency(str(path))
        return path

    def measured(self, name: str) -> dict[str, Any]:
        """Return the table ``PROBLEM/TABLE``."""
        problem, _, table = name.partition("/")
        tables = json.loads(self.path("measured", f"{problem}.json").read_text("utf-8"))
        return dict(tables[table])

    @staticmethod
    def source(table: dict[str, Any]) -> str:
        """Return a sentence with the date, script and versions of the measurement."""
        versions = ", ".join(f"{package} {number}" for package, number in table["versions"].items())
        measured = f"Measured on {table['date']} by `{table['script']}`: {versions}"
        where = f"{table['processors']} processors of a shared machine."
        return f"{table['said']} {measured}, {where}".strip()


class Measured(Table):
    """Table written by a benchmark script, with the conditions of the measurement."""

    def make(self) -> str:
        table = self.measured(self.arguments[0])
        forms = table["columns"].values()
        rows = [map(cell, row, forms) for row in table["rows"]]
        return "\n\n".join([markdown_table(table["columns"], rows), self.source(table)])


def competes(answer: Any) -> bool:
    """Return True if the backend of an answer reads no hidden data."""
    from crosstrack.solvers import find_backend

    return not find_backend(answer.backend, problem=answer.problem or None).sees_hidden


@cache
def records(path: Path) -> dict[str, list[Any]]:
    """Return the answers of a campaign by instance, without backends that read hidden data."""
    from crosstrack.solvers.bench import read_records

    answers: dict[str, list[Any]] = {}
    for solution in read_records(path).solutions:
        if competes(solution):
            answers.setdefault(solution.instance, []).append(solution)
    return answers


def best(answers: list[Any]) -> Any:
    """Return the best verified answer; ties are broken by proof and then by time."""
    good = [
        s for s in answers if s.primal_bound is not None and s.verification and s.verification.ok
    ]
    if not good:
        return None
    minimum = min(s.primal_bound for s in good)
    ties = [s for s in good if s.primal_bound - minimum <= EQUAL * max(abs(minimum), EQUAL)]
    order = ("optimal", "locally_optimal")
    ranks = {word: rank for rank, word in enumerate(order)}
    return min(ties, key=lambda s: (ranks.get(str(s.termination), 2), s.seconds.get("total", 0.0)))


def proof(answers: list[Any], incumbent: Any) -> str:
    """Return the proven result of an instance: the optimum, a gap to a bound, or infeasibility."""
    words = {str(s.termination) for s in answers}
    if incumbent is None:
        return "infeasible" if "infeasible" in words else ""
    if incumbent.termination == "optimal":
        return "optimal"
    bounds = [s.dual_bound for s in answers if s.dual_bound is not None]
    # A bound above a verified plan is invalid (rounding errors of a solver).
    bounds = [bound for bound in bounds if bound <= incumbent.primal_bound * (1 + EQUAL)]
    if not bounds or not incumbent.primal_bound:
        return ""
    return f"gap {1 - max(bounds) / incumbent.primal_bound:.2%}"


class Beside(Table):
    """Table of instances with known value, measured value and difference."""

    final_argument_whitespace = True
    option_spec = {"measured": directives.unchanged, "figure": directives.unchanged}
    #: Columns; empty ones are omitted.
    heads = (
        *("instance", "printed", "paper", "known", "ours", "difference", "proven", "backend"),
        *("seconds", "seconds, paper (another machine)", "known from"),
    )

    def make(self) -> str:
        from crosstrack.instances import entries

        prefixes = tuple(self.arguments[0].split())
        matches = [entry for entry in entries() if entry.name.startswith(prefixes)]
        ours, below = (
            self.measured_values() if "measured" in self.options else self.campaign(matches)
        )
        rows = [self.row(entry, *ours[entry.name]) for entry in matches if entry.name in ours]
        heads = [head for head in self.heads if any(row.get(head) for row in rows)]
        table = markdown_table(heads, [[row.get(head) or "" for head in heads] for row in rows])
        return f"{table}\n\n{below}"

    def row(self, entry: Any, value: float | None, more: dict[str, str]) -> dict[str, Any]:
        """Return the row of an instance."""
        known = entry.published
        own = "figure" in self.options
        figure = known.get(self.options.get("figure", "objective"), known.get("optimum"))
        row = {"instance": f"`{entry.name}`", "ours": cell(value, ".9g"), **more}
        if figure is not None:
            row |= {"paper" if own else "known": f"{figure:.9g}", "printed": known.get("printed")}
            if own:
                row["seconds, paper (another machine)"] = cell(known.get("computing_seconds"), "g")
            else:
                row["known from"] = known.get("source", known.get("formula"))
            if value is not None:
                row["difference"] = f"{(value - figure) / (abs(figure) or 1.0):+.1e}"
        return row

    def measured_values(self) -> tuple[dict[str, tuple[float | None, dict[str, str]]], str]:
        """Return the measured values by instance, and the conditions of the measurement."""
        name, _, column = self.options["measured"].partition(" ")
        table = self.measured(name)
        forms = table["columns"]
        rows = [dict(zip(forms, cells, strict=True)) for cells in table["rows"]]
        values = {
            row["instance"]: (row[column], {"seconds": cell(row["seconds"], forms["seconds"])})
            for row in rows
            if row[column] is not None
        }
        return values, self.source(table)

    def campaign(
        self, matches: list[Any]
    ) -> tuple[dict[str, tuple[float | None, dict[str, str]]], str]:
        """Return the best values of the campaign for the current instances, and their source."""
        known, values = records(self.path("campaign", "records.jsonl")), {}
        for entry in matches:
            digest = entry.build().digest
            answers = [answer for answer in known.get(entry.name, []) if answer.digest == digest]
            answer = best(answers)
            more = {"proven": proof(answers, answer)}
            if answer is not None:
                seconds = f"{answer.seconds['total']:.2g}"
                more |= {"backend": f"`{answer.backend}`", "seconds": seconds}
            values[entry.name] = (None if answer is None else answer.primal_bound, more)
        words = "Our values are the best verified ones of the [campaign](../choose.md), with its time limits and "
        return values, f"{words}one thread."


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives."""
    app.add_directive("crosstrack-measured", Measured)
    app.add_directive("crosstrack-beside", Beside)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
