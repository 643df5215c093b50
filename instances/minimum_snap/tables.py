"""CSV files of numbers: samples of a trajectory, waypoints, and recognition of file types."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...files import as_path
from ...models.fields import Whole, required, show
from ...models.minimum_snap.trajectory import Trajectory
from ..exports import ExportFormat
from ..storage import reference
from ..tables import NUMBER, numbers, table_rows, write_rows

__all__ = [
    "SAMPLES",
    "Samples",
    "numeric_rows",
    "read_samples",
    "read_waypoints",
    "resolve_references",
    "sample_columns",
    "write_samples",
]

Floats = NDArray[np.float64]

#: Largest number of axes, and of derivatives, in a table.
MOST_COLUMNS = 1000
_AXES = ("x", "y", "z", "yaw")
_PREFIXES = ("", "v", "a", "j", "s")
#: Allowed headers of waypoint files.
_HEADERS = (_AXES, ("px", "py", "pz"), ("east", "north", "up"), ("e", "n", "u"))


def numeric_rows(path: str | os.PathLike[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield line and cells of every row with a value, without the comma at the end of a row.

    Several tools write such a comma. Spreadsheets write rows of commas below a table: they are skipped,
    as by every reader of tables.
    """
    for line, cells in table_rows(path):
        yield line, cells[:-1] if len(cells) > 1 and not cells[-1] else cells


# -- samples -----------------------------------------------------------------------------------------


class Samples(NamedTuple):
    """Samples of a trajectory.

    Parameters
    ----------
    times : ndarray, shape (n,)
        Times of the samples, s.
    values : ndarray, shape (derivatives + 1, n, dimensions)
        ``values[j]`` is derivative j: position, velocity, …
    """

    times: Floats
    values: Floats


def sample_columns(dimensions: int, derivatives: int = 4) -> tuple[str, ...]:
    """Return the header of a file of samples: ``t, x, y, z, vx, vy, vz, ax, …, jx, …, sx, …``.

    Parameters
    ----------
    dimensions : int
        Number of axes. Up to 4 axes are named x, y, z, yaw; more are numbered, x0, x1, …
    derivatives : int
        Highest order of a derivative, 4 by default. Above snap, names are d5x, d6x, …
    """
    dimensions = Whole(1, MOST_COLUMNS).coerce("dimensions", dimensions, {})
    derivatives = Whole(0, MOST_COLUMNS).coerce("derivatives", derivatives, {})
    axes = _AXES[:dimensions] if dimensions <= 4 else [f"x{axis}" for axis in range(dimensions)]
    prefixes = [*_PREFIXES, *(f"d{order}" for order in range(5, derivatives + 1))]
    return ("t", *(p + axis for p in prefixes[: derivatives + 1] for axis in axes))


def write_samples(
    trajectory: Trajectory,
    path: str | os.PathLike[str],
    *,
    rate: float = 100.0,
    derivatives: int = 4,
) -> Path:
    """Write samples of a trajectory at equal time steps atomically as CSV.

    Parameters
    ----------
    trajectory : Trajectory
        Trajectory to write.
    path : path-like
        Path of the file.
    rate : float
        Samples per second (Hz), 100 by default. The last knot is always included.
    derivatives : int
        Highest order of a written derivative; 4, snap, by default.

    Returns
    -------
    Path
        Path of the written file.

    Raises
    ------
    InvalidData
        `rate` is not positive or yields too many samples, `derivatives` is not a non-negative
        integer, or the file cannot be written.
    """
    required("trajectory", trajectory, Trajectory)
    rows = trajectory.sampled(rate, derivatives)
    header = sample_columns(trajectory.dimensions, derivatives)
    return write_rows(path, header, (rows + 0.0).tolist())


def read_samples(path: str | os.PathLike[str]) -> Samples:
    """Read the exact samples from a file of :func:`write_samples`.

    Parameters
    ----------
    path : path-like
        Path of the file.

    Returns
    -------
    Samples

    Raises
    ------
    InvalidData
        The header or the length of a row is wrong, a number is not finite, times do not increase, or
        the file has no samples. The message names file, line, column and value.
    """
    file = as_path(path)
    rows = numeric_rows(file)
    line, header = next(rows, (1, []))
    names = [name.casefold() for name in header]
    shape = _sample_shape(names)
    if shape is None:
        raise InvalidData(
            f"{file}, line {line}: must be the header of samples, such as "
            f"{','.join(sample_columns(3, 1))},…, got {show(','.join(header))}",
            field="header",
        )
    orders, dimensions = shape
    table: list[list[float]] = []
    for line, values in rows:
        table.append(numbers(values, names, f"{file}, line {line}", "samples"))
        if len(table) > 1 and table[-1][0] <= table[-2][0]:
            raise InvalidData(
                f"{file}, line {line}, column t: must be > {table[-2][0]!r}, the time before, "
                f"got {table[-1][0]!r}",
                field="t",
            )
    if not table:
        raise InvalidData(f"{file}: no samples below the header", field="samples")
    array = np.array(table)
    values_of = np.moveaxis(array[:, 1:].reshape(len(table), orders, dimensions), 1, 0)
    return Samples(array[:, 0].copy(), np.ascontiguousarray(values_of))


def _sample_shape(names: list[str]) -> tuple[int, int] | None:
    """Return the numbers of derivatives (including position) and axes of a header, or None."""
    columns = len(names) - 1
    for dimensions in range(1, columns + 1):
        orders, rest = divmod(columns, dimensions)
        if not rest and tuple(names) == sample_columns(dimensions, orders - 1):
            return orders, dimensions
    return None


# -- waypoints ---------------------------------------------------------------------------------------


def read_waypoints(path: str | os.PathLike[str]) -> Floats:
    """Read waypoints (m) from a CSV or Excel file with one waypoint per line, one column per axis.

    An optional header has the names ``x,y,z,yaw``, ``px,py,pz``, ``east,north,up``, ``e,n,u`` (or the
    first of them), or ``x0,x1,…``. Files of uav_trajectories have no header. Rows of commas only are
    skipped. The files contain no times; :func:`~crosstrack.instances.times_by_distance` is a first guess.

    Parameters
    ----------
    path : path-like
        Path of the file.

    Returns
    -------
    ndarray, shape (knots, dimensions)

    Raises
    ------
    InvalidData
        A number is not finite, rows have different lengths, there are fewer than two waypoints, a
        column contains times, or the names or their order are wrong. The message names file, line,
        column and value.
    """
    file = as_path(path)
    points: list[list[float]] = []
    names: list[str] = []
    for line, values in numeric_rows(file):
        where = f"{file}, line {line}"
        if not names:
            labels = [value.lstrip("# ").casefold() for value in values]
            words = not any(NUMBER.fullmatch(value) for value in values)
            if words and not {"t", "time", "duration"}.isdisjoint(labels):
                raise InvalidData(
                    f"{where}: a column of times, where only coordinates are allowed (x,y,z)",
                    field="waypoints",
                )
            if words and all(re.fullmatch(r"[a-z]\w*", name) for name in labels):
                _require_axes(labels, where)
                names = labels
                continue
            count = len(values)
            names = list(_AXES[:count]) if count <= 4 else [f"x{axis}" for axis in range(count)]
        points.append(numbers(values, names, where, "waypoints"))
    if len(points) < 2:
        raise InvalidData(
            f"{file}: must hold at least 2 waypoints, got {len(points)}", field="waypoints"
        )
    return np.array(points)


def _require_axes(names: Sequence[str], where: str) -> None:
    """Raise unless the columns are coordinates in their order."""
    numbered = [f"x{axis}" for axis in range(len(names))]
    if list(names) not in (numbered, *(list(axes[: len(names)]) for axes in _HEADERS)):
        raise InvalidData(
            f"{where}: must name coordinates in their order, "
            f"{' or '.join(','.join(axes) for axes in _HEADERS)} (or the first of them) or x0,x1,…; "
            f"got {show(','.join(names))}",
            field="waypoints",
        )


def describe_table(file: Path, header: str) -> str:
    """Return advice for a CSV file of a trajectory, or an empty string for other files."""
    names = [name.strip().casefold() for name in header.lstrip("# ").split(",")]
    if names[0] == "duration" and "x^0" in names:
        return (
            "a poly7 file holds a trajectory, which is a plan, and no instance. "
            "crosstrack.instances.read_poly7(path) returns it: plan(t, derivative=0); its "
            "waypoints and times make an instance: "
            "MinimumSnap(waypoints=plan(plan.times), times=plan.times)"
        )
    if names[0] == "t" and len(names) > 1:
        return (
            "a CSV file of samples holds a trajectory at instants, and no instance; "
            "crosstrack.instances.read_samples(path) returns it"
        )
    return ""


def waypoints_of_table(file: Path) -> dict[str, Any]:
    """Return the data of an instance from a file of waypoints."""
    return {"waypoints": read_waypoints(file)}


#: Replaces ``"waypoints": "file.csv"`` in an instance by the waypoints in the file.
resolve_references = reference("waypoints", waypoints_of_table)


SAMPLES = ExportFormat("samples of all derivatives (CSV)", ".csv", write_samples)
