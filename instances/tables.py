"""CSV and Excel files: rows and columns with units from untrusted files, and rows to files.

Files are read within limits, and formulas are not computed.
"""

from __future__ import annotations

import csv
import io
import logging
import math
import os
import re
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from ..errors import BackendMissing, InvalidData
from ..files import as_path, read_text, write_text
from ..models.fields import show

__all__ = [
    "NUMBER", "TIMES", "Column", "Sheet", "Table", "csv_rows", "number", "numbers", "read_table",
    "table_rows", "table_text", "write_rows", "xlsx_rows",
]  # fmt: skip

#: Limits of a file in bytes, packed and unpacked, and of the rows and columns of its sheet.
PACKED, UNPACKED, ROWS, COLUMNS = 32 << 20, 256 << 20, 200_000, 64
#: Number of rows of the other sheets that are checked for content.
GLANCE = 100

#: Accepted forms of numbers in files.
NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
#: Units of time in seconds. Lower case turns the micro sign into the Greek letter.
TIMES: Mapping[str, float] = MappingProxyType(
    {"s": 1.0, "ms": 1e-3, "us": 1e-6, "μs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0}
)  # fmt: skip
#: Label of a column: a name, and optionally a unit in brackets.
_LABEL = re.compile(r"([^\[\]()]*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))?")

log = logging.getLogger("crosstrack")


def number(text: str, where: str, field: str) -> float:
    """Return the finite number in `text`; error messages contain `where` and name `field`."""
    # float() alone would accept nan, inf, 1_000 and non-ASCII digits.
    stripped = text.strip()
    value = float(stripped) if NUMBER.fullmatch(stripped) else math.nan
    if not math.isfinite(value):
        raise InvalidData(f"{where}: must be a finite number, got {show(text)}", field=field)
    return value


def numbers(cells: Sequence[str], names: Sequence[str], where: str, field: str = "") -> list[float]:
    """Return the numbers of a row. Their count must match `names`, the default of `field`."""
    if len(cells) != len(names):
        raise InvalidData(
            f"{where}: {len(cells)} values where {len(names)} are allowed: {names[0]} to {names[-1]}",
            field=field or names[0],
        )
    pairs = zip(cells, names, strict=True)
    return [number(cell, f"{where}, column {name}", field or name) for cell, name in pairs]


# -- columns ---------------------------------------------------------------------------------------


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
    lower, upper : float
        Limits of the numbers in the first unit.
    """

    name: str
    field: str = ""
    text: bool = False
    empty: bool = False
    optional: bool = False
    units: Mapping[str, float] = MappingProxyType({})
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

    Attributes
    ----------
    where : str
        File and line of the header, for messages.
    labels, names : list of str
        Cells of the header as written, and in lower case.
    """

    def __init__(self, path: str | os.PathLike[str], row: str, field: str) -> None:
        self.file, self.row, self.field = as_path(path), row, field
        self._rows = table_rows(self.file)
        line, header = next(self._rows, (1, []))
        self.where = f"{self.file}, line {line}"
        self.labels = [label.lstrip("# ") for label in header]
        self.names = [label.casefold() for label in self.labels]

    def parts(self, at: int) -> tuple[str, str]:
        """Return name and unit of column `at` as written; both may be empty."""
        match = _LABEL.fullmatch(self.labels[at])
        return (match[1], (match[2] or match[3] or "").strip()) if match else (self.labels[at], "")

    def factor(self, at: int, units: Mapping[str, float], field: str) -> float:
        """Return the factor of the unit of column `at`, or raise if it states none of `units`."""
        unit = self.parts(at)[1].casefold()
        if unit not in units:
            got = f"got {show(unit)}" if unit else "got none"
            raise InvalidData(
                f"{self.where}, column {show(self.names[at])}: must state its unit in brackets, one of "
                f"{', '.join(units)}; {got}",
                field=field,
            )
        return units[unit]

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
        with_unit = {column.name: column for column in columns if column.units}
        result: dict[int, Column] = {}
        unknown: list[str] = []
        for at, label in enumerate(self.names):
            name = self.parts(at)[0].casefold().replace(" ", "_")
            column = plain.get(label) or with_unit.get(name)
            if column is None:
                unknown.append(label)
            else:
                result[at] = column
        present = [column.name for column in result.values()]
        fault = next((f"column {x!r} stands twice" for x in present if present.count(x) > 1), "")
        lost = [x.name for x in columns if not x.optional and x.name not in present]
        if lost and not fault:
            fault = f"missing: {', '.join(lost)}"
        if fault or (strict and unknown) or (suits is not None and not suits(set(present))):
            raise InvalidData(
                f"{self.where}: must be a header of {self.row}s: {header}; "
                f"{f'{fault}; ' if fault else ''}got {show(','.join(self.names))}",
                field="header",
            )
        if unknown:
            log.warning("%s: columns that are not read: %s", self.where, ", ".join(unknown))
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
            (at, column, self.factor(at, column.units, column.name) if column.units else 1.0)
            for at, column in selection.items()
        ]
        count, short = len(self.names), self.file.suffix.casefold() == ".xlsx"
        for line, cells in self._rows:
            where = f"{self.file}, line {line}"
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
        if not table.places:
            raise InvalidData(f"{self.file}: no {self.row}s below the header", field=self.field)
        return table

    def _value(
        self, cell: str, where: str, at: int, column: Column, factor: float
    ) -> float | str | None:
        """Return the value of a cell, or raise."""
        field, place = column.field or column.name, f"{where}, column {self.names[at]}"
        if not cell and column.empty:
            return cell if column.text else None
        if column.text:
            if not cell:
                raise InvalidData(f"{place}: must name the {self.row}, got nothing", field=field)
            return cell
        value = number(cell, place, field) * factor
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
    *,
    row: str,
    field: str,
    **options: Any,
) -> Table:
    """Return the columns of a CSV or Excel file; see :class:`Sheet` and :meth:`Sheet.select`."""
    sheet = Sheet(path, row, field)
    return sheet.read(sheet.select(columns, header, **options))


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


# -- rows ------------------------------------------------------------------------------------------


def table_rows(path: str | os.PathLike[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield line and cells of every row of a CSV or Excel file that has a value.

    Blank rows and rows of separators are skipped.

    Raises
    ------
    BackendMissing
        The file is an Excel file, and openpyxl is not installed.
    InvalidData
        The file is not a valid CSV or Excel file, or exceeds a limit.
    """
    file = Path(path)
    if file.suffix.casefold() == ".xlsx":
        yield from xlsx_rows(file)
        return
    yield from csv_rows(read_text(file), str(file))


def csv_rows(text: str, file: str) -> Iterator[tuple[int, list[str]]]:
    """Yield first line and cells of every row of CSV text that has a value."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    line = 1
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            if any(cells):
                yield line, cells
            line = reader.line_num + 1
    except csv.Error as error:
        raise InvalidData(f"{file}, line {line}: no valid CSV: {error}") from None


def xlsx_rows(path: str | os.PathLike[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield number and cells, as text, of every row of the first sheet that is not blank.

    A formula is read as its stored value, and links to other files are not followed. If other sheets
    have content, a warning in the log ``crosstrack`` names them.

    Raises
    ------
    BackendMissing
        openpyxl is not installed.
    InvalidData
        The file is not an Excel file, or exceeds a limit.
    """
    try:
        import openpyxl
    except ModuleNotFoundError as error:
        raise BackendMissing(
            f"{path}: Excel files need openpyxl, which is not installed ({error}): "
            "pip install 'crosstrack[xlsx]', or save the sheet as CSV"
        ) from None
    file = Path(path)
    _require_bounded(file)
    try:
        with file.open("rb") as stream:
            book = openpyxl.load_workbook(stream, read_only=True, data_only=True, keep_links=False)
            unread = [sheet.title for sheet in book.worksheets[1:] if _holds_something(sheet)]
            if unread:
                log.warning(
                    "%s: only the sheet %r is read, not %s",
                    file, book.worksheets[0].title, ", ".join(map(repr, unread)),
                )  # fmt: skip
            # One row and one column beyond the limit, so that an excess is detected and not cut off.
            rows = book.worksheets[0].iter_rows(
                max_row=ROWS + 1, max_col=COLUMNS + 1, values_only=True
            )
            for line, cells in enumerate(rows, 1):
                blank = cells.count(None) == len(cells)
                row = [] if blank else [_text(cell) for cell in cells]
                while row and not row[-1]:
                    row.pop()
                if line > ROWS or len(row) > COLUMNS:
                    raise InvalidData(
                        f"{file}, row {line}: at most {ROWS} rows and {COLUMNS} columns are read"
                    )
                if row:
                    yield line, row
    except InvalidData:
        raise
    except Exception as error:  # openpyxl may raise anything for a damaged file
        raise InvalidData(
            f"{file}: cannot be read as an Excel file (.xlsx): {type(error).__name__}: {error}"
        ) from None


def _holds_something(sheet: Any) -> bool:
    """Return whether the first rows of a sheet have a non-empty cell."""
    rows = sheet.iter_rows(max_row=GLANCE, max_col=COLUMNS, values_only=True)
    return any(cell is not None for row in rows for cell in row)


def _require_bounded(file: Path) -> None:
    """Raise if `file` is not a zip archive of files, or exceeds a limit."""
    try:
        if not file.is_file():
            raise InvalidData(
                f"{file}: {'is no regular file' if file.exists() else 'no such file'}"
            )
        size = file.stat().st_size
        with zipfile.ZipFile(file) as archive:
            # Reading stops at the stated size of an entry, so the statement can be trusted.
            unpacked = sum(entry.file_size for entry in archive.infolist())
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        raise InvalidData(f"{file}: is no Excel file (.xlsx): {error}") from None
    if size > PACKED or unpacked > UNPACKED:
        raise InvalidData(
            f"{file}: holds {size} bytes, unpacked {unpacked}, where at most {PACKED} and {UNPACKED} "
            "are read"
        )


def _text(cell: Any) -> str:
    """Return a cell as text as in CSV; 3.0 becomes 3, as Excel shows it."""
    if isinstance(cell, float) and cell.is_integer() and abs(cell) < 2**53:
        return str(int(cell))
    return "" if cell is None else str(cell).strip()
