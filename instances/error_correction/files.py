"""Readers and writers of points in CSV and Excel files, and of instances that refer to them.

A file has the columns ``x,y,z,kind`` and optionally ``id`` and ``fail`` in any order. ``fail`` (1 or 0)
marks corrections that may fail and is used only with a given `residual`. A warning names further
columns. Without a header the columns are ``id,x,y,z,kind`` or ``x,y,z,kind``. Kinds are words (A,
horizontal, vertical, B) or codes: -1 (A), 0 (horizontal), 1 (vertical), 2 (B).
"""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, Unpack

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...files import as_path, write_text
from ...models.error_correction.model import ErrorCorrectionRouting
from ...models.error_correction.points import as_kind, kind_word
from ...models.fields import required, show
from ..rows import Rows, TableOptions
from ..storage import pretty, reference, write_model
from ..tables import number, table_text, write_rows
from ..text_tables import csv_rows
from ..units import LENGTHS, factor_of

__all__ = [
    "PointTable",
    "points_of_table",
    "read_csv",
    "read_points",
    "resolve_references",
    "write_csv",
    "write_json",
]

log = logging.getLogger("crosstrack")

#: Columns, and those that may be missing.
_COLUMNS, _OPTIONAL = ("id", "x", "y", "z", "kind"), ("id", "fail")
#: Other names of columns; the Chinese ones are from the contest's file.
_NAMES = {
    **{name: name for name in (*_COLUMNS, "fail")},
    "suspect": "fail",
    "第三问点标记": "fail",
    "number": "id",
    "no.": "id",
    "编号": "id",
    **{f"{axis}坐标": axis for axis in "xyz"},
    "type": "kind",
    "校正点类型": "kind",
    "校正点标记": "kind",
}

#: Values of the column ``fail``, and the fields stored in a file of points.
_MARKS = {"0": False, "1": True, "0.0": False, "1.0": True, "false": False, "true": True}
_OF_POINTS = ("points", "kinds", "ids", "suspect")

#: Whole number in Python's canonical form, so that "007" remains a word.
_WHOLE = re.compile(r"0|-?[1-9][0-9]*")


@dataclass(frozen=True, eq=False)
class PointTable:
    """Points of a file.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Coordinates (m).
    kinds : tuple of str, length n
        The kinds as words.
    ids : tuple of int or str, optional
        Names of the points, as numbers if all are whole numbers; None for 0 … n-1.
    fail : tuple of bool, optional
        Whether each correction may fail; None if the file has no such column.
    """

    points: NDArray[np.float64]
    kinds: tuple[str, ...]
    ids: tuple[int | str, ...] | None = None
    fail: tuple[bool, ...] | None = None

    def data(self) -> dict[str, Any]:
        """Return the fields for the constructor of the model."""
        fields = {"points": self.points, "kinds": self.kinds, "ids": self.ids}
        return fields if self.fail is None else {**fields, "fail": self.fail}


# -- reading -------------------------------------------------------------------------------------


def read_points(path: str | os.PathLike[str], **options: Unpack[TableOptions]) -> PointTable:
    """Read the points in a CSV or Excel file (``.xlsx``).

    A warning in the log names unused columns.

    Parameters
    ----------
    path : path-like
        The file.
    **options
        Map of columns, encoding and sheet, see :class:`~crosstrack.instances.TableOptions`.

    Returns
    -------
    PointTable
        The points.

    Raises
    ------
    BackendMissing
        It is an Excel file, and openpyxl is not installed.
    InvalidData
        The file is invalid; the error names file, line, column and value. Examples: a missing column,
        a repeated id, a number that is not finite, an unknown kind, a row of another length, not
        exactly one A and one B, an empty file, or an encoding other than UTF-8.
    """
    file = as_path(path)
    reader = Rows(file, "point", **options)
    for target in reader.columns.keys() - _NAMES.keys():
        raise InvalidData(
            f"columns must name columns of points, {', '.join((*_COLUMNS, 'fail'))}, got {show(target)}",
            field="columns",
        )
    rows = list(reader)
    if file.suffix.casefold() == ".xlsx":
        # Excel stores no empty cells at the end of a row, so rows are padded.
        width = max([len(row) for _, row in rows], default=0)
        rows = [(line, row + [""] * (width - len(row))) for line, row in rows]
    return _parse(rows, str(file), reader.number)


def read_csv(
    path: str | os.PathLike[str], *, name: str | None = None, **data: Any
) -> ErrorCorrectionRouting:
    """Read points from a CSV or Excel file and return the model with the fields in `data`.

    Parameters
    ----------
    path : path-like
        The file.
    name : str, optional
        Name of the model; by default that of the file.
    **data
        Fields that are not in the file: ``alpha1``, …, ``theta``, ``delta`` or the two rates, and
        optionally ``revisits`` and ``residual``.

    Returns
    -------
    ErrorCorrectionRouting
        The model.

    Raises
    ------
    InvalidData
        As for :func:`read_points`, or a field is in the file, too, or invalid.
    """
    table = read_points(path)
    for key in _OF_POINTS[:3] + (("suspect",) if table.fail is not None else ()):
        if key in data:
            raise InvalidData(f"{key} must not be given: {path} holds it", field=key)
    name = Path(path).stem if name is None else name
    return ErrorCorrectionRouting.from_data({**data, **table.data()}, name=name)


def points_of_table(file: Path, **options: Unpack[TableOptions]) -> dict[str, Any]:
    """Return the instance data of a file of points."""
    return read_points(file, **options).data()


#: Replaces ``"points": "file.csv"`` in an instance by the points in the file.
resolve_references = reference("points", points_of_table, excluded=["suspect"])


@dataclass(frozen=True)
class _Layout:
    """Positions of the columns, names of unused columns, index of the first row of points, and factors."""

    places: Mapping[str, int]
    unused: tuple[str, ...]
    first: int
    factors: Mapping[str, float]


def _parse(
    rows: Sequence[tuple[int, list[str]]],
    file: str,
    read: Callable[[str, str, str], float] = number,
) -> PointTable:
    if not rows:
        raise InvalidData(f"{file}: the file is empty; its columns must be {', '.join(_COLUMNS)}")
    layout = _layout(rows, file)
    if layout is None:
        _refuse(rows, file)
    if layout.unused:
        log.warning("%s: not used: %s", file, ", ".join(map(show, layout.unused)))
    width = len(rows[max(layout.first - 1, 0)][1])
    body = rows[layout.first :]
    for line, row in body:
        if len(row) != width:
            above = "the header" if layout.first else "the first row"
            raise InvalidData(
                f"{file}, line {line}: {len(row)} values where {above} has {width} columns"
            )
    if not body:
        raise InvalidData(f"{file}: no points below the header", field="points")
    lines = [line for line, _ in body]
    # Cells of each known column with their places in the file.
    cells = {
        name: [(row[at], f"{file}, line {line}, column {name}") for line, row in body]
        for name, at in layout.places.items()
    }
    points = [
        [read(*cell, "points") * layout.factors.get(axis, 1.0) for cell in cells[axis]]
        for axis in "xyz"
    ]
    kinds = tuple(kind_word(cell, f"{place}:") for cell, place in cells["kind"])
    for word in ("A", "B"):
        ends = [k for k, kind in enumerate(kinds) if kind == word]
        if len(ends) != 1:
            raise InvalidData(
                f"{cells['kind'][ends[1]][1]}: a second {word}, the first is in line {lines[ends[0]]}"
                if ends
                else f"{file}: no point is of kind {word}",
                field="kinds",
            )
    return PointTable(
        np.column_stack(points),
        kinds,
        _labels(cells["id"], lines) if "id" in cells else None,
        _marks(cells["fail"], kinds) if "fail" in cells else None,
    )


def _marks(cells: Sequence[tuple[str, str]], kinds: Sequence[str]) -> tuple[bool, ...]:
    """Return whether the corrections may fail, from cells and their places."""
    for (cell, place), kind in zip(cells, kinds, strict=True):
        if cell.casefold() not in _MARKS:
            raise InvalidData(f"{place}: must be 1 or 0, got {show(cell)}", field="suspect")
        if _MARKS[cell.casefold()] and kind in ("A", "B"):
            raise InvalidData(
                f"{place}: must be 0 for {kind}, which corrects nothing", field="suspect"
            )
    return tuple(_MARKS[cell.casefold()] for cell, _ in cells)


def _layout(rows: Sequence[tuple[int, list[str]]], file: str) -> _Layout | None:
    """Return the layout given by a header or by the values; None if neither determines it."""
    # Contest files have a title above the header: a row with a single value.
    titles = 0
    while titles < min(len(rows), 3) and len(list(filter(None, rows[titles][1]))) == 1:
        titles += 1
    for first in {0, titles}:
        if first < len(rows):
            line, header = rows[first]
            names = [_NAMES.get(_bare(name), "") for name in header]
            if names.count("kind") and any(names.count(axis) for axis in "xyz"):
                places = _header(names, header, f"{file}, line {line}")
                unused = [name for name, known in zip(header, names, strict=True) if not known]
                factors = {
                    axis: _factor(header[places[axis]], f"{file}, line {line}, column {axis}", axis)
                    for axis in "xyz"
                }
                return _Layout(places, tuple(unused), first + 1, factors)
    for kind in (4, 3):  # id,x,y,z,kind or x,y,z,kind, and what may follow
        kinds = [as_kind(row[kind]) for _, row in rows if len(row) > kind]
        if (
            len(kinds) == len(rows)
            and None not in kinds
            and kinds.count("A") == kinds.count("B") == 1
        ):
            places = {name: kind - 3 + k for k, name in enumerate("xyz")} | {"kind": kind}
            unused = [f"column {k + 1}" for k in range(kind + 1, len(rows[0][1]))]
            return _Layout(places | ({"id": 0} if kind == 4 else {}), tuple(unused), 0, {})
    return None


def _bare(name: str) -> str:
    """Return a column's name without its unit: ``"X坐标（单位: m）"`` is ``"x坐标"``."""
    return re.sub(r"[(（\[].*", "", name).strip().casefold()


def _factor(label: str, where: str, axis: str) -> float:
    """Return the metres of the unit at the end of a label, 1 without a unit, or raise."""
    unit = re.split(r"[(（\[:：]", label[:-1])[-1] if label[-1:] in (")", "）", "]") else ""
    return factor_of(unit.strip(), LENGTHS, where, axis, bare=True)


def _header(names: list[str], header: list[str], where: str) -> dict[str, int]:
    """Return the position of each known column in `header`."""
    for column in (*_COLUMNS, "fail"):
        if names.count(column) > 1:
            raise InvalidData(f"{where}: column {column!r} stands twice", field=column)
        if column not in names and column not in _OPTIONAL:
            raise InvalidData(
                f"{where}: column {column!r} is missing; found {show(', '.join(header))}",
                field=column,
            )
    return {name: names.index(name) for name in (*_COLUMNS, "fail") if name in names}


def _refuse(rows: Sequence[tuple[int, list[str]]], file: str) -> NoReturn:
    """Raise an error that names a missing column and the columns of files without a header."""
    line, header = rows[0]
    names = [_NAMES.get(_bare(name), "") for name in header]
    lacking = next((column for column in _COLUMNS[1:] if column not in names), "kind")
    hint = ": values must be separated by commas" if len(header) == 1 else ""
    raise InvalidData(
        f"{file}, line {line}: column {lacking!r} is missing; found {show(', '.join(header))}{hint}. "
        "Without a header, columns must be id,x,y,z,kind or x,y,z,kind, with one A and one B",
        field=lacking,
    )


def _labels(cells: Sequence[tuple[str, str]], lines: Sequence[int]) -> tuple[int | str, ...] | None:
    """Return the names of the points, from cells and their places; None for 0, 1, 2, …."""
    first: dict[str, int] = {}
    for (label, place), line in zip(cells, lines, strict=True):
        if not label:
            raise InvalidData(f"{place}: must not be empty", field="ids")
        if first.setdefault(label, line) != line:
            raise InvalidData(
                f"{place}: {label!r} is in line {first[label]} too: ids must differ", field="ids"
            )
    if not all(map(_WHOLE.fullmatch, first)):
        return tuple(first)
    try:
        numbers = tuple(map(int, first))
    except ValueError:  # more digits than Python converts
        return tuple(first)
    return None if numbers == tuple(range(len(numbers))) else numbers


# -- writing -------------------------------------------------------------------------------------


def write_csv(model: ErrorCorrectionRouting, path: str | os.PathLike[str]) -> Path:
    """Write the points of `model` as CSV, losslessly and atomically; return the path.

    Parameters
    ----------
    model : ErrorCorrectionRouting
        The model.
    path : path-like
        The file.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InvalidData
        An id would be read back as another value, such as the word ``"7"`` among whole numbers.
    """
    required("model", model, ErrorCorrectionRouting)
    file = as_path(path)
    suspect = model.suspect
    marks = [()] * len(model.points) if suspect is None else [(int(mark),) for mark in suspect]
    header = _COLUMNS if suspect is None else (*_COLUMNS, "fail")
    rows = [
        (label, *point, str(kind), *mark)
        for label, point, kind, mark in zip(
            _ids_of(model), model.points.tolist(), model.kinds, marks, strict=True
        )
    ]
    _require_same(model, table_text(header, rows), str(file))
    return write_rows(file, header, rows)


def _ids_of(table: ErrorCorrectionRouting | PointTable) -> Sequence[int | str]:
    """Return the names of the points, which are numbers from 0 by default."""
    return range(len(table.points)) if table.ids is None else table.ids


def _require_same(model: ErrorCorrectionRouting, text: str, file: str) -> None:
    """Read `text` back and raise unless all ids are the same."""
    expected = _ids_of(model)
    try:
        ids = _ids_of(_parse(list(csv_rows(text, file)), file))
    except InvalidData:
        ids = ()
    for have, want in zip(ids, expected, strict=False):
        if have != want or type(have) is not type(want):
            raise InvalidData(
                f"{file}: id {want!r} would be read back from CSV as {have!r}: use JSON, or ids "
                "that are all whole numbers or all words",
                field="ids",
            )
    if len(ids) != len(expected):
        raise InvalidData(f"{file}: the ids cannot be written as CSV: use JSON", field="ids")


def write_json(
    model: ErrorCorrectionRouting, path: str | os.PathLike[str], *, points: str | None = None
) -> Path:
    """Write `model` as an instance file, losslessly and atomically; return the path.

    Parameters
    ----------
    model : ErrorCorrectionRouting
        The model.
    path : path-like
        The JSON file.
    points : str, optional
        Write points, kinds and ids to this CSV file, relative to the folder of `path`, and refer
        to it; by default they are part of the JSON file.

    Returns
    -------
    Path
        The JSON file.
    """
    required("model", model, ErrorCorrectionRouting)
    if points is None:
        return write_model(model, path)
    file = as_path(path)
    required("points", points, str)
    content = model.to_dict()
    data = {k: v for k, v in content["data"].items() if k not in _OF_POINTS}
    # Write the CSV first, so that a JSON file never refers to a missing file.
    write_csv(model, file.parent / points)
    return write_text(file, pretty({**content, "data": {"points": points, **data}}))
