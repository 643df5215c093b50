"""Rows of untrusted Excel files, within limits. Formulas are not computed."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from ..errors import BackendMissing, InvalidData
from ..models.fields import show
from .text_tables import is_comment, without_comments

__all__ = ["xlsx_rows"]

#: Limits of a file in bytes, packed and unpacked, and of the rows and columns of its sheet.
PACKED, UNPACKED, ROWS, COLUMNS = 32 << 20, 256 << 20, 200_000, 64
#: Number of rows of each sheet that are checked for content.
GLANCE = 100


def xlsx_rows(
    path: str | os.PathLike[str], sheet: str | int | None = None
) -> Iterator[tuple[int, list[str]]]:
    """Yield number and cells, as text, of every row of a sheet that is not blank.

    A formula is read as its stored value, and links to other files are not followed.

    Parameters
    ----------
    path : path-like
        File to read.
    sheet : str or int, optional
        Name of the sheet, or its number from 1. By default the only sheet with content.

    Raises
    ------
    BackendMissing
        openpyxl is not installed.
    InvalidData
        The file is not an Excel file, exceeds a limit, or does not have the sheet, or several sheets
        have content and `sheet` is missing.
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
            # One row and one column beyond the limit, so that an excess is detected and not cut off.
            rows = _sheet(book.worksheets, sheet, file).iter_rows(
                max_row=ROWS + 1, max_col=COLUMNS + 1, values_only=True
            )
            yield from without_comments(
                # A shorter row could lack empty cells at its end: only one cell can be a comment.
                (line, cells, len(cells) == 1 and is_comment(cells[0]), True)
                for line, cells in _rows(rows, file)
            )
    except InvalidData:
        raise
    except Exception as error:  # openpyxl may raise anything for a damaged file
        raise InvalidData(
            f"{file}: cannot be read as an Excel file (.xlsx): {type(error).__name__}: {error}"
        ) from None


def _rows(rows: Iterable[Sequence[Any]], file: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield number and cells, as text, of every row that is not blank."""
    for line, cells in enumerate(rows, 1):
        blank = cells.count(None) == len(cells)
        row = [] if blank else [_text(cell) for cell in cells]
        while row and not row[-1]:
            row.pop()
        if line > ROWS or len(row) > COLUMNS:
            raise InvalidData(
                f"{file}, row {line}: at most {ROWS} rows and {COLUMNS} columns are read: remove the "
                "others, or save the sheet as CSV"
            )
        if row:
            yield line, row


def _sheet(sheets: Sequence[Any], wanted: str | int | None, file: Path) -> Any:
    """Return the wanted sheet, or the only one with content."""
    titles = {sheet.title: sheet for sheet in sheets}
    if wanted is None:
        full = [sheet for sheet in sheets if _holds_something(sheet)]
        if len(full) > 1:
            raise InvalidData(
                f"{file}: sheet must name one of the sheets with content: "
                f"{', '.join(repr(sheet.title) for sheet in full)} (sheet=, on the command line --sheet)",
                field="sheet",
            )
        return full[0] if full else sheets[0]
    if isinstance(wanted, str) and wanted in titles:
        return titles[wanted]
    text = str(wanted)
    if text.isascii() and text.isdigit() and len(text) < 5 and 1 <= int(text) <= len(sheets):
        return sheets[int(text) - 1]
    raise InvalidData(
        f"{file}: sheet must be a name or number of {', '.join(map(repr, titles))}, got {show(wanted)}",
        field="sheet",
    )


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
    except (zipfile.BadZipFile, OSError, ValueError, RuntimeError) as error:  # of any zip archive
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
