"""Nodes of a fleet's routes in CSV and Excel files, and instances that refer to them.

A file has a header with the columns ``x,y`` and any of ``demand`` and ``id``, in any order. The first
row below is node 0, where routes begin unless the instance names another depot.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from ...errors import InvalidData
from ...models.fields import show
from ..grid_path.maps import resolve_references as resolve_map
from ..spreadsheets import read_columns
from ..storage import Find, number

__all__ = ["read_nodes", "resolve_references"]

_NEEDED, _KNOWN = ("x", "y"), ("x", "y", "demand", "id")


def read_nodes(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the data of an instance that a CSV or Excel file of nodes holds.

    Returns
    -------
    dict
        ``points`` (m), and of ``demands`` and ``ids`` what the file has: what
        :class:`~crosstrack.models.fleet.FleetRouting` takes.

    Raises
    ------
    BackendMissing
        It is an Excel file, and openpyxl is not installed.
    InvalidData
        Naming file, line, column and value: columns that are missing, repeat or are not known, a row
        too short or too long, what is no finite number, an id that is empty, a file without nodes.
    """
    table = read_columns(path, _check_header, _converted, what="nodes", field="points")
    found: dict[str, Any] = {"points": list(zip(table["x"], table["y"], strict=True))}
    for name, field in (("demand", "demands"), ("id", "ids")):
        if name in table:
            found[field] = table[name]
    return found


def _check_header(names: list[str], where: str) -> None:
    """Raise where the columns are none of a file of nodes."""
    if not set(_NEEDED) <= set(names) <= set(_KNOWN) or len(set(names)) < len(names):
        raise InvalidData(
            f"{where}: must be a header of nodes: x,y, with demand and id where they have "
            f"any; got {show(','.join(names))}",
            field="header",
        )


def _converted(text: str, where: str, name: str) -> float | str:
    if name != "id":
        return number(text, f"{where}, column {name}", name)
    if not text:
        raise InvalidData(f"{where}: must name the node, got nothing", field="ids")
    return text


def resolve_references(data: Mapping[str, Any], find: Find) -> dict[str, Any]:
    """Return `data` of an instance with its nodes and its map read from their files.

    ``"points": "file.csv"`` names a file of nodes, ``"map": "rooms.map"`` one of a map, as for
    :func:`~crosstrack.instances.grid_path.maps.resolve_references`.
    """
    found = resolve_map(data, find)
    if isinstance(found.get("points"), str):
        held = read_nodes(find(found.pop("points")))
        for key in held:
            if key in found:
                raise InvalidData(f"{key} must not be given: the file holds it", field=key)
        found.update(held)
    return found
