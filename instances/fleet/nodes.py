"""Nodes of a fleet's routes in CSV and Excel files, and instances that refer to them.

A file has a header with the columns ``x,y`` and any of ``demand`` and ``id``, in any order. The first
row below is node 0, where routes begin unless the instance names another depot.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from ...errors import InvalidData
from ...files import as_path
from ...models.fields import show
from ..spreadsheets import table_rows
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
    file = as_path(path)
    rows = table_rows(file)
    line, header = next(rows, (1, []))
    names = [name.strip().lstrip("# ").casefold() for name in header]
    if not set(_NEEDED) <= set(names) <= set(_KNOWN) or len(set(names)) < len(names):
        raise InvalidData(
            f"{file}, line {line}: must be a header of nodes: x,y, with demand and id where they have "
            f"any; got {show(','.join(names))}",
            field="header",
        )
    table: dict[str, list[Any]] = {name: [] for name in names}
    for line, values in rows:
        where = f"{file}, line {line}"
        if len(values) != len(names):
            raise InvalidData(
                f"{where}: {len(values)} values where the header has {len(names)}: "
                f"{show(','.join(values))}",
                field="points",
            )
        for name, value in zip(names, values, strict=True):
            if name == "id" and not value:
                raise InvalidData(f"{where}: must name the node, got nothing", field="ids")
            held = value if name == "id" else number(value, f"{where}, column {name}", name)
            table[name].append(held)
    if not table["x"]:
        raise InvalidData(f"{file}: no nodes below the header", field="points")
    found: dict[str, Any] = {"points": list(zip(table["x"], table["y"], strict=True))}
    for name, field in (("demand", "demands"), ("id", "ids")):
        if name in table:
            found[field] = table[name]
    return found


def resolve_references(data: Mapping[str, Any], find: Find) -> dict[str, Any]:
    """Return `data` of an instance with ``"points": "file.csv"`` replaced by the content."""
    found = dict(data)
    if isinstance(found.get("points"), str):
        held = read_nodes(find(found.pop("points")))
        for key in held:
            if key in found:
                raise InvalidData(f"{key} must not be given: the file holds it", field=key)
        found.update(held)
    return found
