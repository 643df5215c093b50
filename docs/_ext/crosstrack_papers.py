"""Lists of the contents of the papers with their status, from the declarations of the problems.

* ``crosstrack-as-printed PROBLEM``: every equation, algorithm, parameter table and figure of the paper with its
  status, each with a link to the code;
* ``crosstrack-papers``: one row per paper with the number of items by status, and the printed cells of its result
  tables that have a value of ours in ``docs/measured``, or a text with the reason;
* the role ``crosstrack-code``: a link to the source of ``module:object``.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from crosstrack_code import source_link
from crosstrack_site import Made, markdown_table
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxRole


class Code(SphinxRole):
    """A link to the source of a function or class."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        return [source_link(self.env, f"crosstrack.{self.text}")], []


def measured_cells(folder: Path, problem: str, table: Any) -> tuple[int, int]:
    """Return the number of printed cells with a measured value, and the number with a reason instead.

    Parameters
    ----------
    folder : Path
        Folder of the measured files.
    problem : str
        Name of the problem.
    table : ResultTable
        Result table of the paper.
    """
    path = folder / f"{problem}.json"
    data = json.loads(path.read_text("utf-8")) if path.exists() else {}
    stored = data.get(table.name)
    if stored is None:
        return 0, 0
    rows = {
        tuple(row[: len(table.keys)]): dict(zip(stored["columns"], row, strict=True))
        for row in stored["rows"]
    }
    values = reasons = 0
    for key, cells in table.rows.items():
        for name, cell in zip(table.columns, cells, strict=True):
            ours = rows.get(key, {}).get(name)
            if cell is not None and ours is not None:
                is_reason = isinstance(ours, str) and not isinstance(cell, str)
                values, reasons = values + (not is_reason), reasons + is_reason
    return values, reasons


class AsPrinted(Made):
    """The items of a problem's paper with their status."""

    required_arguments = 1
    wide = True

    def make(self) -> str:
        from crosstrack.instances.paper import paper_of

        paper = paper_of(self.arguments[0])
        counts = ", ".join(f"{count} {status}" for status, count in paper.counts.items())
        rows = [
            (item.label, item.about, item.status, f"{{crosstrack-code}}`{item.code}`", item.reason)
            for item in paper.items
        ]
        columns = ("paper", "content", "status", "code", "reason or interpretation")
        head = f"{paper.reference}. {len(paper.items)} items: {counts}."
        return f"{head}\n\n{markdown_table(columns, rows)}"


class Papers(Made):
    """One row per paper."""

    wide = True

    def make(self) -> str:
        from crosstrack.instances.paper import Status, papers

        folder = Path(self.env.app.srcdir) / "measured"
        groups: dict[str, list[tuple[str, Any]]] = {}
        for problem, paper in papers().items():
            groups.setdefault(paper.name, []).append((problem, paper))
        rows: list[list[Any]] = []
        for name, parts in groups.items():
            tables = [(problem, table) for problem, paper in parts for table in paper.tables]
            printed = sum(table.printed_cells for _, table in tables)
            cells = [measured_cells(folder, problem, table) for problem, table in tables]
            ours = [sum(counts) for counts in zip(*cells, strict=True)]
            pages = ", ".join(f"[{problem}](problems/{problem}.md)" for problem, _ in parts)
            counts = [sum(paper.counts[status] for _, paper in parts) for status in Status]
            rows.append([name, pages, sum(counts), *counts, printed, *ours])
            for problem, _ in parts:
                self.env.note_dependency(str(folder / f"{problem}.json"))
        total = [sum(row[k] for row in rows) for k in range(2, 9)]
        columns = (
            *("paper", "problems", "items", *Status),
            *("printed cells", "with our value", "with a reason instead"),
        )
        return markdown_table(columns, [*rows, ["**all**", "", *total]])


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives and the role."""
    app.add_directive("crosstrack-as-printed", AsPrinted)
    app.add_directive("crosstrack-papers", Papers)
    app.add_role("crosstrack-code", Code())
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
