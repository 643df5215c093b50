"""Recordings of measured drives in CSV and Excel files.

A file has a header with the columns ``time``, ``speed``, ``steering``, ``yaw_rate``,
``lateral_acceleration`` and, optionally, ``sideslip``, in any order, each with its unit in
brackets, such as ``speed [km/h]``. Other columns are ignored with a warning in the log.
"""

from __future__ import annotations

import logging
import math
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.fields import show
from ...models.sideslip.data import GRAVITY, MOST_GAP, Recording
from ..catalogue import Assumed
from ..spreadsheets import read_columns
from ..storage import number
from .settings import VEHICLE

__all__ = ["read_recording", "table_file"]

log = logging.getLogger("crosstrack")


class _Quantity(NamedTuple):
    """Column of a file: factors from its units to the first one, and limits of its values in that unit."""

    units: Mapping[str, float]
    lower: float = -math.inf
    upper: float = math.inf


_DEGREE = math.pi / 180.0
_ANGLE = _Quantity(
    {"rad": 1.0, "deg": _DEGREE, "°": _DEGREE, "mrad": 1e-3}, -math.pi / 2, math.pi / 2
)
_KNOWN = {
    "time": _Quantity({"s": 1.0, "ms": 1e-3, "us": 1e-6}),
    "speed": _Quantity({"m/s": 1.0, "km/h": 1 / 3.6, "kph": 1 / 3.6, "mph": 0.44704}, 0.0, 1000.0),
    "steering": _ANGLE,
    "yaw_rate": _Quantity(
        {"rad/s": 1.0, "deg/s": _DEGREE, "°/s": _DEGREE, "mrad/s": 1e-3}, -100.0, 100.0
    ),
    "lateral_acceleration": _Quantity(
        {"m/s²": 1.0, "m/s^2": 1.0, "m/s2": 1.0, "g": GRAVITY}, -1000.0, 1000.0
    ),
    "sideslip": _ANGLE,
}
_HEADER = re.compile(r"([^\[\]()]*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))?")


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
    columns: dict[str, tuple[str, float]] = {}
    places: list[str] = []

    def check(names: list[str], where: str) -> None:
        columns.update(_columns(names, where))
        unread = [name for name in names if name not in columns]
        if unread:
            log.warning("%s: columns that are not read: %s", where, ", ".join(unread))

    def convert(text: str, where: str, name: str) -> float | None:
        if name not in columns:
            return None
        quantity, factor = columns[name]
        known = _KNOWN[quantity]
        value = number(text, f"{where}, column {name}", quantity) * factor
        if not known.lower <= value <= known.upper:
            raise InvalidData(
                f"{where}, column {name}: must be {known.lower:.6g} … {known.upper:.6g} "
                f"{next(iter(known.units))}, got {show(text)}",
                field=quantity,
            )
        if quantity == "time":
            places.append(where)
        return value

    table = read_columns(path, check, convert, what="samples", field="recording")
    held = {quantity: np.array(table[name]) for name, (quantity, _) in columns.items()}
    kept = _kept(np.stack([held[key] for key in held]), held["time"], places)
    if len(kept) < len(places):
        log.warning("%s: %d lines repeat the one before", path, len(places) - len(kept))
    held = {key: value[kept] for key, value in held.items()}
    try:
        return Recording(times=held.pop("time"), **held)
    except InvalidData as error:
        raise InvalidData(f"{path}: {error}", field=error.field) from None


def _columns(names: list[str], where: str) -> dict[str, tuple[str, float]]:
    """Return quantity and unit factor of each known column of a header."""
    found: dict[str, tuple[str, float]] = {}
    for name in names:
        parts = _HEADER.fullmatch(name)
        quantity = parts[1].replace(" ", "_") if parts else ""
        if parts is None or quantity not in _KNOWN:
            continue
        if quantity in (one for one, _ in found.values()):
            raise InvalidData(f"{where}: column {quantity!r} stands twice", field=quantity)
        unit = (parts[2] or parts[3] or "").strip()
        units = _KNOWN[quantity].units
        if unit not in units:
            said = f"got {show(unit)}" if unit else "got none"
            raise InvalidData(
                f"{where}, column {show(name)}: must state its unit in brackets, one of {', '.join(units)}; {said}",
                field=quantity,
            )
        found[name] = quantity, units[unit]
    there = {quantity for quantity, _ in found.values()}
    lost = [quantity for quantity in _KNOWN if quantity not in there and quantity != "sideslip"]
    if lost:
        raise InvalidData(
            f"{where}: must be a header of a drive, such as 'time [s],speed [km/h],steering [deg],yaw_rate "
            f"[deg/s],lateral_acceleration [m/s²]'; missing: {', '.join(lost)}; got {show(','.join(names))}",
            field="header",
        )
    return found


def _kept(
    table: NDArray[np.float64], times: NDArray[np.float64], places: list[str]
) -> NDArray[np.intp]:
    """Return the indices of rows that differ from the previous row, after a check of the times.

    Parameters
    ----------
    table : ndarray, shape (columns, n)
        Values of all known columns.
    times : ndarray, shape (n,)
        Times, s.
    places : list of str
        Position of each row in the file, for messages.

    Returns
    -------
    ndarray of int

    Raises
    ------
    InvalidData
        Times do not increase, or a gap exceeds 2 s.
    """
    new = np.concatenate([[True], (table[:, 1:] != table[:, :-1]).any(axis=0)])
    kept = np.flatnonzero(new)
    steps = np.diff(times[kept])
    bad = np.flatnonzero(~((steps > 0) & (steps <= MOST_GAP)))
    if bad.size:
        k = int(bad[0])
        now, before = times[kept[k + 1]], times[kept[k]]
        if steps[k] > 0:
            rule = f"leave no gap above {MOST_GAP:g} s (split the file there)"
        else:
            rule = "rise" if steps[k] < 0 else "rise (two different lines have one time)"
        raise InvalidData(
            f"{places[kept[k + 1]]}, column time: must {rule}, got {now:.9g} s after {before:.9g} s",
            field="time",
        )
    return kept


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
    found = {
        "vehicle": Assumed(VEHICLE),
        "recording": Recording.from_data({**drive.data(), "sideslip": None}),
    }
    return found if drive.sideslip is None else {**found, "truth": drive.sideslip}
