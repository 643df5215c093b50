"""A paper's result tables beside our values."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from ..contract.events import Listener, listener_of
from ..contract.verdict import Verdict
from ..run.crosscheck import Comparison
from .tables import table
from .trials import RecordedTrials

__all__ = ["Reproduction", "Row", "Table", "reproduce", "reproduction_parts"]


class Table(Protocol):
    """A result table of a paper; :class:`crosstrack.instances.paper.ResultTable` implements it."""

    @property
    def name(self) -> str: ...
    @property
    def title(self) -> str: ...
    @property
    def keys(self) -> tuple[str, ...]: ...
    @property
    def columns(self) -> Mapping[str, str]: ...
    @property
    def ours(self) -> Mapping[str, str]: ...
    @property
    def rows(self) -> Mapping[tuple[str, ...], Sequence[Any]]: ...
    @property
    def note(self) -> str: ...
    def check_values(self, key: tuple[str, ...], values: Mapping[str, Any]) -> dict[str, Any]: ...


@dataclass(frozen=True)
class Row:
    """One row of a result table: the paper's cells and our values.

    Parameters
    ----------
    table : Table
        The table.
    number : int
        Position in the table, from 1.
    key : tuple of str
        The cells that identify the row.
    values : mapping
        Our values by column.
    verdicts : tuple of Verdict
        Verdicts on the answers behind the values, one per model.
    """

    table: Table
    number: int
    key: tuple[str, ...]
    values: Mapping[str, Any]
    verdicts: tuple[Verdict, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the row as JSON data."""
        cells = zip(self.table.columns, self.table.rows[self.key], strict=True)
        return {
            "table": self.table.name,
            "row": self.number,
            "key": dict(zip(self.table.keys, self.key, strict=True)),
            "published": dict(cells),
            "ours": dict(self.values),
            "instances": [verdict.to_dict() for verdict in self.verdicts],
        }


@dataclass(frozen=True)
class Reproduction:
    """A paper's result tables with our values.

    Parameters
    ----------
    problem : str
        The problem.
    rows : tuple of Row
        The rows in the paper's order.
    interrupted : bool
        Whether Ctrl-C ended the measurements.
    """

    problem: str
    rows: tuple[Row, ...]
    interrupted: bool = False

    @property
    def comparison(self) -> Comparison:
        """All verdicts as one comparison."""
        verdicts = tuple(verdict for row in self.rows for verdict in row.verdicts)
        return Comparison(verdicts, self.interrupted)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON data."""
        tables = {row.table.name: row.table for row in self.rows}
        return {
            "problem": self.problem,
            "verdict": str(self.comparison.outcome),
            "interrupted": self.interrupted,
            "note": " ".join(filter(None, (table.note for table in tables.values()))),
            "rows": [row.to_dict() for row in self.rows],
        }


def reproduce(
    problem: str,
    tables: Sequence[tuple[Table, Callable[..., Mapping[str, Any]]]],
    *,
    rows: set[int] | None = None,
    runs: int = 1,
    time_limit: float | None = 60.0,
    seed: int = 0,
    on_event: Listener | None = None,
    on_row: Callable[[Row], None] | None = None,
    on_solution: Callable[[Any], None] | None = None,
) -> Reproduction:
    """Measure our value of every cell of a paper's result tables.

    Parameters
    ----------
    problem : str
        The problem, such as ``"error-correction"``.
    tables : sequence of (Table, callable)
        Result tables, each with the function that measures one row.
    rows : set of int, optional
        Positions of the rows to measure in each table, from 1. Default: all.
    runs : int
        Number of runs per cell, from different seeds.
    time_limit : float, optional
        Seconds per run.
    seed : int
        The first seed.
    on_event : callable, optional
        Function called with the event of every answer.
    on_row : callable, optional
        Function called with every finished row.
    on_solution : callable, optional
        Deprecated: use `on_event`.

    Returns
    -------
    Reproduction
        The measured rows.
    """
    listener = listener_of(on_event, "solution", on_solution=on_solution)
    trials = RecordedTrials(runs, time_limit, seed, listener)
    finished_rows: list[Row] = []
    try:
        for result_table, measure in tables:
            for number, key in enumerate(result_table.rows, 1):
                if rows is None or number in rows:
                    values = result_table.check_values(key, measure(key, trials))
                    finished_rows.append(Row(result_table, number, key, values, trials.verdicts()))
                    if on_row is not None:
                        on_row(finished_rows[-1])
    except KeyboardInterrupt:
        return Reproduction(problem, tuple(finished_rows), interrupted=True)
    return Reproduction(problem, tuple(finished_rows))


def _text(value: Any, form: str) -> str:
    """Return a cell as text; an empty cell stays empty."""
    if value is None:
        return ""
    return format(value, form) if isinstance(value, int | float) else str(value)


def reproduction_parts(result: Reproduction) -> list[Any]:
    """Return the printable parts: each table with the paper's cells and ours side by side.

    Parameters
    ----------
    result : Reproduction
        The measured rows.
    """
    parts: list[Any] = []
    for result_table in {row.table.name: row.table for row in result.rows}.values():
        heads = list(result_table.keys)
        for name in result_table.columns:
            heads += [f"{name}\npaper", f"{name}\nours"]
        heads += [f"{name}\nours" for name in result_table.ours]
        lines = []
        for row in (row for row in result.rows if row.table is result_table):
            line = list(row.key)
            for (name, form), cell in zip(
                result_table.columns.items(), result_table.rows[row.key], strict=True
            ):
                line += [_text(cell, form), _text(row.values.get(name), form)]
            line += [_text(row.values.get(name), form) for name, form in result_table.ours.items()]
            lines.append(line)
        parts.append(table(result_table.title, heads, lines, right=heads[len(result_table.keys) :]))
        parts += [result_table.note] if result_table.note else []
    verdicts = result.comparison.verdicts
    if verdicts:
        models = "1 model" if len(verdicts) == 1 else f"{len(verdicts)} models"
        parts.append(f"verdict on {models}: {result.comparison.outcome}")
    if result.interrupted:
        parts.append("interrupted: the remaining rows were not measured")
    return parts
