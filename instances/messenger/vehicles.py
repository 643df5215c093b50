"""Vehicles of messenger tours in CSV and Excel files, and instances that refer to such files.

A file has a header with the columns ``x,y`` and any of ``vx,vy``, ``radius`` and ``id``, in any
order. The velocities or the radius are required, because ``x,y`` alone denotes waypoints.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from ...errors import InvalidData
from ...models.fields import show
from ..spreadsheets import read_columns
from ..storage import Find, number

__all__ = ["read_vehicles", "resolve_references"]

_COLUMNS = ("x", "y", "vx", "vy", "radius", "id")
#: Pairs of columns that must occur together.
_PAIRS = (("x", "y"), ("vx", "vy"))


def read_vehicles(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the instance data in a CSV or Excel file of vehicles.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    dict
        ``positions`` (m), and ``velocities`` (m/s), ``radius`` (m) and ``ids`` if the file has
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
    table = read_columns(path, _check_header, _convert, what="vehicles", field="positions")
    data: dict[str, Any] = {"positions": list(zip(table["x"], table["y"], strict=True))}
    if "vx" in table:
        data["velocities"] = list(zip(table["vx"], table["vy"], strict=True))
    if "radius" in table:
        data["radius"] = table["radius"]
    if "id" in table:
        data["ids"] = table["id"]
    return data


def resolve_references(data: Mapping[str, Any], find: Find) -> dict[str, Any]:
    """Return instance data with ``"positions": "file.csv"`` replaced by the content of the file."""
    result = dict(data)
    if isinstance(result.get("positions"), str):
        loaded = read_vehicles(find(result.pop("positions")))
        for key in loaded:
            if key in result:
                raise InvalidData(f"{key} must not be given: the file holds it", field=key)
        result.update(loaded)
    return result


def _check_header(names: list[str], where: str) -> None:
    """Raise ``InvalidData`` if the columns are not those of a file of vehicles."""
    given = set(names)
    halves = any(len(given & set(pair)) == 1 for pair in _PAIRS)
    known = given <= set(_COLUMNS) and len(given) == len(names) and not halves
    if not known or "x" not in given or not given & {"vx", "radius"}:
        raise InvalidData(
            f"{where}: must be a header of vehicles: x,y with vx,vy, radius or both, and id if "
            f"they have names; got {show(','.join(names))}",
            field="header",
        )


def _convert(text: str, where: str, name: str) -> float | str:
    place = f"{where}, column {name}"
    if name != "id":
        return number(text, place, name)
    if not text:
        raise InvalidData(f"{place}: must name the vehicle, got nothing", field=name)
    return text
