"""Readers of fleet nodes in CSV and Excel files, and of instances that refer to them.

A file has a header with the columns ``x,y`` and any of ``demand`` and ``id``, in any order. The first
row below is node 0, the depot unless the instance names another one.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from ..grid_path.maps import resolve_references as resolve_map
from ..storage import Find, reference
from ..tables import Column, read_table

__all__ = ["read_nodes", "resolve_references"]

_COLUMNS = (
    Column("x"),
    Column("y"),
    Column("demand", optional=True),
    Column("id", field="ids", text=True, optional=True),
)


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
    header = "x,y, with optional demand and id"
    table = read_table(path, _COLUMNS, header, row="node", field="points").values
    data: dict[str, Any] = {"points": list(zip(table["x"], table["y"], strict=True))}
    for name, field in (("demand", "demands"), ("id", "ids")):
        if name in table:
            data[field] = table[name]
    return data


def resolve_references(data: Mapping[str, Any], find: Find) -> dict[str, Any]:
    """Return `data` of an instance after reading its nodes and map from their files.

    ``"points": "file.csv"`` names a file of nodes, ``"map": "rooms.map"`` one of a map, as for
    :func:`~crosstrack.instances.grid_path.maps.resolve_references`.
    """
    return reference("points", read_nodes)(resolve_map(data, find), find)
