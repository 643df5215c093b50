"""Public instances of the Dubins travelling salesman problem with neighbourhoods.

Each line of a file contains the centre and the radius of a disc, ``x y radius``. The third number
in the file's name is the turning radius, in hundredths. Tours are closed, all discs are at rest,
and the start is free. Source: https://github.com/comrob/OptimalDTSPN.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from ...errors import InvalidData
from ...files import as_path, read_text
from ...models.fields import show
from ...models.messenger.model import MessengerTour
from ..tables import Column, numbers, read_table

__all__ = ["read_best_known", "read_dtspn"]

_NAME = re.compile(r"dtspn-[0-9]+-[0-9]+-([0-9]+)-[0-9]+")
_COLUMNS = ("x", "y", "radius")


def read_dtspn(
    path: str | os.PathLike[str], *, turning_radius: float | None = None, **fields: Any
) -> MessengerTour:
    """Return the closed tour over the discs in a file, for a UAV with a speed of 1 m/s.

    Parameters
    ----------
    path : path-like
        The file, such as ``dtspn-06-01-025-0.txt``.
    turning_radius : float, optional
        Turning radius, in m. Default: the value in the file's name, 0.25 in the example.
    **fields
        Other fields of the model, such as ``speed`` (m/s).

    Returns
    -------
    MessengerTour
        The model.

    Raises
    ------
    InvalidData
        A value is not a finite number, a radius is negative, a line does not have three numbers,
        the file is empty, or the name contains no turning radius. The message contains file, line
        and value.
    """
    file = as_path(path)
    if turning_radius is None:
        match = _NAME.fullmatch(file.stem)
        if match is None:
            raise InvalidData(
                f"{file}: turning_radius must be given, or be in the name in hundredths as in "
                "dtspn-06-01-025-0.txt",
                field="turning_radius",
            )
        turning_radius = int(match[1]) / 100
    rows = []
    for line, text in enumerate(read_text(file).splitlines(), start=1):
        values = text.split()
        if not values:
            continue
        where = f"{file}, line {line}"
        if len(values) != len(_COLUMNS):
            raise InvalidData(
                f"{where}: must be x y radius, got {len(values)} values: {show(text)}", field="line"
            )
        rows.append(numbers(values, _COLUMNS, where))
        if rows[-1][2] < 0:
            raise InvalidData(
                f"{where}, column radius: must be >= 0, got {show(values[2])}", field="radius"
            )
    if not rows:
        raise InvalidData(f"{file}: must hold at least one line x y radius", field="positions")
    data = {
        "positions": [row[:2] for row in rows],
        "radius": [row[2] for row in rows],
        "speed": 1.0,
        "turning_radius": turning_radius,
        "start": None,
        "closed": True,
        **fields,
    }
    return MessengerTour.from_data(data, name=file.stem)


def read_best_known(path: str | os.PathLike[str]) -> dict[str, tuple[float, float]]:
    """Return the published bounds in a CSV file with the columns ``instance``, ``LB`` and ``UB``.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    dict of str to (float, float)
        Lower and upper bound (m) by the name of the instance, without ``.txt``.

    Raises
    ------
    InvalidData
        A column is missing, a value is not a finite number, a name repeats, or a lower bound
        exceeds the upper one. The message contains file, line and value.
    """
    columns = (Column("instance", text=True), Column("lb", field="LB"), Column("ub", field="UB"))
    header = "instance,LB,UB among other columns"
    table = read_table(path, columns, header, row="bound", field="instance", strict=False)
    bounds: dict[str, tuple[float, float]] = {}
    for *row, where in zip(*table.values.values(), table.places, strict=True):
        entry = dict(zip(table.values, row, strict=True))
        name, lower, upper = Path(entry["instance"]).stem, entry["lb"], entry["ub"]
        if not name or name in bounds:
            raise InvalidData(
                f"{where}: instance must be a name that no other line has, got {show(name)}",
                field="instance",
            )
        if lower > upper:
            raise InvalidData(f"{where}: LB must be <= UB = {upper!r}, got {lower!r}", field="LB")
        bounds[name] = (lower, upper)
    return bounds
