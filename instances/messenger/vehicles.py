"""Vehicles of messenger tours in CSV and Excel files, and instances that refer to such files.

A file has a header with the columns ``x,y`` and any of ``vx,vy``, ``radius``, ``id``, ``earliest`` and
``latest``, in any order. The velocities or the radius are required, because ``x,y`` alone denotes
waypoints. Empty cells of ``earliest`` and ``latest`` are no limit.
"""

from __future__ import annotations

import os
from typing import Any, Unpack

from ..storage import reference
from ..tables import Column, TableOptions, read_table
from ..units import LENGTHS, SPEEDS, TIMES

__all__ = ["read_vehicles", "resolve_references"]

_COLUMNS = (
    Column("x", units=LENGTHS, bare=True),
    Column("y", units=LENGTHS, bare=True),
    *(Column(name, units=SPEEDS, bare=True, optional=True) for name in ("vx", "vy")),
    Column("radius", units=LENGTHS, bare=True, optional=True),
    Column("id", field="ids", text=True, optional=True, aliases=("name",)),
    *(
        Column(name, field="windows", units=TIMES, bare=True, empty=True, optional=True)
        for name in ("earliest", "latest")
    ),
)


def read_vehicles(path: str | os.PathLike[str], **options: Unpack[TableOptions]) -> dict[str, Any]:
    """Return the instance data in a CSV or Excel file of vehicles.

    Parameters
    ----------
    path : path-like
        The file.
    **options
        Map of columns, encoding and sheet, see :class:`~crosstrack.instances.TableOptions`.

    Returns
    -------
    dict
        ``positions`` (m), and ``velocities`` (m/s), ``radius`` (m), ``ids`` and ``windows`` (s) if the file has
        them: the arguments of :class:`~crosstrack.models.messenger.MessengerTour`.

    Raises
    ------
    BackendMissing
        The file is an Excel file, and openpyxl is not installed.
    InvalidData
        A column is missing, repeated or unknown, a row has a wrong length, a value is not a finite
        number, an id is empty, or the file has no vehicles. The message contains file, line, column
        and value.
    """
    table = read_table(
        path,
        _COLUMNS,
        "x,y with vx,vy, radius or both, id if they have names, and earliest and latest for time windows",
        row="vehicle",
        field="positions",
        suits=lambda names: ("vx" in names) == ("vy" in names) and bool(names & {"vx", "radius"}),
        **options,
    ).values
    data: dict[str, Any] = {"positions": list(zip(table["x"], table["y"], strict=True))}
    if "vx" in table:
        data["velocities"] = list(zip(table["vx"], table["vy"], strict=True))
    if "radius" in table:
        data["radius"] = table["radius"]
    if "id" in table:
        data["ids"] = table["id"]
    if "earliest" in table or "latest" in table:
        empty = [None] * len(table["x"])
        early, late = table.get("earliest", empty), table.get("latest", empty)
        data["windows"] = [(a or 0.0, b) for a, b in zip(early, late, strict=True)]
    return data


#: Replaces ``"positions": "file.csv"`` in an instance by the vehicles in the file.
resolve_references = reference("positions", read_vehicles)
