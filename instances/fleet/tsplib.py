"""Readers of TSPLIB and VRPLIB files, the public collections of tours and vehicle routes.

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
from ..tables import NUMBER

__all__ = ["read_tsplib", "read_vrplib"]

Floats = NDArray[np.float64]

#: Row and column indices of the numbers in a distance matrix, by format.
_FORMATS: dict[str, Callable[[int], Any]] = {
    "FULL_MATRIX": lambda n: np.indices((n, n)).reshape(2, -1),
    "UPPER_ROW": lambda n: np.triu_indices(n, 1),
    "LOWER_ROW": lambda n: np.tril_indices(n, -1),
    "UPPER_DIAG_ROW": np.triu_indices,
    "LOWER_DIAG_ROW": np.tril_indices,
}
#: Sections whose rows begin with the number of a node.
_NUMBERED = ("NODE_COORD", "DISPLAY_DATA", "DEMAND")
#: Keywords that a reader uses or can ignore; all others are refused.
_KEYS = frozenset({
    "NAME", "TYPE", "COMMENT", "DIMENSION", "EDGE_WEIGHT_TYPE", "EDGE_WEIGHT_FORMAT",
    "NODE_COORD_TYPE", "DISPLAY_DATA_TYPE", "NODE_COORD_SECTION", "EDGE_WEIGHT_SECTION",
    "DISPLAY_DATA_SECTION", "EOF",
})  # fmt: skip
_VEHICLE_KEYS = _KEYS | {
    "CAPACITY", "VEHICLES", "DISTANCE", "VEHICLES_MAX_DISTANCE", "SERVICE_TIME", "DEMAND_SECTION",
    "DEPOT_SECTION",
}  # fmt: skip
#: Supported values of keywords.
_TYPES = ("TSP", "ATSP")
_VEHICLE_TYPES = ("CVRP", "ACVRP", "DCVRP", "DVRP", "VRP")
_PLANES = ("TWOD_COORDS", "NO_COORDS")
#: Number of vehicles at the end of an instance's name, as in A-n32-k5.
_FLEET = re.compile(r"-k([0-9]{1,4})\b")


def read_tsplib(
    path: str | os.PathLike[str],
    vehicles: int,
    *,
    rounded: bool = False,
    display: bool = False,
    **fields: Any,
) -> FleetRouting:
    """Read a TSPLIB file as a fleet model whose depot is the first node.

    Parameters
    ----------
    path : path-like
        The file, with coordinates (``EUC_2D``, ``CEIL_2D``, ``ATT`` or ``GEO``) or a matrix
        (``EXPLICIT``). The distances of all types but ``EUC_2D`` are whole numbers, as TSPLIB
        defines them, and become `costs`.
    vehicles : int
        Number of routes.
    rounded : bool
        Whether Euclidean distances are rounded to whole numbers, as TSPLIB defines them.
    display : bool
        Whether to use the display coordinates instead of a given matrix.
    **fields
        Other fields of :class:`~crosstrack.models.fleet.FleetRouting`, such as ``objective``.

    Returns
    -------
    FleetRouting
        The model.

    Raises
    ------
    InvalidData
        The file is not a TSPLIB file, numbers are missing or invalid, the type of distances is not
        supported, or a keyword such as ``FIXED_EDGES_SECTION`` does not fit the model. The error
        names the file.
    """
    file = as_path(path)
    sections = _read(file, _KEYS, _TYPES)
    return FleetRouting.from_data(
        {**_distances(file, sections, rounded, display), "vehicles": vehicles, **fields},
        name=file.stem,
    )


def read_vrplib(
    path: str | os.PathLike[str],
    vehicles: int | None = None,
    *,
    rounded: bool = False,
    **fields: Any,
) -> FleetRouting:
    """Read a VRPLIB file of capacitated vehicles as a fleet model with the objective "sum".

    A limit on the length of a route (``DISTANCE``) becomes ``battery``. Files with other features,
    such as time windows, service times, backhauls or prizes, are refused; the error names the keyword.

    Parameters
    ----------
    path : path-like
        The file, with capacity, demands and one depot.
    vehicles : int, optional
        Number of vehicles; by default as in the file or at the end of its name, as in ``A-n32-k5``.
    rounded : bool
        Whether Euclidean distances are rounded to whole numbers.
    **fields
        Other fields of :class:`~crosstrack.models.fleet.FleetRouting`, such as ``use_all``.

    Returns
    -------
    FleetRouting
        The model.

    Raises
    ------
    InvalidData
        As for :func:`read_tsplib`, or capacity, demands, depot or number of vehicles are missing, or
        there are several depots. The error names the file.
    """
    file = as_path(path)
    sections = _read(file, _VEHICLE_KEYS, _VEHICLE_TYPES)
    if sections.get("service_time", 0) != 0:
        raise InvalidData(
            f"{file}: SERVICE_TIME must be 0 or absent, got {show(sections['service_time'])}: routes have "
            "no durations",
            field="service_time",
        )
    lengths = [sections[key] for key in ("distance", "vehicles_max_distance") if key in sections]
    if any(isinstance(value, bool) or not isinstance(value, int | float) for value in lengths):
        raise InvalidData(
            f"{file}: DISTANCE must be a number, got {show(lengths[0])}", field="distance"
        )
    size = _size(file, sections)
    demands = _column(file, sections, "demand", (size,))
    depots = _column(file, sections, "depot", (1,))
    capacity = sections.get("capacity")
    if isinstance(capacity, bool) or not isinstance(capacity, int | float):
        raise InvalidData(
            f"{file}: CAPACITY must be a number, got {show(capacity)}", field="capacity"
        )
    if vehicles is None:
        match = _FLEET.search(file.stem)
        vehicles = sections.get("vehicles", int(match[1]) if match else None)
    if vehicles is None:
        raise InvalidData(
            f"{file}: vehicles must be given, or be in the file or its name, as in A-n32-k5",
            field="vehicles",
        )
    data = {
        **_distances(file, sections, rounded, False),
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
    """Raise unless all keywords of the file are known and EOF is the last one."""
    keywords: set[str] = set()
    for line in text.splitlines():
        key, sign, value = (part.strip() for part in line.partition(":"))
        words = line.split()
        if not words:
            continue
        if "EOF" in keywords:
            raise InvalidData(f"{file}: nothing may follow EOF, got {show(words[0])}", field="eof")
        word = key if sign else words[0]
        if not sign and "_SECTION" not in word and word != "EOF":
            continue  # the row of a section
        if word not in known:
            raise InvalidData(
                f"{file}: {word} is not supported, and leaving it out would change the problem",
                field=word.lower(),
            )
        if word in keywords and word != "COMMENT":
            raise InvalidData(f"{file}: {word} must be there once", field=word.lower())
        keywords.add(word)
        allowed = {"TYPE": types, "NODE_COORD_TYPE": _PLANES}.get(word)
        if allowed and value.split()[:1] not in [[name] for name in allowed]:
            raise InvalidData(
                f"{file}: {word} must be one of {', '.join(allowed)}, got {show(value)}",
                field=word.lower(),
            )


def _read(file: Path, known: frozenset[str], types: tuple[str, ...]) -> dict[str, Any]:
    """Return the content of a file by the lower-case names of its parts.

    vrplib reads everything except matrices, as it supports only two formats; ``matrix`` holds the
    words of that section. vrplib ignores the node numbers, so this function checks that they are
    1, 2, ….
    """
    from vrplib.parse import parse_vrplib

    lines, words, section, count = list[str](), list[str](), "", 0
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
            lines.append(line)
    try:
        sections: dict[str, Any] = dict(parse_vrplib("\n".join(lines), compute_edge_weights=False))
    except Exception as error:  # the parser raises errors of many types
        raise InvalidData(f"{file}: no TSPLIB or VRPLIB file: {error}") from None
    return {**sections, "matrix": words}


def _size(file: Path, sections: dict[str, Any]) -> int:
    size = sections.get("dimension")
    if isinstance(size, bool) or not isinstance(size, int) or not 1 <= size <= MOST:
        raise InvalidData(
            f"{file}: DIMENSION must be a whole number from 1 to {MOST}, got {show(size)}",
            field="dimension",
        )
    return size


def _column(file: Path, sections: dict[str, Any], name: str, shape: tuple[int, ...]) -> Floats:
    """Return the numbers of a section; raise unless they have `shape`."""
    section = f"{name.upper()}_SECTION"
    try:
        numbers = np.array(sections[name], float)
    except KeyError:
        raise InvalidData(f"{file}: must have a {section}", field=name) from None
    except (TypeError, ValueError) as error:
        raise InvalidData(f"{file}: {section} must hold numbers: {error}", field=name) from None
    if numbers.shape != shape or not np.isfinite(numbers).all():
        raise InvalidData(
            f"{file}: {section} must hold {' × '.join(map(str, shape))} finite numbers, got shape "
            f"{numbers.shape}",
            field=name,
        )
    return numbers


def _distances(
    file: Path, sections: dict[str, Any], rounded: bool, display: bool
) -> dict[str, Any]:
    """Return the points and metric, or the costs, of an instance."""
    whole = Flag().coerce("rounded", rounded, {})
    size, kind = _size(file, sections), sections.get("edge_weight_type")
    if kind == "EXPLICIT" and not Flag().coerce("display", display, {}):
        return {"costs": _matrix(file, sections, size)}
    if kind in _ROUNDED:
        points = _column(file, sections, "node_coord", (size, 2))
        costs = _ROUNDED[kind](points)
        np.fill_diagonal(costs, 0.0)
        return {"costs": costs}
    if kind not in ("EUC_2D", "EXPLICIT"):
        names = ", ".join(["EUC_2D", *_ROUNDED])
        raise InvalidData(
            f"{file}: EDGE_WEIGHT_TYPE must be one of {names}, EXPLICIT, got {show(kind)}",
            field="edge_weight_type",
        )
    name = "node_coord" if kind == "EUC_2D" or "node_coord" in sections else "display_data"
    metric = Metric.ROUNDED if whole else Metric.EUCLIDEAN
    return {"points": _column(file, sections, name, (size, 2)), "metric": metric}


def _ceiled(points: Floats) -> Floats:
    """Return the distances of type ``CEIL_2D``: straight lines, rounded up."""
    distances: Floats = np.ceil(np.hypot(*(points[:, None] - points).transpose(2, 0, 1)))
    return distances


def _pseudo_euclidean(points: Floats) -> Floats:
    """Return the distances of type ``ATT``: lines divided by the root of 10, rounded up."""
    distances: Floats = np.ceil(np.sqrt(np.square(points[:, None] - points).sum(axis=2) / 10.0))
    return distances


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
    distances: Floats = np.floor(6378.388 * np.arccos(np.clip(cosine, -1.0, 1.0)) + 1.0)
    return distances


#: Types of distances that are defined as whole numbers.
_ROUNDED: dict[str, Callable[[Floats], Floats]] = {
    "CEIL_2D": _ceiled,
    "ATT": _pseudo_euclidean,
    "GEO": _geographical,
}


def _matrix(file: Path, sections: dict[str, Any], size: int) -> Floats:
    """Return the distance matrix of the file, shape (size, size)."""
    form, words = sections.get("edge_weight_format"), sections["matrix"]
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
    matrix = np.zeros((size, size))
    matrix[rows, columns] = np.array(words, float)
    return (
        matrix if form == "FULL_MATRIX" else matrix + np.tril(matrix, -1).T + np.triu(matrix, 1).T
    )
