"""Recordings of measured drives in CSV and Excel files.

A file has a header with the columns ``time``, ``speed``, ``steering``, ``yaw_rate``,
``lateral_acceleration`` and, optionally, ``sideslip``, in any order, each with its unit in
brackets, such as ``speed [km/h]``. Other columns are ignored with a warning in the log.
"""

from __future__ import annotations

import logging
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.sideslip.data import GRAVITY, MOST_GAP, Recording
from ..storage import Assumed
from ..tables import TIMES, Column, read_table
from .settings import VEHICLE

__all__ = ["read_recording", "table_file"]

log = logging.getLogger("crosstrack")

_DEGREE, _RIGHT = math.pi / 180.0, math.pi / 2
_ANGLES = {"rad": 1.0, "deg": _DEGREE, "°": _DEGREE, "mrad": 1e-3}
_RATES = {"rad/s": 1.0, "deg/s": _DEGREE, "°/s": _DEGREE, "mrad/s": 1e-3}
_SPEEDS = {"m/s": 1.0, "km/h": 1 / 3.6, "kph": 1 / 3.6, "mph": 0.44704}
_ACCELERATIONS = {"m/s²": 1.0, "m/s^2": 1.0, "m/s2": 1.0, "g": GRAVITY}
_COLUMNS = (
    Column("time", units=TIMES),
    Column("speed", units=_SPEEDS, lower=0.0, upper=1000.0),
    Column("steering", units=_ANGLES, lower=-_RIGHT, upper=_RIGHT),
    Column("yaw_rate", units=_RATES, lower=-100.0, upper=100.0),
    Column("lateral_acceleration", units=_ACCELERATIONS, lower=-1000.0, upper=1000.0),
    Column("sideslip", units=_ANGLES, lower=-_RIGHT, upper=_RIGHT, optional=True),
)
_HEADER = (
    "such as 'time [s],speed [km/h],steering [deg],yaw_rate [deg/s],lateral_acceleration [m/s²]'"
)


def read_recording(path: str | os.PathLike[str]) -> Recording:
    """Return the drive in a CSV or Excel file.

    The first time is arbitrary. Repeated lines are dropped with a warning in the log. The steering
    angle is that of the front wheels, not of the steering wheel. Signs are those of ISO 8855, positive to the left.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    Recording
        The drive in SI units, with the angle if the file has a column ``sideslip``.

    Raises
    ------
    BackendMissing
        The file is an Excel file, and openpyxl is not installed.
    InvalidData
        A column is missing or repeated, a unit is missing or unknown, a row is too short or too long, a value is not
        finite or out of range, two different lines have the same time, times decrease, a gap exceeds 2 s, or there
        are fewer than 10 samples. The message gives file, line, column and value.
    """
    table = read_table(path, _COLUMNS, _HEADER, row="sample", field="recording", strict=False)
    values = {name: np.array(column) for name, column in table.values.items()}
    new = _new_rows(np.stack(list(values.values())), values["time"], table.places)
    if len(new) < len(table.places):
        log.warning("%s: %d lines repeat the one before", path, len(table.places) - len(new))
    values = {name: value[new] for name, value in values.items()}
    try:
        return Recording(times=values.pop("time"), **values)
    except InvalidData as error:
        raise InvalidData(f"{path}: {error}", field=error.field) from None


def _new_rows(
    table: NDArray[np.float64], times: NDArray[np.float64], places: list[str]
) -> NDArray[np.intp]:
    """Return the indices of rows (columns of `table`) that differ from the row before.

    Raise if times do not increase or a gap exceeds 2 s; `places` are the positions in the file.
    """
    new = np.flatnonzero(np.append(True, (table[:, 1:] != table[:, :-1]).any(axis=0)))
    steps = np.diff(times[new])
    bad = np.flatnonzero(~((steps > 0) & (steps <= MOST_GAP)))
    if bad.size:
        k = int(bad[0])
        now, before = times[new[k + 1]], times[new[k]]
        if steps[k] > 0:
            rule = f"leave no gap above {MOST_GAP:g} s (split the file there)"
        else:
            rule = "rise" if steps[k] < 0 else "rise (two different lines have one time)"
        raise InvalidData(
            f"{places[new[k + 1]]}, column time: must {rule}, got {now:.9g} s after {before:.9g} s",
            field="time",
        )
    return new


def table_file(file: Path) -> dict[str, Any]:
    """Return the fields of a model from the file of a drive, with a default vehicle.

    An angle in the file becomes the truth of the model.

    Parameters
    ----------
    file : pathlib.Path
        The file.

    Returns
    -------
    dict
        Fields of :class:`~crosstrack.models.sideslip.SideslipEstimation` by name.
    """
    drive = read_recording(file)
    data = {
        "vehicle": Assumed(VEHICLE),
        "recording": Recording.from_data({**drive.data(), "sideslip": None}),
    }
    return data if drive.sideslip is None else {**data, "truth": drive.sideslip}
