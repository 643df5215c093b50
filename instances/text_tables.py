"""Rows of text tables: encoding, separator, comments and quoted cells (RFC 4180)."""

from __future__ import annotations

import csv
import io
import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from ..errors import InvalidData
from ..files import decoded, read_bytes
from ..models.fields import Optional, Text, show

__all__ = [
    "COMMA", "ENCODINGS", "NUMBER", "csv_rows", "is_comment", "is_numeric", "read_table_text",
    "separator_of", "without_comments",
]  # fmt: skip

#: Number of first lines that show the separator.
GLANCE = 100
#: Accepted forms of numbers in files, and those with a decimal comma.
NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
COMMA = re.compile(r"[+-]?([0-9]+,[0-9]*|,[0-9]+)([eE][+-]?[0-9]+)?")
#: First line that spreadsheets read as the separator of the columns.
_SEPARATOR = re.compile(r"\s*[Ss][Ee][Pp]=([,;\t])[,;\t]*\s*(\n|$)")
#: Start of a line of comment.
_COMMENTS = ("#", "%", "//")
#: Error values of spreadsheets in the first cell, such as #N/A, #DIV/0! and #NAME?: no comments.
_ERROR = re.compile(r"#(N/A|NV|N/D|[^\W\d_]+(/0)?[!?])\s*($|[,;\t])")
#: Encodings of text files. UTF-8 is the default, and UTF-16 with a byte-order mark is recognised.
ENCODINGS = (
    "utf-8", "utf-16", "utf-16-le", "utf-16-be", "latin-1", "iso-8859-1", "iso-8859-15",
    "windows-1252", "cp1252", "windows-1250", "windows-1251", "koi8-r", "gbk", "gb18030", "big5",
    "shift_jis", "euc-kr", "mac-roman",
)  # fmt: skip
#: Byte-order marks of UTF-16.
_MARKS = (b"\xff\xfe", b"\xfe\xff")
#: First line and cells of a row, whether it begins with a mark of comments, and whether a blank follows.
Record = tuple[int, list[str], bool, bool]


def read_table_text(file: Path, encoding: str | None) -> str:
    """Return the text of a file in `encoding`, by default UTF-8, or UTF-16 with its mark."""
    name = Optional(Text()).coerce("encoding", encoding, {})
    raw = read_bytes(file)
    zeros = max(raw[k:GLANCE:2].count(0) for k in (0, 1))
    if name is None and 4 * zeros > len(raw[:GLANCE]) and raw[:2] not in _MARKS:
        raise InvalidData(
            f"{file}: contains zero bytes, as UTF-16 without a byte-order mark: save it as UTF-8, or give "
            "its encoding, such as encoding='utf-16-le' (on the command line --encoding utf-16-le)",
            field="encoding",
        )
    if name is None:
        if raw[:2] not in _MARKS:
            try:
                return decoded(raw, file)
            except InvalidData as error:
                if error.field != "encoding":
                    raise
                raise InvalidData(
                    f"{error}, or give its encoding, such as encoding='windows-1252' (on the command "
                    "line --encoding windows-1252)",
                    field="encoding",
                ) from None
        name = "utf-16"
    if name.casefold() not in ENCODINGS:
        raise InvalidData(
            f"encoding must be one of {', '.join(ENCODINGS)}, got {show(name)}", field="encoding"
        )
    try:
        return decoded(raw.decode(name).encode(), file)
    except UnicodeError as error:
        place = f", byte {error.start}" if isinstance(error, UnicodeDecodeError) else ""
        raise InvalidData(
            f"{file}{place}: is no {name} text: give its encoding", field="encoding"
        ) from None


def is_numeric(cell: str) -> bool:
    """Return whether a cell is a number, with a decimal point or comma."""
    return bool(NUMBER.fullmatch(cell) or COMMA.fullmatch(cell))


def _cells(line: str, separator: str) -> list[str]:
    """Return the cells of a single line, with words in brackets joined if blanks separate."""
    try:
        row = next(csv.reader([line.strip() if separator == " " else line], **_dialect(separator)))
    except (csv.Error, StopIteration):
        return [line]
    return _stripped(row, separator)


def _dialect(separator: str) -> dict[str, Any]:
    return {"delimiter": separator, "skipinitialspace": separator == " "}


def _stripped(row: Sequence[str], separator: str) -> list[str]:
    """Return cells without outer blanks, and with units in brackets joined to names between blanks."""
    result: list[str] = []
    for cell in row:
        if separator == " " and result and cell[:1] in ("[", "("):
            result[-1] += f" {cell}"
        else:
            result.append(cell.strip())
    return result


def separator_of(text: str) -> str:
    """Return the separator of the columns: that of a first line ``sep=;``, else the one in most rows.

    Blanks separate if no other separator occurs and all of the first rows have equally many words.
    """
    declared = _SEPARATOR.match(text)
    if declared:
        return declared[1]
    lines = [
        line for line in itertools.islice(io.StringIO(text, newline=""), GLANCE) if line.strip()
    ]
    lines = [line for line in lines if not is_comment(line)] or lines
    counts = {mark: [len(_cells(line, mark)) for line in lines] for mark in ",;\t "}
    votes = {mark: sum(count > 1 for count in counts[mark]) for mark in ",;\t"}
    most = max(votes.values())
    if not most:
        words = set(counts[" "])
        return " " if len(words) == 1 and words != {1} and len(lines) > 1 else ","
    ties = [mark for mark, vote in votes.items() if vote == most]
    for mark in ties[1:] if ties[0] == "," else ():
        # Commas within the cells of another separator are decimal commas.
        plain = sum(
            all("," not in cell or is_numeric(cell) for cell in _cells(line, mark))
            for line in lines
        )
        if 2 * plain > len(lines):
            return mark
    return max(ties, key=lambda mark: counts[mark][0])


def is_comment(line: str) -> bool:
    """Return whether a line begins with a mark of comments, and not with an error value."""
    text = line.lstrip()
    return text.startswith(_COMMENTS) and not _ERROR.match(text)


def csv_rows(text: str, file: str, separator: str | None = None) -> Iterator[tuple[int, list[str]]]:
    """Yield first line and cells of every row of text that has a value, without comments."""
    mark = separator or separator_of(text)
    declared = _SEPARATOR.match(text)
    if declared:  # an empty line keeps the numbers of the others
        text = "\n" + text[declared.end() :]
    return without_comments(_records(text, file, mark), blanks=mark == " ")


def without_comments(
    records: Iterable[Record], *, blanks: bool = False
) -> Iterator[tuple[int, list[str]]]:
    """Yield line and cells of every row that has a value, without comments.

    Ids may begin with a mark of comments. A line with such a mark is a comment if it has one cell, or
    if a blank follows the mark and the line has not as many cells as the rows. Between `blanks` the
    number of words means nothing. The last line above numbers is a header if it has as many cells.
    """
    above: list[Record] = []
    width = 0
    for record in records:
        line, cells, marked, loose = record
        if not any(cells):
            continue
        if marked and not width:
            above.append(record)
            continue
        if not width:
            yield from _rows_above(above, cells, blanks)
            above = []
        if not marked or (len(cells) > 1 and (not loose or (len(cells) == width and not blanks))):
            width = max(width, len(cells))
            yield line, cells
    yield from (record[:2] for record in above)  # every line begins with a mark


def _rows_above(
    above: Sequence[Record], first: Sequence[str], blanks: bool
) -> Iterator[tuple[int, list[str]]]:
    """Yield the marked lines above the first row that are rows."""
    for line, cells, _, loose in above:
        header = line == above[-1][0] and any(map(is_numeric, first))
        numeric = not blanks and any(map(is_numeric, cells[1:]))
        alike = len(cells) == len(first) and (header or numeric)
        if alike or (len(cells) > 1 and not loose):
            yield line, cells


def _records(text: str, file: str, separator: str) -> Iterator[Record]:
    """Yield every row of a text."""
    lines = enumerate(io.StringIO(text, newline=""), 1)
    blanks = separator == " "
    for begin, line in lines:
        if is_comment(line):
            rest = line.strip().lstrip("#%/")
            loose = not rest or rest[0].isspace()
            # Between blanks, the mark belongs to the first name of a header.
            line = f"#{rest.lstrip()}" if blanks else line
            yield begin, _cells(line, separator), True, loose
            continue
        group = [line.strip() if blanks else line]
        if line.count('"') % 2:  # a quoted cell contains line breaks
            for _, more in lines:
                group.append(more)
                if more.count('"') % 2:
                    break
        place = begin
        reader = csv.reader(group, strict=True, **_dialect(separator))
        try:
            for row in reader:
                yield place, _stripped(row, separator), False, False
                place = begin + reader.line_num
        except csv.Error as error:
            raise InvalidData(f"{file}, line {place}: no valid CSV: {error}") from None
