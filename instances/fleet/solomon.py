"""Reader of vehicle routing problems with time windows in the form of Solomon, and of Gehring and Homberger.

Source: M. M. Solomon, "Algorithms for the vehicle routing and scheduling problems with time window
constraints", Operations Research 35, 1987.
"""

from __future__ import annotations

import os
import re
from typing import Any

import numpy as np

from ...errors import InvalidData
from ...files import as_path, read_text
from ...models.fleet.data import Objective
from ...models.fleet.model import FleetRouting
from ..tables import number

__all__ = ["read_solomon"]

#: Columns of the customers: number, position, demand, begin and end of the window, service.
_COLUMNS = 7
#: The head of the file: its name, the number of vehicles and their capacity.
_HEAD = re.compile(
    r"\s*[^\n]*\s+VEHICLE\s+NUMBER\s+CAPACITY\s+(?P<vehicles>\S+)\s+(?P<capacity>\S+)\s+CUSTOMER\s+"
    r"CUST\s+NO\.\s+XCOORD\.\s+YCOORD\.\s+DEMAND\s+READY\s+TIME\s+DUE\s+DATE\s+SERVICE(?:\s+TIME)?[ \t\r]*\n"
)


def read_solomon(path: str | os.PathLike[str], **fields: Any) -> FleetRouting:
    """Return the routing problem in a file of Solomon (``c101.txt``) or of Gehring and Homberger.

    The first customer is the depot, whose window limits departures and returns. Travel times are the Euclidean
    distances in full precision, and the objective is their sum. The literature minimises the number of vehicles
    first; a `fixed_cost` above every possible sum, with the objective ``"cost"``, has the same effect.

    Parameters
    ----------
    path : path-like
        The file.
    **fields
        Other fields of :class:`~crosstrack.models.fleet.FleetRouting`, such as ``vehicles``.

    Returns
    -------
    FleetRouting
        The model; its nodes are the rows of the file in order.

    Raises
    ------
    InvalidData
        The head or a row is malformed, or the numbers of the rows are not 0, 1, 2 …. The message names the
        file, and the line if it applies.
    """
    file = as_path(path)
    text = read_text(file)
    head = _HEAD.match(text)
    if head is None:
        raise InvalidData(
            f"{file}, line 1: must be a name, VEHICLE with NUMBER and CAPACITY, and CUSTOMER with "
            f"{_COLUMNS} columns",
            field="line",
        )
    rows = []
    start = text.count("\n", 0, head.end()) + 1
    for line, row in enumerate(text[head.end() :].splitlines(), start):
        words = row.split()
        if words:
            place = f"{file}, line {line}"
            if len(words) != _COLUMNS:
                raise InvalidData(
                    f"{place}: must have {_COLUMNS} numbers, got {len(words)}", field="line"
                )
            rows.append([number(word, place, "line") for word in words])
            if rows[-1][0] != len(rows) - 1:
                raise InvalidData(
                    f"{place}: must be customer {len(rows) - 1}, got {words[0]}", field="line"
                )
    if not rows:
        raise InvalidData(f"{file}: must have customers, got none", field="line")
    table = np.array(rows)
    data = {
        "vehicles": number(head["vehicles"], f"{file}, NUMBER", "vehicles"),
        "capacity": number(head["capacity"], f"{file}, CAPACITY", "capacity"),
        "objective": Objective.SUM,
        "points": table[:, 1:3],
        "demands": table[:, 3],
        "windows": table[:, 4:6].tolist(),
        "service": table[:, 6],
    }
    return FleetRouting.from_data({**data, **fields}, name=file.stem)
