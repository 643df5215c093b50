"""CSV files of numbers: samples of a trajectory, waypoints, and recognition of file types."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...files import as_path
from ...models.fields import Whole, required, show
from ...models.minimum_snap.motion import extended
from ...models.minimum_snap.trajectory import Trajectory
from ..exports import ExportFormat
from ..rows import MISSING, Rows, TableOptions
from ..series import interpolate
from ..storage import reference
from ..tables import Table, numbers, write_rows
from ..text_tables import is_numeric
from ..units import ANGLES, LENGTHS, factor_of, label_parts

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

log = logging.getLogger("crosstrack")

#: Largest number of axes, and of derivatives, in a table.
MOST_COLUMNS = 1000
#: Largest time (s) between the neighbours of an interpolated sample.
LONGEST = 0.1
_AXES = ("x", "y", "z", "yaw")
_PREFIXES = ("", "v", "a", "j", "s")
#: Allowed headers of waypoint files.
_HEADERS = (_AXES, ("px", "py", "pz"), ("east", "north", "up"), ("e", "n", "u"))


def numeric_rows(rows: Iterable[tuple[int, list[str]]]) -> Iterator[tuple[int, list[str]]]:
    """Yield line and cells of every row with a value, without the comma at the end of a row.

    Several tools write such a comma. An empty cell within the width of the first row is a missing value.
    Spreadsheets write rows of commas below a table: they are skipped, as by every reader of tables.
    """
    width = 1
    for line, cells in rows:
        row = cells[:-1] if len(cells) > width and not cells[-1] else cells
        width = max(width, len(row))
        yield line, row


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
        Trajectory to write. Its yaw, if any, is the fourth axis, and needs three axes before it.
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
        integer, the trajectory has a yaw but not three axes, or the file cannot be written.
    """
    required("trajectory", trajectory, Trajectory)
    if trajectory.yaw is not None:
        if trajectory.dimensions != 3 or not np.array_equal(trajectory.yaw.times, trajectory.times):
            raise InvalidData(
                "trajectory with a yaw must have 3 axes and the knots of the yaw, got "
                f"{trajectory!r} with yaw {trajectory.yaw!r}",
                field="trajectory",
            )
        trajectory = extended(trajectory, trajectory.yaw, False).curve
    rows = trajectory.sampled(rate, derivatives)
    header = sample_columns(trajectory.dimensions, derivatives)
    return write_rows(path, header, (rows + 0.0).tolist())


def read_samples(path: str | os.PathLike[str], **options: Unpack[TableOptions]) -> Samples:
    """Read the exact samples from a file of :func:`write_samples`.

    Parameters
    ----------
    path : path-like
        Path of the file.
    **options
        Map of columns, encoding, sheet and missing values, see
        :class:`~crosstrack.instances.TableOptions`. With ``missing="interpolate"``, missing cells are
        interpolated linearly between samples that are at most 0.1 s apart, with a warning in the log.

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
    reader = Rows(file, "sample", series=True, **options)
    rows = numeric_rows(reader)
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
    places: list[str] = []

    def read(cell: str, where: str, field: str) -> float:
        fills = reader.fills and cell.casefold() in MISSING and not where.endswith("column t")
        return np.nan if fills else reader.number(cell, where, field)

    for line, values in rows:
        if file.suffix.casefold() == ".xlsx":  # openpyxl omits empty cells at the end of a row
            values += [""] * (len(names) - len(values))
        places.append(f"{file}, line {line}")
        table.append(numbers(values, names, places[-1], "samples", read))
        if len(table) > 1 and table[-1][0] <= table[-2][0]:
            raise InvalidData(
                f"{file}, line {line}, column t: must be > {table[-2][0]!r}, the time before, "
                f"got {table[-1][0]!r}",
                field="t",
            )
    if not table:
        raise InvalidData(f"{file}: no samples below the header", field="samples")
    columns = Table(dict(zip(names, map(list, zip(*table, strict=True)), strict=True)), places)
    interpolate(columns, LONGEST, "s", "t")
    array = np.array(list(columns.values.values())).T
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


def read_waypoints(path: str | os.PathLike[str], **options: Unpack[TableOptions]) -> Floats:
    """Read waypoints (m) from a CSV or Excel file with one waypoint per line, one column per axis.

    An optional header has the names ``x,y,z,yaw``, ``px,py,pz``, ``east,north,up``, ``e,n,u`` (or the
    first of them), or ``x0,x1,…``, each optionally with its unit in brackets. Files of uav_trajectories
    have no header. Rows of commas only are skipped. The files contain no times;
    :func:`~crosstrack.instances.times_by_distance` is a first guess.

    Parameters
    ----------
    path : path-like
        Path of the file.
    **options
        Map of columns, encoding and sheet, see :class:`~crosstrack.instances.TableOptions`. With a map,
        only its columns are read, in the order of the axes.

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
    reader = Rows(file, "waypoint", **options)
    points: list[list[float]] = []
    names: list[str] = []
    axes: list[int] = []
    factors: list[float] = []
    for line, values in numeric_rows(reader):
        where = f"{file}, line {line}"
        if not names:
            if not any(map(is_numeric, values)):
                parts = [label_parts(value.lstrip("# ")) for value in values]
                names = [name.casefold() for name, _ in parts]
                axes = _axes(names, reader.columns, where)
                factors = [
                    factor_of(unit, ANGLES if name == "yaw" else LENGTHS, where, name, bare=True)
                    for name, unit in ((names[at], parts[at][1]) for at in axes)
                ]
                continue
            count = len(values)
            names = list(_AXES[:count]) if count <= 4 else [f"x{axis}" for axis in range(count)]
            axes, factors = list(range(count)), [1.0] * count
        labels = names
        if len(values) == len(names):
            values, labels = [values[at] for at in axes], [names[at] for at in axes]
        point = numbers(values, labels, where, "waypoints", reader.number)
        points.append([x * factor for x, factor in zip(point, factors, strict=True)])
    if len(points) < 2:
        raise InvalidData(
            f"{file}: must hold at least 2 waypoints, got {len(points)}", field="waypoints"
        )
    return np.array(points)


def _axes(names: Sequence[str], columns: Mapping[str, str], where: str) -> list[int]:
    """Return the positions of the coordinates, of all columns without a map, or raise."""
    if not columns and not {"t", "time", "duration"}.isdisjoint(names):
        raise InvalidData(
            f"{where}: a column of times, where only coordinates are allowed (x,y,z)",
            field="waypoints",
        )
    axes = next((axes for axes in _HEADERS if columns and columns.keys() <= {*axes}), names)
    places = [names.index(axis) for axis in axes if axis in names]
    _require_axes([names[at] for at in places], where)
    unread = [name for at, name in enumerate(names) if at not in places]
    if unread:
        log.warning("%s: columns that are not read: %s", where, ", ".join(unread))
    return places


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


def waypoints_of_table(file: Path, **options: Unpack[TableOptions]) -> dict[str, Any]:
    """Return the data of an instance from a file of waypoints."""
    return {"waypoints": read_waypoints(file, **options)}


#: Replaces ``"waypoints": "file.csv"`` in an instance by the waypoints in the file.
resolve_references = reference("waypoints", waypoints_of_table)


SAMPLES = ExportFormat("samples of all derivatives (CSV)", ".csv", write_samples)
