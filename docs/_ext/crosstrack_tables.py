"""Tables of measured values: what a script wrote to ``docs/measured``, and what the campaign's records hold.

* ``crosstrack-measured PROBLEM/TABLE``: the table, and when and with what it was measured;
* ``crosstrack-beside PREFIX …``: what is known of the catalogue's instances, and our values beside it: the
  best verified ones of the campaign, or those that ``:measured: PROBLEM/TABLE COLUMN`` names. ``:figure:`` names
  another published figure than the objective.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from crosstrack_site import Made, markdown_table
from docutils.parsers.rst import directives
from sphinx.application import Sphinx

#: Relative difference up to which two answers of the campaign count as equally good.
EQUAL = 1e-6


def cell(value: Any, form: str) -> str:
    """Return a value in its column's format; words as they are, and nothing for None."""
    if value is None:
        return ""
    return format(value, form) if isinstance(value, int | float) else str(value)


class Table(Made):
    """A directive that reads a file beside the pages."""

    required_arguments = 1
    wide = True

    def path(self, *parts: str) -> Path:
        """Return a file's path; the page is read again when it changes."""
        path = Path(self.env.app.srcdir, *parts)
        self.env.note_dependency(str(path))
        return path

    def measured(self, name: str) -> dict[str, Any]:
        """Return the table ``PROBLEM/TABLE``."""
        problem, _, table = name.partition("/")
        found = json.loads(self.path("measured", f"{problem}.json").read_text("utf-8"))
        return dict(found[table])

    @staticmethod
    def source(table: dict[str, Any]) -> str:
        """Return when and with what a table was measured."""
        versions = ", ".join(f"{package} {number}" for package, number in table["versions"].items())
        made = f"Measured on {table['date']} by `{table['script']}`: {versions}"
        where = f"{table['processors']} processors of a shared machine."
        return f"{table['said']} {made}, {where}".strip()


class Measured(Table):
    """A table that a benchmark's script wrote, and below it what it depends on."""

    def make(self) -> str:
        table = self.measured(self.arguments[0])
        forms = table["columns"].values()
        rows = [map(cell, row, forms) for row in table["rows"]]
        return "\n\n".join([markdown_table(table["columns"], rows), self.source(table)])


@cache
def records(path: Path) -> dict[str, list[Any]]:
    """Return the answers of a campaign by instance, those of backends that see what is hidden left out."""
    from crosstrack.solvers import find_backend
    from crosstrack.solvers.bench import read_records

    found: dict[str, list[Any]] = {}
    for one in read_records(path).solutions:
        if not find_backend(one.backend, problem=one.problem or None).sees_hidden:
            found.setdefault(one.instance, []).append(one)
    return found


def best(answers: list[Any]) -> Any:
    """Return the best verified answer: of those that are equally good a proven one, then the quickest."""
    good = [
        s for s in answers if s.primal_bound is not None and s.verification and s.verification.ok
    ]
    if not good:
        return None
    least = min(s.primal_bound for s in good)
    near = [s for s in good if s.primal_bound - least <= EQUAL * max(abs(least), EQUAL)]
    order = ("optimal", "locally_optimal")
    ranks = {word: rank for rank, word in enumerate(order)}
    return min(near, key=lambda s: (ranks.get(str(s.termination), 2), s.seconds.get("total", 0.0)))


def proof(answers: list[Any], found: Any) -> str:
    """Return what the campaign has proven of an instance: the optimum, a gap to a bound, that there is no plan."""
    words = {str(s.termination) for s in answers}
    if found is None:
        return "no plan exists" if "infeasible" in words else ""
    if found.termination == "optimal":
        return "optimal"
    bounds = [s.dual_bound for s in answers if s.dual_bound is not None]
    # One above a verified plan, by the digits of a solver, proves nothing.
    bounds = [one for one in bounds if one <= found.primal_bound * (1 + EQUAL)]
    if not bounds or not found.primal_bound:
        return ""
    return f"gap {1 - max(bounds) / found.primal_bound:.2%}"


class Beside(Table):
    """Instances with what is known of them, our value, and by how much it differs."""

    final_argument_whitespace = True
    option_spec = {"measured": directives.unchanged, "figure": directives.unchanged}
    #: The columns; those that would be empty are left out.
    heads = (
        *("instance", "printed", "paper", "known", "ours", "difference", "proven", "backend"),
        *("seconds", "seconds, paper (another machine)", "known from"),
    )

    def make(self) -> str:
        from crosstrack.instances import entries

        prefixes = tuple(self.arguments[0].split())
        found = [entry for entry in entries() if entry.name.startswith(prefixes)]
        ours, below = self.measured_values() if "measured" in self.options else self.campaign(found)
        rows = [self.row(entry, *ours[entry.name]) for entry in found if entry.name in ours]
        heads = [head for head in self.heads if any(row.get(head) for row in rows)]
        table = markdown_table(heads, [[row.get(head) or "" for head in heads] for row in rows])
        return f"{table}\n\n{below}"

    def row(self, entry: Any, value: float | None, more: dict[str, str]) -> dict[str, Any]:
        """Return the cells of an instance."""
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
        """Return the values of a script by instance, and what they depend on."""
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
        self, found: list[Any]
    ) -> tuple[dict[str, tuple[float | None, dict[str, str]]], str]:
        """Return the campaign's best values of instances as they are today, and where they are from."""
        known, values = records(self.path("campaign", "records.jsonl")), {}
        for entry in found:
            digest = entry.build().digest
            answers = [one for one in known.get(entry.name, []) if one.digest == digest]
            one = best(answers)
            more = {"proven": proof(answers, one)}
            if one is not None:
                more |= {"backend": f"`{one.backend}`", "seconds": f"{one.seconds['total']:.2g}"}
            values[entry.name] = (None if one is None else one.primal_bound, more)
        words = "Ours are the best verified values of the [campaign](../choose.md), at its time limits and on "
        return values, f"{words}one thread."


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives."""
    app.add_directive("crosstrack-measured", Measured)
    app.add_directive("crosstrack-beside", Beside)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
