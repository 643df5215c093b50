"""Recordings of measured drives in CSV and Excel files.

A file has a header with the columns ``time``, ``speed``, ``steering``, ``yaw_rate``,
``lateral_acceleration`` and, optionally, ``sideslip``, ``longitudinal_acceleration`` and the four rim speeds
``wheel_front_left``, ``wheel_front_right``, ``wheel_rear_left`` and ``wheel_rear_right``, in any order, each with its unit
in brackets, such as ``speed [km/h]``. The four rim speeds may replace the speed, and the angle of the steering wheel,
``steering_wheel``, that of the front wheels. Other columns are ignored with a warning in the log.
"""

from __future__ import annotations

import logging
import os
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.fields import Optional, Real
from ...models.sideslip.data import MOST_GAP, Recording, estimate_speed
from ..series import insert_rows, interpolate
from ..storage import Assumed
from ..tables import Column, Sheet, TableOptions
from ..units import ACCELERATIONS, ANGLES, RATES, SPEEDS, TIMES
from .vehicles import VEHICLE

__all__ = ["read_recording", "table_file"]

Floats = NDArray[np.float64]

log = logging.getLogger("crosstrack")

#: Largest time (s) between the neighbours of interpolated values: a steering input takes longer.
LONGEST = 0.25
_RIGHT, _TURNS = 0.5 * np.pi, 20.0 * np.pi
_WHEELS = ("wheel_front_left", "wheel_front_right", "wheel_rear_left", "wheel_rear_right")
_COLUMNS = (
    Column("time", units=TIMES, aliases=("t",)),
    Column("speed", units=SPEEDS, lower=0.0, upper=1000.0, series=True),
    Column("steering", units=ANGLES, lower=-_RIGHT, upper=_RIGHT, series=True),
    Column("steering_wheel", units=ANGLES, lower=-_TURNS, upper=_TURNS, series=True,
           aliases=("steering_wheel_angle",)),
    Column("yaw_rate", units=RATES, lower=-100.0, upper=100.0, series=True),
    Column("lateral_acceleration", units=ACCELERATIONS, lower=-1000.0, upper=1000.0, series=True),
    Column("sideslip", units=ANGLES, lower=-_RIGHT, upper=_RIGHT, optional=True, series=True),
    Column("longitudinal_acceleration", units=ACCELERATIONS, lower=-1000.0, upper=1000.0,
           optional=True, series=True),
    *(Column(name, units=SPEEDS, lower=0.0, upper=1000.0, optional=True, series=True) for name in _WHEELS),
)  # fmt: skip
_HEADER = (
    "such as 'time [s],speed [km/h],steering [deg],yaw_rate [deg/s],lateral_acceleration [m/s²]', or "
    "steering_wheel with data steering_ratio instead of steering"
)


def read_recording(
    path: str | os.PathLike[str], *, steering_ratio: float | None = None,
    **options: Unpack[TableOptions],
) -> Recording:  # fmt: skip
    """Return the drive in a CSV or Excel file.

    The first time is arbitrary. Repeated lines are dropped with a warning in the log. Signs are those of
    ISO 8855, positive to the left.

    Parameters
    ----------
    path : path-like
        The file.
    steering_ratio : float, optional
        Angle of the steering wheel per angle of the front wheels, for files with a column
        ``steering_wheel`` instead of ``steering``.
    **options
        Map of columns, encoding, sheet and missing values, see
        :class:`~crosstrack.instances.TableOptions`. With ``missing="interpolate"``, missing cells and
        missing lines are interpolated over at most 0.25 s, with a warning in the log.

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
    ratio = Optional(Real(0, strict=True)).coerce("steering_ratio", steering_ratio, {})
    if ratio is None and "steering_wheel" in (options.get("columns") or ()):
        raise InvalidData(
            f"{path}: steering_ratio must be given for steering_wheel, such as steering_ratio=16",
            field="steering_ratio",
        )
    unread = {"steering_wheel" if ratio is None else "steering"}
    sheet = Sheet(path, "sample", "recording", series=True, **options)
    if {"speed", *_WHEELS}.difference(sheet.plain) == {"speed"}:
        unread.add("speed")
    columns = [column for column in _COLUMNS if column.name not in unread]
    table = sheet.read(sheet.select(columns, _HEADER, strict=False))
    if ratio is not None:
        angles = table.values.pop("steering_wheel")
        table.values["steering"] = [angle / ratio for angle in angles]
    if options.get("missing") is not None:
        insert_rows(table, LONGEST * (1 + 1e-9))
        interpolate(table, LONGEST * (1 + 1e-9), "s")
    values = {name: np.array(column) for name, column in table.values.items()}
    new = _new_rows(np.stack(list(values.values())), values["time"], table.places)
    if len(new) < len(table.places):
        log.warning("%s: %d lines repeat the one before", path, len(table.places) - len(new))
    values = {name: value[new] for name, value in values.items()}
    steps = np.diff(values["time"])
    (gaps,) = np.nonzero(steps > 1.5 * np.median(steps)) if steps.size else ((),)
    if len(gaps):
        log.warning(
            "%s: %d gaps between samples; the longest is %.6g s",
            table.places[new[steps.argmax() + 1]], len(gaps), steps.max(),
        )  # fmt: skip
    wheels = [values.pop(name) for name in _WHEELS if name in values]
    if 0 < len(wheels) < len(_WHEELS):
        raise InvalidData(
            f"{path}: wheel_speeds needs all of the columns {', '.join(_WHEELS)}, got {len(wheels)}",
            field="wheel_speeds",
        )
    if wheels:
        values["wheel_speeds"] = np.column_stack(wheels)
    if "speed" not in values:
        log.warning("%s: the speed follows from those of the wheels", path)
        values["speed"] = estimate_speed(
            values["wheel_speeds"], values["steering"], values["yaw_rate"]
        )
    try:
        return Recording(times=values.pop("time"), **values)
    except InvalidData as error:
        raise InvalidData(f"{path}: {error}", field=error.field) from None


def _new_rows(table: Floats, times: Floats, places: list[str]) -> NDArray[np.intp]:
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


def table_file(
    file: Path, *, steering_ratio: float | None = None, **options: Unpack[TableOptions]
) -> dict[str, Any]:
    """Return the fields of a model from the file of a drive, with a default vehicle.

    An angle in the file becomes the truth of the model.

    Parameters
    ----------
    file : pathlib.Path
        The file.
    steering_ratio, **options
        See :func:`read_recording`.

    Returns
    -------
    dict
        Fields of :class:`~crosstrack.models.sideslip.SideslipEstimation` by name.
    """
    drive = read_recording(file, steering_ratio=steering_ratio, **options)
    data = {
        "vehicle": Assumed(VEHICLE),
        "recording": Recording.from_data({**drive.data(), "sideslip": None}),
    }
    return data if drive.sideslip is None else {**data, "truth": drive.sideslip}
