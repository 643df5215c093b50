"""Instances of TSPLIB and VRPLIB files, the public collections of tours and of vehicle routes.

Sources: G. Reinelt, "TSPLIB: a traveling salesman problem library", ORSA Journal on Computing 3, 1991;
CVRPLIB, http://vrp.galgos.inf.puc-rio.br.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...files import as_path, read_text
from ...models.fields import Flag, show
from ...models.fleet.data import MOST, Metric, Objective
from ...models.fleet.model import FleetRouting
from ..storage import NUMBER

__all__ = ["read_tsplib", "read_vrplib"]

Floats = NDArray[np.float64]

#: How the numbers of a matrix of distances follow one another.
_FORMATS: dict[str, Callable[[int], Any]] = {
    "FULL_MATRIX": lambda n: np.indices((n, n)).reshape(2, -1),
    "UPPER_ROW": lambda n: np.triu_indices(n, 1),
    "LOWER_ROW": lambda n: np.tril_indices(n, -1),
    "UPPER_DIAG_ROW": np.triu_indices,
    "LOWER_DIAG_ROW": np.tril_indices,
}
#: Sections whose rows begin with the number of a node.
_NUMBERED = ("NODE_COORD", "DISPLAY_DATA", "DEMAND")
#: Keywords that a reader uses, or that cannot change the answer; every other one is refused.
_KEYS = frozenset({
    "NAME", "TYPE", "COMMENT", "DIMENSION", "EDGE_WEIGHT_TYPE", "EDGE_WEIGHT_FORMAT",
    "NODE_COORD_TYPE", "DISPLAY_DATA_TYPE", "NODE_COORD_SECTION", "EDGE_WEIGHT_SECTION",
    "DISPLAY_DATA_SECTION", "EOF",
})  # fmt: skip
_VEHICLE_KEYS = _KEYS | {
    "CAPACITY", "VEHICLES", "DISTANCE", "VEHICLES_MAX_DISTANCE", "SERVICE_TIME", "DEMAND_SECTION",
    "DEPOT_SECTION",
}  # fmt: skip
#: Values of keywords that say what the file is about.
_TYPES = ("TSP", "ATSP")
_VEHICLE_TYPES = ("CVRP", "ACVRP", "DCVRP", "DVRP", "VRP")
_PLANES = ("TWOD_COORDS", "NO_COORDS")
#: Numbers of vehicles that names of instances end in, as in A-n32-k5.
_FLEET = re.compile(r"-k([0-9]{1,4})\b")


def read_tsplib(
    path: str | os.PathLike[str],
    vehicles: int,
    *,
    rounded: bool = False,
    display: bool = False,
    **fields: Any,
) -> FleetRouting:
    """Return routes through the nodes of a TSPLIB file, from its first node.

    Parameters
    ----------
    path : path-like
        The file, with coordinates (``EUC_2D``, ``CEIL_2D``, ``ATT`` or ``GEO``) or a matrix
        (``EXPLICIT``). The distances of all types but ``EUC_2D`` are whole numbers, as TSPLIB
        defines them, and become `costs`.
    vehicles : int
        Number of routes.
    rounded : bool
        Whether distances of coordinates are rounded to whole numbers, as TSPLIB says, rather than
        real.
    display : bool
        Whether the coordinates that are meant for pictures are taken where there is a matrix.
    **fields
        Other fields of :class:`~crosstrack.models.fleet.FleetRouting`, such as ``objective``.

    Raises
    ------
    InvalidData
        Naming the file: no TSPLIB file, numbers that are missing or none, distances of another kind,
        or a keyword that the model does not express, such as ``FIXED_EDGES_SECTION``.
    """
    file = as_path(path)
    held = _read(file, _KEYS, _TYPES)
    return FleetRouting.from_data(
        {**_distances(file, held, rounded, display), "vehicles": vehicles, **fields}, name=file.stem
    )


def read_vrplib(
    path: str | os.PathLike[str],
    vehicles: int | None = None,
    *,
    rounded: bool = False,
    **fields: Any,
) -> FleetRouting:
    """Return the routes of least total length that a VRPLIB file of capacitated vehicles asks for.

    A limit on the length of a route (``DISTANCE``) becomes ``battery``. Files that ask for more, such
    as time windows, service times, backhauls or prizes, are refused by the name of the keyword.

    Parameters
    ----------
    path : path-like
        The file, with capacity, demands and one depot.
    vehicles : int, optional
        Number of vehicles; by default what the file says, or its name ends in, as in ``A-n32-k5``.
    rounded : bool
        Whether distances of coordinates are rounded to whole numbers, rather than real.
    **fields
        Other fields of :class:`~crosstrack.models.fleet.FleetRouting`, such as ``use_all``.

    Raises
    ------
    InvalidData
        Naming the file: as for :func:`read_tsplib`; no capacity, demands or depot, several depots, no
        number of vehicles, or a keyword that the model does not express.
    """
    file = as_path(path)
    held = _read(file, _VEHICLE_KEYS, _VEHICLE_TYPES)
    if held.get("service_time", 0) != 0:
        raise InvalidData(
            f"{file}: SERVICE_TIME must be 0 or absent, got {show(held['service_time'])}: routes have "
            "no durations",
            field="service_time",
        )
    lengths = [held[key] for key in ("distance", "vehicles_max_distance") if key in held]
    if any(isinstance(one, bool) or not isinstance(one, int | float) for one in lengths):
        raise InvalidData(
            f"{file}: DISTANCE must be a number, got {show(lengths[0])}", field="distance"
        )
    size = _size(file, held)
    demands = _column(file, held, "demand", (size,))
    depots = _column(file, held, "depot", (1,))
    capacity = held.get("capacity")
    if isinstance(capacity, bool) or not isinstance(capacity, int | float):
        raise InvalidData(
            f"{file}: CAPACITY must be a number, got {show(capacity)}", field="capacity"
        )
    if vehicles is None:
        named = _FLEET.search(file.stem)
        vehicles = held.get("vehicles", int(named[1]) if named else None)
    if vehicles is None:
        raise InvalidData(
            f"{file}: vehicles must be given, or stand in the file or its name, as in A-n32-k5",
            field="vehicles",
        )
    data = {
        **_distances(file, held, rounded, False),
        "vehicles": vehicles,
        "depots": depots,
        "demands": demands,
        "capacity": capacity,
        "objective": Objective.SUM,
        **({"battery": min(lengths)} if lengths else {}),
        **fields,
    }
    return FleetRouting.from_data(data, name=file.stem)


def _require_known(file: Path, text: str, known: frozenset[str], types: tuple[str, ...]) -> None:
    """Raise unless all keywords of a file are known, and no part follows its end."""
    met: set[str] = set()
    for line in text.splitlines():
        key, sign, value = (part.strip() for part in line.partition(":"))
        words = line.split()
        if not words:
            continue
        if "EOF" in met:
            raise InvalidData(f"{file}: nothing may follow EOF, got {show(words[0])}", field="eof")
        word = key if sign else words[0]
        if not sign and "_SECTION" not in word and word != "EOF":
            continue  # the row of a section
        if word not in known:
            raise InvalidData(
                f"{file}: {word} is not supported, and leaving it out would change the problem",
                field=word.lower(),
            )
        if word in met and word != "COMMENT":
            raise InvalidData(f"{file}: {word} must be there once", field=word.lower())
        met.add(word)
        allowed = {"TYPE": types, "NODE_COORD_TYPE": _PLANES}.get(word)
        if allowed and value.split()[:1] not in [[one] for one in allowed]:
            raise InvalidData(
                f"{file}: {word} must be one of {', '.join(allowed)}, got {show(value)}",
                field=word.lower(),
            )


def _read(file: Path, known: frozenset[str], types: tuple[str, ...]) -> dict[str, Any]:
    """Return what a file says, by the names of its parts in lower case.

    vrplib reads all but matrices, of which it knows two formats: ``matrix`` has their words. It drops
    the numbers of the nodes, which must be 1, 2, …, so they are looked at before.
    """
    from vrplib.parse import parse_vrplib

    kept, words, section, count = list[str](), list[str](), "", 0
    text = read_text(file)
    _require_known(file, text, known, types)
    for line in text.splitlines():
        head = line.split()
        if head and ("_SECTION" in head[0] or head[0] == "EOF"):
            section, count = head[0].partition("_SECTION")[0], 0
        elif head and section == "EDGE_WEIGHT":
            words += head
            continue
        elif head and section in _NUMBERED:
            count += 1
            if head[0] != str(count):
                raise InvalidData(
                    f"{file}: row {count} of {section}_SECTION must begin with {count}, got "
                    f"{show(head[0])}",
                    field=section.lower(),
                )
        if section != "EDGE_WEIGHT":
            kept.append(line)
    try:
        held: dict[str, Any] = dict(parse_vrplib("\n".join(kept), compute_edge_weights=False))
    except Exception as error:  # whatever the parser trips over
        raise InvalidData(f"{file}: no TSPLIB or VRPLIB file: {error}") from None
    return {**held, "matrix": words}


def _size(file: Path, held: dict[str, Any]) -> int:
    size = held.get("dimension")
    if isinstance(size, bool) or not isinstance(size, int) or not 1 <= size <= MOST:
        raise InvalidData(
            f"{file}: DIMENSION must be a whole number from 1 to {MOST}, got {show(size)}",
            field="dimension",
        )
    return size


def _column(file: Path, held: dict[str, Any], name: str, shape: tuple[int, ...]) -> Floats:
    """Return the numbers of a section, which must have `shape`."""
    section = f"{name.upper()}_SECTION"
    try:
        found = np.array(held[name], float)
    except KeyError:
        raise InvalidData(f"{file}: must have a {section}", field=name) from None
    except (TypeError, ValueError) as error:
        raise InvalidData(f"{file}: {section} must hold numbers: {error}", field=name) from None
    if found.shape != shape or not np.isfinite(found).all():
        raise InvalidData(
            f"{file}: {section} must hold {' × '.join(map(str, shape))} finite numbers, got shape "
            f"{found.shape}",
            field=name,
        )
    return found


def _distances(file: Path, held: dict[str, Any], rounded: bool, display: bool) -> dict[str, Any]:
    """Return the points or costs of an instance."""
    whole = Flag().coerce("rounded", rounded, {})
    size, kind = _size(file, held), held.get("edge_weight_type")
    if kind == "EXPLICIT" and not Flag().coerce("display", display, {}):
        return {"costs": _matrix(file, held, size)}
    if kind in _ROUNDED:
        points = _column(file, held, "node_coord", (size, 2))
        costs = _ROUNDED[kind](points)
        np.fill_diagonal(costs, 0.0)
        return {"costs": costs}
    if kind not in ("EUC_2D", "EXPLICIT"):
        names = ", ".join(["EUC_2D", *_ROUNDED])
        raise InvalidData(
            f"{file}: EDGE_WEIGHT_TYPE must be one of {names}, EXPLICIT, got {show(kind)}",
            field="edge_weight_type",
        )
    name = "node_coord" if kind == "EUC_2D" or "node_coord" in held else "display_data"
    metric = Metric.ROUNDED if whole else Metric.EUCLIDEAN
    return {"points": _column(file, held, name, (size, 2)), "metric": metric}


def _ceiled(points: Floats) -> Floats:
    """Return the distances of type ``CEIL_2D``: straight lines, rounded up."""
    apart: Floats = np.ceil(np.hypot(*(points[:, None] - points).transpose(2, 0, 1)))
    return apart


def _pseudo_euclidean(points: Floats) -> Floats:
    """Return the distances of type ``ATT``: lines divided by the root of 10, rounded up."""
    apart: Floats = np.ceil(np.sqrt(np.square(points[:, None] - points).sum(axis=2) / 10.0))
    return apart


def _geographical(points: Floats) -> Floats:
    """Return the distances of type ``GEO`` in km, of points DDD.MM (degrees and minutes).

    TSPLIB computes with pi = 3.141592 and a radius of 6378.388 km, and rounds down after adding 1.
    """
    degrees = np.trunc(points)
    radians = 3.141592 * (degrees + 5.0 * (points - degrees) / 3.0) / 180.0
    latitude, longitude = radians.T
    q1 = np.cos(longitude[:, None] - longitude)
    q2 = np.cos(latitude[:, None] - latitude)
    q3 = np.cos(latitude[:, None] + latitude)
    cosine = 0.5 * ((1.0 + q1) * q2 - (1.0 - q1) * q3)
    apart: Floats = np.floor(6378.388 * np.arccos(np.clip(cosine, -1.0, 1.0)) + 1.0)
    return apart


#: Types of distances that are whole numbers by their definition.
_ROUNDED: dict[str, Callable[[Floats], Floats]] = {
    "CEIL_2D": _ceiled,
    "ATT": _pseudo_euclidean,
    "GEO": _geographical,
}


def _matrix(file: Path, held: dict[str, Any], size: int) -> Floats:
    """Return the distances that the file's numbers write."""
    form, words = held.get("edge_weight_format"), held["matrix"]
    if form not in _FORMATS:
        raise InvalidData(
            f"{file}: EDGE_WEIGHT_FORMAT must be one of {', '.join(_FORMATS)}, got {show(form)}",
            field="edge_weight_format",
        )
    bad = next((word for word in words if not NUMBER.fullmatch(word)), None)
    rows, columns = _FORMATS[form](size)
    if bad is not None or len(words) != len(rows):
        what = f"{len(words)}" if bad is None else show(bad)
        raise InvalidData(
            f"{file}: EDGE_WEIGHT_SECTION must hold {len(rows)} numbers, got {what}", field="costs"
        )
    found = np.zeros((size, size))
    found[rows, columns] = np.array(words, float)
    return found if form == "FULL_MATRIX" else found + np.tril(found, -1).T + np.triu(found, 1).T
