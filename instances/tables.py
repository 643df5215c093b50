"""Tables in CSV and Excel files: columns with units from untrusted files, and rows to files."""

from __future__ import annotations

import csv
import io
import logging
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, Unpack

from ..errors import InvalidData, suggestion
from ..files import write_text
from ..models.fields import show
from .rows import MISSING, UNMAPPED, Rows, TableOptions, number, numbers, table_rows
from .text_tables import NUMBER, is_comment
from .units import TIMES, factor_of, label_parts

__all__ = [
    "NUMBER", "TIMES", "Column", "Sheet", "Table", "TableOptions", "number", "numbers",
    "read_table", "table_rows", "table_text", "write_rows",
]  # fmt: skip

#: Columns that no constraint can depend on, so that readers may skip them.
_HARMLESS = {
    *("address", "city", "comment", "comments", "country", "description", "info", "label", "name"),
    *("note", "notes", "remark", "remarks", "street", "title"),
}

#: Names of the last row of a spreadsheet that adds or averages the others.
_TOTALS = {"average", "gesamt", "mean", "mittelwert", "somme", "sum", "summe", "total"}

log = logging.getLogger("crosstrack")


class Column(NamedTuple):
    """Column of a table.

    Parameters
    ----------
    name : str
        Name in lower case, with ``_`` for a blank.
    field : str
        Field named in errors; by default the name.
    text : bool
        Whether cells are words instead of numbers.
    empty : bool
        Whether cells may be empty. An empty number is None.
    optional : bool
        Whether the column may be missing.
    units : mapping of str to float
        Factor from each unit to the first one. The label must state one of them in brackets; empty
        for columns without unit.
    bare : bool
        Whether the unit may be missing. Numbers are then in the first unit.
    free : bool
        Whether the label may state any unit. Numbers are not converted.
    aliases : tuple of str
        Other names of the column, used if none has `name`.
    series : bool
        Whether missing cells may be interpolated. They are NaN in the table, for
        :func:`~crosstrack.instances.series.interpolate`.
    lower, upper : float
        Limits of the numbers in the first unit.
    """

    name: str
    field: str = ""
    text: bool = False
    empty: bool = False
    optional: bool = False
    units: Mapping[str, float] = MappingProxyType({})
    bare: bool = False
    free: bool = False
    aliases: tuple[str, ...] = ()
    series: bool = False
    lower: float = -math.inf
    upper: float = math.inf


class Table(NamedTuple):
    """Values of the columns of a file.

    Parameters
    ----------
    values : dict of str to list
        Values by the names of the columns, in their first unit.
    places : list of str
        File and line of each row, for messages.
    """

    values: dict[str, list[Any]]
    places: list[str]


class Sheet:
    """Rows of a CSV or Excel file with a header.

    Parameters
    ----------
    path : path-like
        File to read.
    row : str
        Noun for a row, for messages, such as ``"node"``.
    field : str
        Field named in errors about missing, short or long rows.
    series : bool
        Whether rows are samples over time.
    **options
        See :class:`~crosstrack.instances.TableOptions`.

    Attributes
    ----------
    where : str
        File and line of the header, for messages.
    labels, names, plain : list of str
        Cells of the header as written, in lower case, and in lower case without units and blanks.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        row: str,
        field: str,
        *,
        series: bool = False,
        **options: Unpack[TableOptions],
    ) -> None:
        self._reader = Rows(path, row, series=series, **options)
        self.file, self.row, self.field = self._reader.file, row, field
        self._rows = iter(self._reader)
        line, header = next(self._rows, (1, []))
        self.where = f"{self.file}, line {line}"
        self.labels = [label.lstrip("# ") for label in header]
        self.names = [label.casefold() for label in self.labels]
        self.plain = [label_parts(label)[0].casefold().replace(" ", "_") for label in self.labels]

    def parts(self, at: int) -> tuple[str, str]:
        """Return name and unit of column `at` as written; both may be empty."""
        return label_parts(self.labels[at])

    def _title(self, at: int) -> str:
        """Return the name of column `at` in lower case, or its number if it has no name."""
        return self.names[at] or f"number {at + 1} (without a name)"

    def factor(
        self, at: int, units: Mapping[str, float], field: str, *, bare: bool = False
    ) -> float:
        """Return the factor of the unit of column `at`, or raise if it states none of `units`.

        With `bare`, the unit may be missing.
        """
        where = f"{self.where}, column {show(self.names[at])}"
        return factor_of(self.parts(at)[1], units, where, field, bare=bare)

    def select(
        self,
        columns: Sequence[Column],
        header: str,
        *,
        strict: bool = True,
        suits: Callable[[set[str]], bool] | None = None,
    ) -> dict[int, Column]:
        """Return the known columns by their positions, or raise for another header.

        Messages contain the description `header`. Unknown columns are refused, or if not `strict`
        named in the log. `suits` is a condition on the names of the columns that are present.
        """
        plain = {column.name: column for column in columns if not column.units}
        with_unit = {x.name: x for x in columns if x.units or x.free}
        for target in self._reader.columns.keys() - plain.keys() - with_unit.keys():
            hint = suggestion(target, [x.name for x in columns]).rstrip()
            raise InvalidData(
                f"columns must name columns of {self.row}s, {', '.join(x.name for x in columns)}, got "
                f"{show(target)}{hint and f': {hint}'}",
                field="columns",
            )
        result: dict[int, Column] = {}
        unknown: list[int] = []
        aliases = {
            alias: column
            for column in columns
            for alias in column.aliases
            if column.name not in (*self.names, *self.plain)
        }
        for at, (label, name) in enumerate(zip(self.names, self.plain, strict=True)):
            column = plain.get(label) or with_unit.get(name) or aliases.get(name)
            if column is None:
                unknown.append(at)
            else:
                result[at] = column
        present = [column.name for column in result.values()]
        fault = next((f"column {x!r} stands twice" for x in present if present.count(x) > 1), "")
        lost = [x.name for x in columns if not x.optional and x.name not in present]
        if lost and not fault:
            fault = f"missing: {', '.join(lost)}"
        refused = [
            self._title(at)
            for at in unknown
            if strict
            and self.plain[at] not in _HARMLESS
            and not self.names[at].startswith(UNMAPPED)
        ]
        if refused and not fault:
            fault = f"remove or rename the other columns, {show(', '.join(refused))}"
        if fault or refused or (suits is not None and not suits(set(present))):
            raise InvalidData(
                f"{self.where}: must be a header of {self.row}s: {header}; "
                f"{f'{fault}; ' if fault else ''}got {show(','.join(self.names))}",
                field="header",
            )
        if unknown:
            names = ", ".join(map(self._title, unknown))
            log.warning("%s: columns that are not read: %s", self.where, names)
        return result

    def read(self, selection: Mapping[int, Column]) -> Table:
        """Return the values of the columns at the positions in `selection`.

        Raises
        ------
        InvalidData
            A cell is invalid, a row is too short or too long, or the file has no rows.
        """
        table = Table({column.name: [] for column in selection.values()}, [])
        readers = [
            (
                at,
                column,
                self.factor(at, column.units, column.name, bare=column.bare)
                if column.units
                else 1.0,
            )
            for at, column in selection.items()
        ]
        # Ids may begin with a mark of comments, numbers cannot.
        numeric = 0 in selection and not selection[0].text
        skipped = 0
        count, short = len(self.names), self.file.suffix.casefold() == ".xlsx"
        for line, cells in self._rows:
            where = f"{self.file}, line {line}"
            if is_comment(cells[0]):
                if numeric:
                    skipped += 1
                    continue
                if cells[0].lstrip("#%/")[:1].isspace():
                    log.warning("%s: %s is read as an id, not as a comment", where, show(cells[0]))
            if short:  # openpyxl omits empty cells at the end of a row
                cells += [""] * (count - len(cells))
            if len(cells) != count:
                raise InvalidData(
                    f"{where}: {len(cells)} values where the header has {count}: "
                    f"{show(','.join(cells))}",
                    field=self.field,
                )
            for at, column, factor in readers:
                table.values[column.name].append(self._value(cells[at], where, at, column, factor))
            table.places.append(where)
        if skipped:
            log.warning("%s: %d rows are comments and not read", self.file, skipped)
        names = [table.values[column.name] for column in selection.values() if column.text]
        last = next((str(column[-1]) for column in names if column), "")
        if len(table.places) > 1 and last.casefold() in _TOTALS:
            raise InvalidData(
                f"{table.places[-1]}: {show(last)} must be a {self.row}, but looks like a row of totals: remove or rename it",
                field=self.field,
            )
        if not table.places:
            raise InvalidData(f"{self.file}: no {self.row}s below the header", field=self.field)
        return table

    def _value(
        self, cell: str, where: str, at: int, column: Column, factor: float
    ) -> float | str | None:
        """Return the value of a cell, or raise."""
        field, place = column.field or column.name, f"{where}, column {self.names[at]}"
        missing = cell.casefold() in MISSING
        if column.empty and (not cell or (missing and not column.text)):
            return cell if column.text else None
        if column.series and missing:
            if self._reader.fills:
                return math.nan
            raise InvalidData(
                f"{place}: must be a finite number, got {show(cell)}: the value is missing; "
                "missing='interpolate' (on the command line --missing interpolate) fills short gaps",
                field=field,
            )
        if column.text:
            if not cell:
                raise InvalidData(f"{place}: must name the {self.row}, got nothing", field=field)
            return cell
        value = self._reader.number(cell, place, field) * factor
        if not column.lower <= value <= column.upper:
            raise InvalidData(
                f"{place}: must be {column.lower:.6g} … {column.upper:.6g} "
                f"{next(iter(column.units), '')}, got {show(cell)}",
                field=field,
            )
        return value


def read_table(
    path: str | os.PathLike[str],
    columns: Sequence[Column],
    header: str,
    /,
    *,
    row: str,
    field: str,
    **options: Any,
) -> Table:
    """Return the columns of a CSV or Excel file; see :class:`Sheet` and :meth:`Sheet.select`."""
    selection = {name: options.pop(name) for name in ("strict", "suits") if name in options}
    sheet = Sheet(path, row, field, **options)
    return sheet.read(sheet.select(columns, header, **selection))


def write_rows(
    path: str | os.PathLike[str], header: Sequence[str], rows: Iterable[Sequence[Any]]
) -> Path:
    """Write a table as CSV atomically, with all digits of numbers; return the path."""
    return write_text(path, table_text(header, rows))


def table_text(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return a table as CSV text, with all digits of numbers."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([header, *rows])
    return text.getvalue()
