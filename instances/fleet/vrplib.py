"""Reader of vehicle routing problems in VRPLIB's format, in the dialects of CVRPLIB, PyVRP and LKH-3.

Sources: the fields that PyVRP reads, https://pyvrp.org/dev/supported_vrplib_fields.html; K. Helsgaun, "An
extension of the Lin-Kernighan-Helsgaun TSP solver", Roskilde University, 2017 (pickup and delivery).
"""

from __future__ import annotations

import os
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...files import as_path
from ...models.fields import Whole, show
from ...models.fleet.data import MOST, Objective
from ...models.fleet.model import FleetRouting
from ..sections import KeywordFile
from .readers import COMMON, read_column, read_distances, read_number

__all__ = ["read_vrplib"]

Floats = NDArray[np.float64]

#: Types of plain capacitated problems, whose files must have demands and a depot.
_PLAIN = ("CVRP", "ACVRP", "DCVRP", "DVRP", "VRP")
_RICH = (
    "CVRPTW", "VRPTW", "HFVRP", "HVRP", "MDVRP", "MDVRPTW", "MTVRP", "MTVRPTW", "MTVRPTWR", "SDVRP",
    "SDVRPTW", "PCVRP", "PCVRPTW", "CPTP", "VRPB", "VRPMPD", "VRPSPD", "VRPSPDTW", "PDPTW",
)  # fmt: skip
#: Numbers of each vehicle, in the head or in a section, and their fields.
_VEHICLES = {
    "VEHICLES_MAX_DISTANCE": "battery",
    "VEHICLES_MAX_DURATION": "max_duration",
    "VEHICLES_MAX_RELOADS": "max_reloads",
    "VEHICLES_FIXED_COST": "fixed_cost",
    "VEHICLES_UNIT_DISTANCE_COST": "distance_cost",
}
_KEYS = (
    COMMON
    | dict.fromkeys(
        (
            "CAPACITY", "VEHICLES", "DISTANCE", "SERVICE_TIME", "CAPACITY_SECTION", "DEMAND_SECTION",
            "LINEHAUL_SECTION", "BACKHAUL_SECTION", "DEPOT_SECTION", "TIME_WINDOW_SECTION",
            "SERVICE_TIME_SECTION", "RELEASE_TIME_SECTION", "PRIZE_SECTION",
            "MUTUALLY_EXCLUSIVE_GROUP_SECTION", "PICKUP_AND_DELIVERY_SECTION", "VEHICLES_DEPOT_SECTION",
            "VEHICLES_RELOAD_DEPOT_SECTION", "VEHICLES_ALLOWED_CLIENTS_SECTION",
            *_VEHICLES, *(f"{key}_SECTION" for key in _VEHICLES),
        ),
        (),
    )
    | {"TYPE": (*_PLAIN, *_RICH)}
)  # fmt: skip
#: Number of vehicles at the end of an instance's name, as in A-n32-k5.
_FLEET = re.compile(r"-k([0-9]{1,4})\b")


def read_vrplib(
    path: str | os.PathLike[str],
    vehicles: int | None = None,
    *,
    rounded: bool = False,
    decimals: int | None = None,
    **fields: Any,
) -> FleetRouting:
    """Read a VRPLIB file as a fleet model.

    The objective is "cost" if the file has costs of vehicles or prizes, else "sum". Travel times are the
    distances. A node with the prize 0 must be visited. A limit on the length of a route (``DISTANCE``)
    becomes `battery`, or `max_duration` if the file has service times. In a file of type ``VRPB`` the
    pickups are `backhauls`. A keyword without a counterpart in the model is refused by name.

    Parameters
    ----------
    path : path-like
        The file, in the dialect of CVRPLIB or PyVRP, or with ``PICKUP_AND_DELIVERY_SECTION`` as LKH-3.
    vehicles : int, optional
        Number of vehicles. The default is ``VEHICLES`` of the file. Without it, the number at the end of
        the name of a capacitated problem, as in ``A-n32-k5``, or the number of nodes for other types.
    rounded : bool
        Whether Euclidean distances are rounded to whole numbers.
    decimals : int, optional
        Number of decimals after which Euclidean distances are truncated, such as 1 for the solutions of
        the DIMACS challenge with time windows. Full precision by default.
    **fields
        Fields of :class:`~crosstrack.models.fleet.FleetRouting` that replace those of the file or are added.

    Returns
    -------
    FleetRouting
        The model; its nodes are those of the file in order.

    Raises
    ------
    InvalidData
        As for :func:`~crosstrack.instances.fleet.read_tsplib`, or capacity, demands, depot or number of
        vehicles are missing, or sections contradict one another. The error names the file.
    """
    file = as_path(path)
    content = KeywordFile.read(file, _KEYS)
    size = content.size(1, MOST)
    data = read_distances(content, rounded, False)
    if decimals is not None and rounded:
        raise InvalidData(
            "decimals must not be given beside rounded=True, which rounds to whole numbers",
            field="decimals",
        )
    if decimals is not None and data.get("costs") is None:
        factor = 10.0 ** Whole(0, 9).coerce("decimals", decimals, {})
        points = data.pop("points")
        lengths = np.hypot(*(points[:, None] - points).transpose(2, 0, 1))
        data = {"points": points, "costs": np.trunc(factor * lengths) / factor}
    count = _count_vehicles(content, size) if vehicles is None else vehicles
    count = Whole(1, MOST).coerce("vehicles", count, {})
    data |= {"vehicles": count, "objective": Objective.SUM}
    data |= _depots(content, count) | _loads(content, size, count) | _times(content, size)
    for key, field in _VEHICLES.items():
        if (values := _per_vehicle(content, key, count)) is not None:
            data[field] = values
    if "DISTANCE" in content.head:
        limit, field = read_number(content, "DISTANCE"), "battery"
        if np.any(data.get("service", 0.0)):
            field = "max_duration"
        data[field] = np.minimum(limit, data.get(field, limit))
    data |= _choices(content, size)
    data |= _allowed(content, size, count)
    if data.keys() & {"fixed_cost", "distance_cost", "prizes"}:
        data["objective"] = Objective.COST
    return FleetRouting.from_data({**data, **fields}, name=file.stem)


def _count_vehicles(content: KeywordFile, size: int) -> float:
    if "VEHICLES" in content.head:
        return read_number(content, "VEHICLES")
    match = _FLEET.search(content.path.stem)
    if not _is_plain(content):
        return max(size - 1, 1)
    if not match:
        raise InvalidData(
            f"{content.path}: vehicles must be given, or be in the file or its name, as in A-n32-k5",
            field="vehicles",
        )
    return int(match[1])


def _is_plain(content: KeywordFile) -> bool:
    """Return whether the type is that of a plain capacitated problem; a file without type is plain."""
    kind = content.head.get("TYPE", "CVRP").partition(" ")[0]
    rich = {"TIME_WINDOW_SECTION", "VEHICLES"} & {*content.sections, *content.head}
    return kind in _PLAIN and ("TYPE" in content.head or not rich)


def _refuse(content: KeywordFile, section: str, rule: str) -> InvalidData:
    return InvalidData(
        f"{content.path}: {section} {rule}", field=section.removesuffix("_SECTION").lower()
    )


def _per_vehicle(content: KeywordFile, key: str, count: int) -> float | Floats | None:
    """Return a number of all vehicles from the head, or a row per vehicle from a section, or None."""
    section = f"{key}_SECTION"
    if section not in content.sections:
        return read_number(content, key) if key in content.head else None
    if key in content.head:
        raise _refuse(content, section, f"must not be given beside {key}")
    return read_column(content, section, (count,), free=key == "CAPACITY")


def _lists(content: KeywordFile, section: str, rows: int | None, most: int) -> list[list[int]]:
    """Return the nodes of each row of a section, counted from 0."""
    entries = content.sections[section]
    if rows is not None and len(entries) != rows:
        raise _refuse(content, section, f"must have {rows} rows, got {len(entries)}")
    result = []
    for row, words in enumerate(entries, 1):
        bad = [w for w in words if not (w.isascii() and w.isdigit() and len(w) < 10)]
        if bad or words[0] != str(row) or not all(1 <= int(w) <= most for w in words[1:]):
            shown = show(" ".join(words[:6]))
            raise _refuse(
                content, section, f"must hold nodes 1 … {most} after row {row}, got {shown}"
            )
        result.append([int(word) - 1 for word in words[1:]])
    return result


def _depots(content: KeywordFile, count: int) -> dict[str, Any]:
    """Return the depots and reloads."""
    assigned, section = "VEHICLES_DEPOT_SECTION", "VEHICLES_RELOAD_DEPOT_SECTION"
    size, several = content.size(1, MOST), assigned in content.sections
    depots = np.zeros(1)
    if "DEPOT_SECTION" in content.sections or _is_plain(content):
        rows = content.sections.get("DEPOT_SECTION", ())
        number = sum(row[0] != "-1" for row in rows) if several else 1
        depots = read_column(content, "DEPOT_SECTION", (number,))
    result: dict[str, Any] = {"depots": depots}
    if several:
        homes = read_column(content, assigned, (count,)) - 1
        if not np.isin(homes, depots).all():
            raise _refuse(content, assigned, "must name nodes of DEPOT_SECTION")
        unused = np.setdiff1d(depots, homes)
        if unused.size:
            raise _refuse(
                content, assigned, f"must use every depot, got none at node {unused[0] + 1:g}"
            )
        result = {"depots": homes}
    if section in content.sections:
        reloads = _lists(content, section, count, size)
        if any(sorted(row) != sorted(reloads[0]) for row in reloads):
            raise _refuse(content, section, "must be the same for all vehicles in this model")
        result["reloads"] = reloads[0]
    return result


def _loads(content: KeywordFile, size: int, count: int) -> dict[str, Any]:
    """Return capacities, demands, pickups and pairs."""
    sections = content.sections
    result: dict[str, Any] = {}
    names = [name for name in ("DEMAND_SECTION", "LINEHAUL_SECTION") if name in sections]
    if len(names) > 1:
        raise _refuse(content, "LINEHAUL_SECTION", "must not be given beside DEMAND_SECTION")
    if names or _is_plain(content):
        demands = names[0] if names else "DEMAND_SECTION"
        result["demands"] = read_column(content, demands, (size,), free=True)
    if "BACKHAUL_SECTION" in sections:
        result["pickups"] = read_column(content, "BACKHAUL_SECTION", (size,), free=True)
        if content.head.get("TYPE", "").startswith("VRPB"):
            result["backhauls"] = True
    if "PICKUP_AND_DELIVERY_SECTION" in sections:
        if result:
            raise _refuse(
                content, "PICKUP_AND_DELIVERY_SECTION", "must not be given beside other demands"
            )
        result = _pairs(content, size)
    if result:
        capacity = _per_vehicle(content, "CAPACITY", count)
        result["capacity"] = read_number(content, "CAPACITY") if capacity is None else capacity
    return result


def _pairs(content: KeywordFile, size: int) -> dict[str, Any]:
    """Return pairs, pickups, windows and service of LKH's pickup and delivery section.

    Its columns are demand, earliest and latest time, service, and the nodes of pickup and delivery, 0 for
    the node itself.
    """
    section = "PICKUP_AND_DELIVERY_SECTION"
    rows = read_column(content, section, (size, 6))
    pairs = []
    for node in np.flatnonzero(rows[:, 5]).tolist():
        other = np.flatnonzero(rows[:, 4] == node + 1)
        if other.tolist() != [rows[node, 5] - 1] or not 0 <= rows[node, 0] == -rows[other[0], 0]:
            raise _refuse(
                content, section, f"must pair node {node + 1} with a delivery of its demand"
            )
        pairs.append([node, int(other[0])])
    if not pairs or np.count_nonzero(rows[:, 4]) != len(pairs):
        raise _refuse(
            content, section, "must hold pairs of nodes, each with a pickup and a delivery"
        )
    return {
        "pairs": pairs,
        "pickups": np.maximum(rows[:, 0], 0.0),
        "windows": rows[:, 1:3],
        "service": rows[:, 3],
    }


def _times(content: KeywordFile, size: int) -> dict[str, Any]:
    """Return windows, service times and releases."""
    result: dict[str, Any] = {}
    paired = "PICKUP_AND_DELIVERY_SECTION"
    if "TIME_WINDOW_SECTION" in content.sections:
        result["windows"] = read_column(content, "TIME_WINDOW_SECTION", (size, 2))
        if paired in content.sections and not np.array_equal(
            result["windows"], read_column(content, paired, (size, 6))[:, 1:3]
        ):
            raise _refuse(content, "TIME_WINDOW_SECTION", f"must equal the windows of {paired}")
    if "SERVICE_TIME_SECTION" in content.sections:
        for other in {"SERVICE_TIME", paired} & {*content.head, *content.sections}:
            raise _refuse(content, "SERVICE_TIME_SECTION", f"must not be given beside {other}")
        result["service"] = read_column(content, "SERVICE_TIME_SECTION", (size,))
    elif "SERVICE_TIME" in content.head and (time := read_number(content, "SERVICE_TIME")) != 0:
        # Depots, also as reloads, have no service.
        service = np.full(size, time)
        service[[node for node in _first_depots(content) if 0 <= node < size]] = 0.0
        result["service"] = service
    if "RELEASE_TIME_SECTION" in content.sections:
        result["releases"] = read_column(content, "RELEASE_TIME_SECTION", (size,))
    return result


def _choices(content: KeywordFile, size: int) -> dict[str, Any]:
    """Return prizes, None for 0, and groups of at least two nodes."""
    result: dict[str, Any] = {}
    prizes = np.zeros(size)
    if "PRIZE_SECTION" in content.sections:
        prizes = read_column(content, "PRIZE_SECTION", (size,))
        result["prizes"] = [prize or None for prize in prizes.tolist()]
    section = "MUTUALLY_EXCLUSIVE_GROUP_SECTION"
    if section in content.sections:
        groups = [group for group in _lists(content, section, None, size) if len(group) > 1]
        if any(prizes[group].any() for group in groups):
            raise _refuse(content, section, "must not hold nodes with prizes")
        result["groups"] = groups
    return result


def _allowed(content: KeywordFile, size: int, count: int) -> dict[str, Any]:
    """Return the skills that express the nodes allowed for each vehicle, one per set of vehicles."""
    section = "VEHICLES_ALLOWED_CLIENTS_SECTION"
    if section not in content.sections:
        return {}
    allowed = np.zeros((count, size), bool)
    for k, nodes in enumerate(_lists(content, section, count, size)):
        allowed[k, nodes] = True
    requires: list[list[str]] = [[] for _ in range(size)]
    skills: list[list[str]] = [[] for _ in range(count)]
    names: dict[bytes, str] = {}
    for node in range(size):
        vehicles = allowed[:, node]
        if vehicles.all() or (not vehicles.any() and node in _first_depots(content)):
            continue
        if vehicles.tobytes() not in names:
            name = names[vehicles.tobytes()] = f"site {len(names) + 1}"
            for k in np.flatnonzero(vehicles).tolist():
                skills[k].append(name)
        requires[node] = [names[vehicles.tobytes()]]
    return {"requires": requires, "skills": skills}


def _first_depots(content: KeywordFile) -> set[int]:
    """Return the nodes of the section of depots, or node 0 without one."""
    rows = content.sections.get("DEPOT_SECTION", [["1"]])
    return {int(float(row[0])) - 1 for row in rows}
