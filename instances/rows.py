"""Rows of untrusted CSV and Excel files: options of readers, mapped columns, rows of units, numbers."""

from __future__ import annotations

import itertools
import logging
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TypedDict, Unpack

from ..errors import InvalidData, suggestion
from ..files import as_path
from ..models.fields import show
from .excel import xlsx_rows
from .text_tables import COMMA, NUMBER, csv_rows, is_numeric, read_table_text, separator_of
from .units import is_unit_row, label_parts, with_units

__all__ = [
    "INTERPOLATE", "MISSING", "UNMAPPED", "Rows", "TableOptions", "number", "numbers", "table_rows",
]  # fmt: skip

#: Number of first rows that may be the header: contest files have a title above it.
_HEAD = 3

#: Numbers with separators of thousands.
_THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2}([.,'’ ][0-9]{3})+([.,][0-9]*)?")
#: Cells without a value, in lower case.
MISSING = frozenset(("", "na", "n/a", "#n/a", "nan", "-"))
#: Value of the option `missing` that fills missing cells of samples over time.
INTERPOLATE = "interpolate"
#: Prefix of a column whose name the map of columns gives to another one.
UNMAPPED = "unmapped "

log = logging.getLogger("crosstrack")


class TableOptions(TypedDict, total=False):
    """Keywords of all readers of tables.

    Parameters
    ----------
    columns : mapping of str to str, optional
        Name in the file of each column that has another name there, such as ``{"x": "Easting"}``.
    encoding : str, optional
        Encoding of a text file that is neither UTF-8 nor UTF-16, such as ``"windows-1252"``.
    sheet : str or int, optional
        Name or number, from 1, of the sheet of an Excel file. Required if several have content.
    missing : str, optional
        ``"interpolate"`` fills missing cells of samples over time. By default they are errors.
    """

    columns: Mapping[str, str] | None
    encoding: str | None
    sheet: str | int | None
    missing: str | None


def number(text: str, where: str, field: str) -> float:
    """Return the finite number in `text`; error messages contain `where` and name `field`."""
    # float() alone would accept nan, inf, 1_000 and non-ASCII digits.
    stripped = text.strip()
    value = float(stripped) if NUMBER.fullmatch(stripped) else math.nan
    if not math.isfinite(value):
        raise InvalidData(
            f"{where}: must be a finite number, got {show(text)}{_advice(stripped)}", field=field
        )
    return value


def _advice(text: str) -> str:
    """Return the end of a message on a cell that is not a number."""
    if text.casefold() in MISSING:
        return ": the value is missing"
    if COMMA.fullmatch(text):
        return (
            ": a decimal comma needs semicolons or tabs between the columns of a text file; "
            "separators of thousands are not allowed"
        )
    return ": write it without thousands separators" if _THOUSANDS.fullmatch(text) else ""


def numbers(
    cells: Sequence[str],
    names: Sequence[str],
    where: str,
    field: str = "",
    read: Callable[[str, str, str], float] = number,
) -> list[float]:
    """Return the numbers of a row. Their count must match `names`, the default of `field`."""
    if len(cells) != len(names):
        raise InvalidData(
            f"{where}: {len(cells)} values where {len(names)} are allowed: {names[0]} to {names[-1]}",
            field=field or names[0],
        )
    pairs = zip(cells, names, strict=True)
    return [read(cell, f"{where}, column {name}", field or name) for cell, name in pairs]


class Rows:
    """Iterator over line and cells of every row of a CSV or Excel file that has a value.

    Blank rows, rows of separators and comments are skipped. Units in a row below the header are joined
    to the labels, and mapped columns have their new names.

    Parameters
    ----------
    path : path-like
        File to read.
    noun : str
        Noun for the rows, for messages.
    series : bool
        Whether rows are samples over time, so that missing values can be interpolated.
    **options
        See :class:`TableOptions`.

    Attributes
    ----------
    file : pathlib.Path
        The file.
    columns : dict of str to str
        The map of columns, names in lower case.
    fills : bool
        Whether missing values are interpolated.

    Raises
    ------
    BackendMissing
        The file is an Excel file, and openpyxl is not installed.
    InvalidData
        The file is not a valid CSV or Excel file, exceeds a limit, lacks a mapped column, or an option
        is invalid.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        noun: str = "row",
        *,
        series: bool = False,
        **options: Unpack[TableOptions],
    ) -> None:
        self.file = as_path(path)
        self.columns = _map(options.pop("columns", None))
        encoding, sheet = options.pop("encoding", None), options.pop("sheet", None)
        missing = options.pop("missing", None)
        if options:
            raise InvalidData(
                f"options of a table must be {', '.join(TableOptions.__annotations__)}, "
                f"got {show(', '.join(options))}"
            )
        if missing not in (None, INTERPOLATE) or (missing and not series):
            why = "" if missing != INTERPOLATE else f": {noun}s are not samples over time"
            raise InvalidData(
                f"missing must be absent{' or ' + repr(INTERPOLATE) if series else ''}, got "
                f"{show(missing)}{why}",
                field="missing",
            )
        self.fills = missing is not None
        self._separator, self._mark, self._place = ",", "", ""
        if self.file.suffix.casefold() == ".xlsx":
            if encoding is not None:
                raise InvalidData("encoding is for text files: omit it", field="encoding")
            source = xlsx_rows(self.file, sheet)
        else:
            if sheet is not None:
                raise InvalidData(f"sheet is for Excel files, not {self.file}", field="sheet")
            text = read_table_text(self.file, encoding)
            self._separator = separator_of(text)
            source = csv_rows(text, str(self.file), self._separator)
        self._rows = self._prepared(source)

    def __iter__(self) -> Iterator[tuple[int, list[str]]]:
        return self._rows

    def number(self, text: str, where: str, field: str) -> float:
        """Return the finite number in a cell, as :func:`number`.

        A decimal comma is accepted between semicolons or tabs. A file with both decimal marks is
        refused, because one of them could separate thousands.
        """
        cell = text.strip()
        if self._separator in ";\t":
            comma = COMMA.fullmatch(cell) is not None
            mark = "," if comma else "." if "." in cell and NUMBER.fullmatch(cell) else ""
            if mark and self._mark and mark != self._mark:
                raise InvalidData(
                    f"{where}: must have the decimal mark of {self._place}, got {show(text)}: write "
                    "all numbers of the file with one mark and without thousands separators",
                    field=field,
                )
            if mark and not self._mark:
                self._mark, self._place = mark, f"{show(text)} ({where})"
                if (comma or self._separator == ";") and _THOUSANDS.fullmatch(cell):
                    log.warning("%s: %r is read as %g", where, cell, float(cell.replace(",", ".")))
            cell = cell.replace(",", ".") if comma else text
        return number(cell, where, field)

    def _prepared(self, source: Iterator[tuple[int, list[str]]]) -> Iterator[tuple[int, list[str]]]:
        """Yield the rows of `source` with the map and a row of units applied to their header."""
        head = list(itertools.islice(source, _HEAD + 1))
        self._drop_titles(head)
        if self.columns:
            self._rename(head)
        for k, ((_, labels), (line, cells)) in enumerate(itertools.pairwise(head)):
            cells = cells + [""] * (len(labels) - len(cells))
            if (
                len(cells) == len(labels)
                and is_unit_row(cells)
                and not any(map(is_numeric, labels))
            ):
                head[k][1][:] = with_units(labels, cells, f"{self.file}, line {line}")
                del head[k + 1]
                break
        labels = head[0][1] if head else []
        filled = {k for _, cells in head for k, cell in enumerate(cells) if cell}
        first, end = min(filled, default=0), max(filled, default=0) + 1
        has_header = not any(map(is_numeric, labels))
        for line, cells in itertools.chain(head, source):
            # Spreadsheets write empty columns beside the table, and a separator at the end of every row.
            if has_header and not any((*cells[:first], *cells[end:])):
                cells = cells[first:end]
            elif has_header:  # longer than the header, so that a reader refuses the row
                cells = cells + [""] * (end - len(cells))
            yield line, cells

    def _drop_titles(self, head: list[tuple[int, list[str]]]) -> None:
        """Remove the rows with one value above the header from `head`, and log them."""
        filled = [[cell for cell in cells if cell] for _, cells in head]
        count = next((k for k, values in enumerate(filled) if len(values) > 1), 0)
        if any(all(map(is_numeric, values)) for values in filled[: count + 1]):
            return
        for (line, _), values in zip(head[:count], filled, strict=False):
            log.warning(
                "%s, line %d: a title that is not read: %s", self.file, line, show(values[0])
            )
        del head[:count]

    def _rename(self, head: Sequence[tuple[int, list[str]]]) -> None:
        """Give mapped columns their new names in the header, one of the first rows, in place."""
        sources = {source: target for target, source in self.columns.items()}

        def places(labels: Sequence[str]) -> dict[int, str]:
            result = {}
            for at, label in enumerate(labels):
                # A label without its unit matches only if no label matches as a whole.
                for name in (label, label_parts(label)[0]):
                    target = sources.get(name.strip("# ").casefold())
                    if target is not None:
                        result[at] = target
                        break
            return result

        line, labels = max(head[:_HEAD], key=lambda row: len(places(row[1])), default=(1, []))
        found = places(labels)
        for target, source in self.columns.items():
            count = list(found.values()).count(target)
            if count != 1:
                rest = (
                    suggestion(source, [label.casefold() for label in labels]) if not count else ""
                )
                raise InvalidData(
                    f"{self.file}, line {line}: columns must name columns of the file, and "
                    f"{show(source)} (for {target}) is there {count} times: {rest}the file has "
                    f"{show(', '.join(labels))}",
                    field="columns",
                )
        for at, label in enumerate(labels):
            name, unit = label_parts(label)
            if at in found:
                labels[at] = f"{found[at]} [{unit}]" if unit else found[at]
            elif {label.casefold(), name.casefold()} & self.columns.keys():
                labels[at] = UNMAPPED + label


def _map(columns: Mapping[str, str] | None) -> dict[str, str]:
    """Return the map of columns with names in lower case, or raise."""
    if columns is None:
        return {}
    if not isinstance(columns, Mapping) or not all(
        isinstance(word, str) and word.strip() for pair in columns.items() for word in pair
    ):
        raise InvalidData(
            "columns must map names of columns to those in the file, such as {'x': 'Easting'}, got "
            f"{show(columns)}",
            field="columns",
        )
    result = {k.strip().casefold(): v.strip("# ").casefold() for k, v in columns.items()}
    if len(set(result.values())) < len(columns):
        raise InvalidData(
            f"columns must map each name to another column, got {show(dict(columns))}",
            field="columns",
        )
    return result


def table_rows(
    path: str | os.PathLike[str], **options: Unpack[TableOptions]
) -> Iterator[tuple[int, list[str]]]:
    """Yield line and cells of every row of a CSV or Excel file that has a value; see :class:`Rows`."""
    yield from Rows(path, **options)
