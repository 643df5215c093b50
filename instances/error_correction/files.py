"""Points of error-correction routing in CSV files, and instances that refer to them.

A CSV file has the columns ``id,x,y,z,kind`` in any order; further columns are left alone. Kinds
are words (A, horizontal, vertical, B) or A, B, 0 (horizontal), 1 (vertical).
"""

from __future__ import annotations

import csv
import io
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.error_correction.model import ErrorCorrectionRouting
from ...models.error_correction.points import kind_word
from ...models.fields import required, show
from ..storage import Find, as_path, number, pretty, read_text, write_model, write_text

__all__ = ["PointTable", "read_csv", "read_points", "resolve_references", "write_csv", "write_json"]

_COLUMNS = ("id", "x", "y", "z", "kind")

#: A whole number written the one way that Python writes it, so that "007" stays a word.
_WHOLE = re.compile(r"0|-?[1-9][0-9]*")


@dataclass(frozen=True, eq=False)
class PointTable:
    """The points in a CSV file.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Coordinates (m).
    kinds : tuple of str, length n
        The kinds as words.
    ids : tuple of int or str, optional
        The points' names, numbers where all are whole numbers; None where they are 0 … n-1.
    """

    points: NDArray[np.float64]
    kinds: tuple[str, ...]
    ids: tuple[int | str, ...] | None = None

    def data(self) -> dict[str, Any]:
        """Return what the constructor of the model takes."""
        return {"points": self.points, "kinds": self.kinds, "ids": self.ids}


# -- reading -------------------------------------------------------------------------------------


def read_points(path: str | os.PathLike[str]) -> PointTable:
    """Return the points in a CSV file.

    Raises
    ------
    InvalidData
        Naming file, line, column and value: a missing column, an id that repeats, what is no
        finite number, an unknown kind, a row too short or too long, not one A and one B, an
        empty file, an encoding other than UTF-8.
    """
    file = as_path(path)
    return _parse(read_text(file), str(file))


def read_csv(
    path: str | os.PathLike[str], *, name: str | None = None, **data: Any
) -> ErrorCorrectionRouting:
    """Return the model of the points in a CSV file and of the thresholds in `data`.

    Parameters
    ----------
    path : path-like
        The CSV file.
    name : str, optional
        The model's name; by default the file's.
    **data
        What the file does not hold: ``alpha1``, …, ``theta``, ``delta`` or the two rates,
        ``revisits``.
    """
    table = read_points(path)
    for key in table.data():
        if key in data:
            raise InvalidData(f"{key} must not be given: {path} holds it", field=key)
    name = Path(path).stem if name is None else name
    return ErrorCorrectionRouting.from_data({**data, **table.data()}, name=name)


def describe_points(file: Path, header: str) -> str:
    """Return what to do with a CSV file of points, empty where it is none."""
    names = {name.strip().casefold() for name in header.split(",")}
    if not {"id", "kind"} & names:
        return ""
    return (
        "a CSV file holds points and no thresholds. Write an instance file beside it, "
        f'{{"model": "error-correction", "data": {{"points": "{file.name}", "alpha1": …, '
        '"alpha2": …, "beta1": …, "beta2": …, "theta": …, "delta": …}}, or call '
        "crosstrack.instances.read_csv(path, alpha1=…, …)"
    )


def resolve_references(data: Mapping[str, Any], find: Find) -> dict[str, Any]:
    """Return `data` of an instance with ``"points": "file.csv"`` replaced by the file's content."""
    found = dict(data)
    reference = found.get("points")
    if not isinstance(reference, str):
        return found
    for key in ("kinds", "ids"):
        if key in found:
            raise InvalidData(
                f"{key} must not be given beside points {reference!r}: the file holds them",
                field=key,
            )
    return {**found, **read_points(find(reference)).data()}


def _parse(text: str, file: str) -> PointTable:
    rows = _rows(text, file)
    line, header = next(rows, (1, []))
    places = _header(header, f"{file}, line {line}") if header else None
    if places is None:
        raise InvalidData(f"{file}: the file is empty; its columns must be {', '.join(_COLUMNS)}")
    ids: dict[str, int] = {}
    ends: dict[str, int] = {}
    points: list[list[float]] = []
    kinds: list[str] = []
    for line, row in rows:
        where = f"{file}, line {line}"
        if len(row) != len(header):
            raise InvalidData(
                f"{where}: {len(row)} values where the header has {len(header)} columns"
            )
        label = row[places["id"]].strip()
        if not label:
            raise InvalidData(f"{where}, column id: must not be empty", field="ids")
        if label in ids:
            raise InvalidData(
                f"{where}, column id: {label!r} stands in line {ids[label]} too: ids must differ",
                field="ids",
            )
        ids[label] = line
        points.append(
            [number(row[places[axis]], f"{where}, column {axis}", "points") for axis in "xyz"]
        )
        word = kind_word(row[places["kind"]].strip(), f"{where}, column kind:")
        if word in ("A", "B"):
            if word in ends:
                raise InvalidData(
                    f"{where}, column kind: a second {word}, the first is in line {ends[word]}",
                    field="kinds",
                )
            ends[word] = line
        kinds.append(word)
    if not points:
        raise InvalidData(f"{file}: no points below the header", field="points")
    for word in ("A", "B"):
        if word not in ends:
            raise InvalidData(f"{file}: no point is of kind {word}", field="kinds")
    return PointTable(np.array(points), tuple(kinds), _labels(list(ids)))


def _rows(text: str, file: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows that are not blank, each with the number of its first line."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    line = 1
    while True:
        try:
            row = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise InvalidData(f"{file}, line {line}: no valid CSV: {error}") from None
        if any(value.strip() for value in row):
            yield line, row
        line = reader.line_num + 1


def _header(header: list[str], where: str) -> dict[str, int]:
    names = [name.strip().casefold() for name in header]
    for column in _COLUMNS:
        if names.count(column) > 1:
            raise InvalidData(f"{where}: column {column!r} stands twice", field=column)
        if column not in names:
            hint = ": values must be separated by commas" if len(names) == 1 else ""
            raise InvalidData(
                f"{where}: column {column!r} is missing; found {show(', '.join(header))}{hint}",
                field=column,
            )
    return {column: names.index(column) for column in _COLUMNS}


def _labels(words: list[str]) -> tuple[int | str, ...] | None:
    if not all(_WHOLE.fullmatch(word) for word in words):
        return tuple(words)
    try:
        numbers = tuple(map(int, words))
    except ValueError:  # more digits than Python converts
        return tuple(words)
    return None if numbers == tuple(range(len(numbers))) else numbers


# -- writing -------------------------------------------------------------------------------------


def write_csv(model: ErrorCorrectionRouting, path: str | os.PathLike[str]) -> Path:
    """Write the points of `model`, exactly and in one step; return the path.

    Raises
    ------
    InvalidData
        An id would not be read back as it is, such as the word ``"7"`` among whole numbers.
    """
    required("model", model, ErrorCorrectionRouting)
    path = as_path(path)
    ids = range(len(model.points)) if model.ids is None else model.ids
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for label, point, kind in zip(ids, model.points.tolist(), model.kinds.tolist(), strict=True):
        writer.writerow([label, *map(repr, point), kind])
    text = stream.getvalue()
    _require_same(model, text, str(path))
    return write_text(path, text)


def _require_same(model: ErrorCorrectionRouting, text: str, file: str) -> None:
    """Read `text` back and compare: what CSV cannot say about an id is found here."""
    wanted = tuple(range(len(model.points))) if model.ids is None else model.ids
    try:
        table = _parse(text, file)
        ids = tuple(range(len(model.points))) if table.ids is None else table.ids
    except InvalidData:
        ids = ()
    for have, want in zip(ids, wanted, strict=False):
        if have != want or type(have) is not type(want):
            raise InvalidData(
                f"{file}: id {want!r} would be read back from CSV as {have!r}: use JSON, or ids "
                "that are all whole numbers or all words",
                field="ids",
            )
    if len(ids) != len(wanted):
        raise InvalidData(f"{file}: the ids cannot be written as CSV: use JSON", field="ids")


def write_json(
    model: ErrorCorrectionRouting, path: str | os.PathLike[str], *, points: str | None = None
) -> Path:
    """Write `model` as an instance file, exactly and in one step; return the path.

    Parameters
    ----------
    model : ErrorCorrectionRouting
        The model.
    path : path-like
        The JSON file.
    points : str, optional
        Write points, kinds and ids to this CSV file, relative to the folder of `path`, and refer
        to it; by default they stand in the JSON file itself.
    """
    required("model", model, ErrorCorrectionRouting)
    if points is None:
        return write_model(model, path)
    file = as_path(path)
    required("points", points, str)
    content = model.to_dict()
    data = {k: v for k, v in content["data"].items() if k not in ("points", "kinds", "ids")}
    # The CSV first: a JSON file never refers to what is not there yet.
    write_csv(model, file.parent / points)
    return write_text(file, pretty({**content, "data": {"points": points, **data}}))
