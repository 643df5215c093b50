"""Readers of nodes in CSV and Excel files, of TSPLIB files, and of instances that refer to them.

Source: G. Reinelt, "TSPLIB: a traveling salesman problem library", ORSA Journal on Computing 3, 1991.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...files import as_path
from ...models.fields import Flag, show
from ...models.fleet.data import MOST, Metric
from ...models.fleet.model import FleetRouting
from ..grid_path.maps import resolve_references as resolve_map
from ..projection import POSITIONS, has_positions, positions_of
from ..sections import KeywordFile
from ..storage import Find, reference
from ..tables import NUMBER, Column, TableOptions, read_table

__all__ = [
    "COMMON", "read_column", "read_distances", "read_nodes", "read_number", "read_tsplib",
    "resolve_references",
]  # fmt: skip

Floats = NDArray[np.float64]

#: Row and column indices of the numbers in a distance matrix, by format. Columns of one half are rows of the other.
_FORMATS: dict[str, Callable[[int], Any]] = {
    name: indices
    for names, indices in {
        "FULL_MATRIX": lambda n: np.indices((n, n)).reshape(2, -1),
        "UPPER_ROW LOWER_COL": lambda n: np.triu_indices(n, 1),
        "LOWER_ROW UPPER_COL": lambda n: np.tril_indices(n, -1),
        "UPPER_DIAG_ROW LOWER_DIAG_COL": np.triu_indices,
        "LOWER_DIAG_ROW UPPER_DIAG_COL": np.tril_indices,
    }.items()
    for name in names.split()
}
#: Keywords that a reader uses or can ignore, with their supported values; all others are refused.
COMMON: dict[str, tuple[str, ...]] = dict.fromkeys(
    ("NAME", "COMMENT", "DIMENSION", "EDGE_WEIGHT_TYPE", "EDGE_WEIGHT_FORMAT", "DISPLAY_DATA_TYPE",
     "NODE_COORD_SECTION", "EDGE_WEIGHT_SECTION", "DISPLAY_DATA_SECTION"), (),
) | {"NODE_COORD_TYPE": ("TWOD_COORDS", "NO_COORDS")}  # fmt: skip
_KEYS = {**COMMON, "TYPE": ("TSP", "ATSP")}


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
        The file, with coordinates (``EUC_2D``, ``MAN_2D``, ``MAX_2D``, ``CEIL_2D``, ``ATT`` or ``GEO``) or a matrix
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
    content = KeywordFile.read(file, _KEYS)
    return FleetRouting.from_data(
        {**read_distances(content, rounded, display), "vehicles": vehicles, **fields},
        name=file.stem,
    )


def read_number(content: KeywordFile, keyword: str) -> float:
    """Return the number of a keyword."""
    text = content.head.get(keyword)
    if text is None or not NUMBER.fullmatch(text):
        raise InvalidData(
            f"{content.path}: {keyword} must be a number, got {show(text)}", field=keyword.lower()
        )
    return float(text)


def read_column(
    content: KeywordFile, section: str, shape: tuple[int, ...], *, free: bool = False
) -> Floats:
    """Return the numbers of a section without those of the rows; raise unless they have `shape`.

    With `free`, the rows may have several numbers.
    """
    file, field = content.path, section.removesuffix("_SECTION").lower()
    if section not in content.sections:
        raise InvalidData(f"{file}: must have a {section}", field=field)
    rows, first = content.sections[section], section != "DEPOT_SECTION"
    for row, words in enumerate(rows if first else (), 1):
        if words[0] != str(row) and (row, words[0]) != (1, "0"):  # Li and Lim's depot is 0
            raise InvalidData(
                f"{file}: row {row} of {section} must begin with {row}, got {show(words[0])}",
                field=field,
            )
    entries = [words[first:] for words in rows]
    bad = next((word for words in entries for word in words if not NUMBER.fullmatch(word)), None)
    if bad is not None:
        raise InvalidData(f"{file}: {section} must hold numbers, got {show(bad)}", field=field)
    try:
        numbers = np.array(entries, float)
    except ValueError:
        text = f"{file}: {section} must hold rows of equal length"
        raise InvalidData(text, field=field) from None
    if len(shape) == 1 and numbers.shape[-1:] == (1,):
        numbers = numbers[:, 0]
    if free and numbers.ndim == 2:
        shape = (*shape, numbers.shape[1])
    if not first:
        # -1 ends the section, and nodes are counted from 1.
        numbers = numbers[numbers != -1] - 1
    if numbers.shape != shape or not np.isfinite(numbers).all():
        raise InvalidData(
            f"{file}: {section} must hold {' × '.join(map(str, shape))} finite numbers, got shape "
            f"{numbers.shape}",
            field=field,
        )
    return numbers


def read_distances(content: KeywordFile, rounded: bool, display: bool) -> dict[str, Any]:
    """Return the points and metric, or the costs, of an instance."""
    whole = Flag().coerce("rounded", rounded, {})
    size = content.size(1, MOST)
    kind = content.require("EDGE_WEIGHT_TYPE", ("EUC_2D", *_ROUNDED, "EXPLICIT"))
    section = "NODE_COORD_SECTION"
    if kind == "EXPLICIT" and section not in content.sections:
        section = "DISPLAY_DATA_SECTION"
    if kind == "EXPLICIT" and not Flag().coerce("display", display, {}):
        # Damage to unused coordinates can mean damage to the matrix.
        if section in content.sections:
            read_column(content, section, (size, 2))
        return {"costs": _matrix(content, size)}
    points = read_column(content, section, (size, 2))
    if kind in _ROUNDED:
        costs = _ROUNDED[kind](points)
        np.fill_diagonal(costs, 0.0)
        return {"costs": costs}
    return {"points": points, "metric": Metric.ROUNDED if whole else Metric.EUCLIDEAN}


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


#: Types of distances that are defined as whole numbers: rounded, or for ``CEIL_2D`` straight lines rounded up.
_ROUNDED: dict[str, Callable[[Floats], Floats]] = {
    "MAN_2D": lambda points: np.floor(np.abs(points[:, None] - points).sum(axis=2) + 0.5),
    "MAX_2D": lambda points: np.floor(np.abs(points[:, None] - points).max(axis=2) + 0.5),
    "CEIL_2D": lambda points: np.ceil(np.hypot(*(points[:, None] - points).transpose(2, 0, 1))),
    "ATT": _pseudo_euclidean,
    "GEO": _geographical,
}


def _matrix(content: KeywordFile, size: int) -> Floats:
    """Return the distance matrix of the file, shape (size, size)."""
    form = content.require("EDGE_WEIGHT_FORMAT", _FORMATS)
    numbers = content.numbers("EDGE_WEIGHT_SECTION", "costs")
    rows, columns = _FORMATS[form](size)
    if len(numbers) != len(rows):
        raise InvalidData(
            f"{content.path}: EDGE_WEIGHT_SECTION must hold {len(rows)} numbers, got {len(numbers)}",
            field="costs",
        )
    matrix = np.zeros((size, size))
    matrix[rows, columns] = numbers
    is_half = form != "FULL_MATRIX"
    return matrix + np.tril(matrix, -1).T + np.triu(matrix, 1).T if is_half else matrix


_COLUMNS = (
    *POSITIONS,
    Column("demand", free=True, optional=True),
    Column("id", field="ids", text=True, optional=True, aliases=("name",)),
)


def read_nodes(path: str | os.PathLike[str], **options: Unpack[TableOptions]) -> dict[str, Any]:
    """Read the nodes in a CSV or Excel file.

    Positions are ``x,y`` in metres or with a unit, or ``lat,lon`` in degrees, which are projected: see
    :func:`~crosstrack.instances.project_positions`.

    Parameters
    ----------
    path : path-like
        The file.
    **options
        Map of columns, encoding and sheet, see :class:`~crosstrack.instances.TableOptions`.

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
        or unknown columns, a row of another length, a number that is not finite, an empty id, nodes
        that are too far apart to be projected, or a file without nodes.
    """
    table = read_table(
        path,
        _COLUMNS,
        "x,y, or lat,lon in degrees, with optional demand and id",
        row="node",
        field="points",
        suits=has_positions,
        **options,
    ).values
    data: dict[str, Any] = {"points": positions_of(table, str(path), options.get("columns") or ())}
    for name, field in (("demand", "demands"), ("id", "ids")):
        if name in table:
            data[field] = table[name]
    return data


def table_file(file: Path, *, depots: Any = 0, **options: Unpack[TableOptions]) -> dict[str, Any]:
    """Return the data of an instance from a file of nodes; `depots` are rows or ids."""
    data = read_nodes(file, **options)
    names = [depots] if isinstance(depots, str) else depots
    if isinstance(names, list) and any(isinstance(name, str) for name in names):
        ids = data.get("ids", [])
        for name in names:
            if ids.count(name) != 1:
                text = f"{file}: depots must be ids of one node each, got {show(name)}"
                raise InvalidData(text, field="depots")
        depots = [ids.index(name) for name in names]
    return {**data, "depots": depots}


def resolve_references(data: Mapping[str, Any], find: Find) -> dict[str, Any]:
    """Return `data` of an instance after reading its nodes and map from their files.

    ``"points": "file.csv"`` names a file of nodes, ``"map": "rooms.map"`` one of a map, as for
    :func:`~crosstrack.instances.grid_path.maps.resolve_references`.
    """
    return reference("points", read_nodes)(resolve_map(data, find), find)
