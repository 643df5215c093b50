"""Stops of a guided vehicle in CSV and Excel files, and instances that refer to such or to SOP files.

A file has a header with the column ``coordinate`` and any of ``id``, ``chain``, ``place``, ``after``,
``load``, ``service``, ``earliest`` and ``latest``, in any order. The first row below it is the start. Rows with the same entry of ``chain`` form a chain,
in the order of ``place``, or of the rows if this column is missing. An empty cell means no chain. A
cell of ``after`` lists the stops that must precede, separated by spaces: by their ids, or without
ids by their row numbers, where the start has number 0. Empty cells of ``load``, ``service`` and
``earliest`` are 0, those of ``latest`` have no limit. Windows need a speed in the instance that names the file.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Unpack

from ...errors import InvalidData
from ...models.fields import show
from ..storage import Find, reference
from ..tables import Column, TableOptions, read_table
from ..units import LENGTHS, TIMES
from .sop import read_sop

__all__ = ["read_stops", "resolve_references"]

_COLUMNS = (
    Column("coordinate", units=LENGTHS, bare=True),
    Column("id", field="ids", text=True, optional=True, aliases=("name",)),
    Column("chain", text=True, empty=True, optional=True),
    Column("place", empty=True, optional=True),
    Column("after", text=True, empty=True, optional=True),
    Column("load", field="loads", empty=True, optional=True),
    *(
        Column(name, field=field, empty=True, optional=True, units=TIMES, bare=True)
        for name, field in (("service", "service"), ("earliest", "windows"), ("latest", "windows"))
    ),
)


def read_stops(path: str | os.PathLike[str], **options: Unpack[TableOptions]) -> dict[str, Any]:
    """Return the instance data in a CSV or Excel file of stops.

    Parameters
    ----------
    path : path-like
        The file.
    **options
        Map of columns, encoding and sheet, see :class:`~crosstrack.instances.TableOptions`.

    Returns
    -------
    dict
        ``coordinates`` (m), and ``chains``, ``precedence``, ``ids``, ``loads``, ``service`` (s) and
        ``windows`` (s) if the file has them: the arguments of :class:`~crosstrack.models.guided_path.GuidedPathTour`.

    Raises
    ------
    BackendMissing
        The file is an Excel file, and openpyxl is not installed.
    InvalidData
        A column is missing, repeated or unknown; a row has a wrong length; a value is not a finite
        number; an id is empty or repeated; the start is in a chain or after others; a place in a
        chain is empty or repeated; a stop is unknown; or the file has no stops. The message
        contains file, line, column and value.
    """
    table = read_table(
        path,
        _COLUMNS,
        "coordinate, with id, chain, place in the chain, after, load, service, earliest and latest if they "
        "have any",
        row="stop",
        field="coordinates",
        suits=lambda names: "chain" in names or "place" not in names,
        **options,
    ).values
    data: dict[str, Any] = {"coordinates": table["coordinate"]}
    names = table.get("id", [str(row) for row in range(len(table["coordinate"]))])
    if "id" in table:
        data["ids"] = names
    for column in ("chain", "after"):
        if column in table and table[column][0]:
            raise InvalidData(
                f"{path}: the first row is the start, whose {column} must be empty, got "
                f"{show(table[column][0])}",
                field=column,
            )
    if "chain" in table:
        data["chains"] = _chains(table, names, path)
    if "after" in table:
        rows = {name: row for row, name in enumerate(names)}
        if len(rows) < len(names):
            raise InvalidData(f"{path}: ids must differ, for after to name them", field="ids")
        data["precedence"] = [
            (_row(name, rows, f"{path}: after of stop {names[row]}"), row)
            for row, text in enumerate(table["after"])
            for name in text.split()
        ]
    for column, field in (("load", "loads"), ("service", "service")):
        if column in table:
            data[field] = [value or 0.0 for value in table[column]]
    if "earliest" in table or "latest" in table:
        empty = [None] * len(names)
        early, late = table.get("earliest", empty), table.get("latest", empty)
        data["windows"] = [(a or 0.0, b) for a, b in zip(early, late, strict=True)]
    return data


def _chains(
    table: Mapping[str, list[Any]], names: list[str], path: str | os.PathLike[str]
) -> list[list[int]]:
    """Return the chains in the order of their first rows."""
    members: dict[str, list[int]] = {}
    for row, chain in enumerate(table["chain"]):
        if chain:
            members.setdefault(chain, []).append(row)
    if "place" in table:
        for chain, rows in members.items():
            seen: dict[float, int] = {}
            for row in rows:
                place = table["place"][row]
                if place is None or seen.setdefault(place, row) != row:
                    raise InvalidData(
                        f"{path}: stop {names[row]} of chain {chain} must have a place of its own, got "
                        f"{'nothing' if place is None else f'{place:g}'}",
                        field="place",
                    )
            rows.sort(key=table["place"].__getitem__)
    return list(members.values())


def _row(name: str, rows: Mapping[str, int], where: str) -> int:
    if name not in rows:
        raise InvalidData(f"{where} must name stops, got {show(name)}", field="after")
    return rows[name]


def _read_line(file: Path) -> dict[str, Any]:
    """Return the data of a sequential ordering problem, without the names of its customers."""
    items = read_sop(file).data().items()
    return {key: value for key, value in items if key != "ids" and len(value)}


def resolve_references(data: Mapping[str, Any], find: Find) -> dict[str, Any]:
    """Return instance data with the stops read from their file.

    ``"coordinates": "file.csv"`` refers to a file of stops, ``"sop": "file.sop"`` to a sequential
    ordering problem of TSPLIB on a line.
    """
    result = reference("sop", _read_line, only=True)(data, find)
    return reference("coordinates", read_stops)(result, find)
