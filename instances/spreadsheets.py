"""Bounded reading of CSV and Excel files from untrusted sources, without computing formulas."""

from __future__ import annotations

import csv
import io
import logging
import os
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from ..errors import BackendMissing, InvalidData
from ..files import as_path, read_text
from ..models.fields import show

__all__ = ["read_columns", "table_rows", "xlsx_rows"]

#: Limits of a file in bytes, packed and unpacked, and of the rows and columns of its sheet.
PACKED, UNPACKED, ROWS, COLUMNS = 32 << 20, 256 << 20, 200_000, 64
#: Number of rows of the other sheets that are checked for content.
GLANCE = 100

log = logging.getLogger("crosstrack")


def read_columns(
    path: str | os.PathLike[str],
    check: Callable[[list[str], str], None],
    convert: Callable[[str, str, str], Any],
    *,
    what: str,
    field: str,
) -> dict[str, list[Any]]:
    """Return the columns of a CSV or Excel file with a header, by their names in lower case.

    Parameters
    ----------
    path : path-like
        File to read.
    check : callable
        Function ``(names, where)`` that raises for an unsuitable header.
    convert : callable
        Function ``(text, where, name) -> value`` of a cell, which raises for an invalid cell.
    what : str
        Plural noun for the rows, for messages.
    field : str
        Field named in errors about missing, short or long rows.

    Returns
    -------
    dict of str to list
        Converted values per column.

    Raises
    ------
    InvalidData
        A row is too short or too long, or the file has no rows; also the errors of `check` and
        `convert`.
    """
    file = as_path(path)
    rows = table_rows(file)
    line, header = next(rows, (1, []))
    names = [name.strip().lstrip("# ").casefold() for name in header]
    check(names, f"{file}, line {line}")
    table: dict[str, list[Any]] = {name: [] for name in names}
    for line, values in rows:
        where = f"{file}, line {line}"
        if file.suffix.casefold() == ".xlsx":
            # openpyxl omits empty cells at the end of a row.
            values = values + [""] * (len(names) - len(values))
        if len(values) != len(names):
            raise InvalidData(
                f"{where}: {len(values)} values where the header has {len(names)}: "
                f"{show(','.join(values))}",
                field=field,
            )
        for name, value in zip(names, values, strict=True):
            table[name].append(convert(value, where, name))
    if not all(table.values()):
        raise InvalidData(f"{file}: no {what} below the header", field=field)
    return table


def table_rows(path: str | os.PathLike[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield number and cells of every row of a CSV or Excel file that is not blank.

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
    reader = csv.reader(io.StringIO(read_text(file), newline=""), strict=True)
    try:
        for row in reader:
            if any(value.strip() for value in row):
                yield reader.line_num, [value.strip() for value in row]
    except csv.Error as error:
        raise InvalidData(f"{file}, line {reader.line_num}: no valid CSV: {error}") from None


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
