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
        The file, with coordinates (``EUC_2D``) or a matrix (``EXPLICIT``).
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
        Naming the file: no TSPLIB file, numbers that are missing or none, distances of another kind.
    """
    file = as_path(path)
    held = _read(file)
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
        number of vehicles.
    """
    file = as_path(path)
    held = _read(file)
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
        "depots": depots.astype(int),
        "demands": demands,
        "capacity": capacity,
        "objective": Objective.SUM,
        **fields,
    }
    return FleetRouting.from_data(data, name=file.stem)


def _read(file: Path) -> dict[str, Any]:
    """Return what a file says, by the names of its parts in lower case.

    vrplib reads all but matrices, of which it knows two formats: ``matrix`` has their words. It drops
    the numbers of the nodes, which must be 1, 2, …, so they are looked at before.
    """
    from vrplib.parse import parse_vrplib

    kept, words, section, count = list[str](), list[str](), "", 0
    for line in read_text(file).splitlines():
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
    if kind not in ("EUC_2D", "EXPLICIT"):
        raise InvalidData(
            f"{file}: EDGE_WEIGHT_TYPE must be EUC_2D or EXPLICIT, got {show(kind)}",
            field="edge_weight_type",
        )
    name = "node_coord" if kind == "EUC_2D" or "node_coord" in held else "display_data"
    metric = Metric.ROUNDED if whole else Metric.EUCLIDEAN
    return {"points": _column(file, held, name, (size, 2)), "metric": metric}


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
    return found if form == "FULL_MATRIX" else np.maximum(found, found.T)
