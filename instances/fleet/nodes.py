"""Readers of fleet nodes in CSV and Excel files, and of instances that refer to them.

A file has a header with the columns ``x,y`` and any of ``demand`` and ``id``, in any order. The first
row below is node 0, the depot unless the instance names another one.
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
    """Read the nodes in a CSV or Excel file.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    dict
        Fields of :class:`~crosstrack.models.fleet.FleetRouting`: ``points`` (m), and ``demands`` and
        ``ids`` if the file has these columns.

    Raises
    ------
    BackendMissing
        It is an Excel file, and openpyxl is not installed.
    InvalidData
        The file is invalid; the error names file, line, column and value. Examples: missing, repeated
        or unknown columns, a row of another length, a number that is not finite, an empty id, or a
        file without nodes.
    """
    table = read_columns(path, _check_header, _convert, what="nodes", field="points")
    data: dict[str, Any] = {"points": list(zip(table["x"], table["y"], strict=True))}
    for name, field in (("demand", "demands"), ("id", "ids")):
        if name in table:
            data[field] = table[name]
    return data


def _check_header(names: list[str], where: str) -> None:
    """Raise unless the columns are those of a file of nodes."""
    if not set(_NEEDED) <= set(names) <= set(_KNOWN) or len(set(names)) < len(names):
        raise InvalidData(
            f"{where}: must be a header of nodes: x,y, with optional demand and id; "
            f"got {show(','.join(names))}",
            field="header",
        )


def _convert(text: str, where: str, name: str) -> float | str:
    if name != "id":
        return number(text, f"{where}, column {name}", name)
    if not text:
        raise InvalidData(f"{where}: must name the node, got nothing", field="ids")
    return text


def resolve_references(data: Mapping[str, Any], find: Find) -> dict[str, Any]:
    """Return `data` of an instance after reading its nodes and map from their files.

    ``"points": "file.csv"`` names a file of nodes, ``"map": "rooms.map"`` one of a map, as for
    :func:`~crosstrack.instances.grid_path.maps.resolve_references`.
    """
    result = resolve_map(data, find)
    if isinstance(result.get("points"), str):
        nodes = read_nodes(find(result.pop("points")))
        for key in nodes:
            if key in result:
                raise InvalidData(f"{key} must not be given: the file holds it", field=key)
        result.update(nodes)
    return result
