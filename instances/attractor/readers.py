"""Measured series in CSV and Excel files.

A file has a header with a column ``time`` with its unit in brackets, such as ``time [ms]``, and one or more
columns of values, such as ``x [m]``. Times must be evenly spaced, because the delays of an embedding are
numbers of samples. Other columns are ignored.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, UnknownName
from ...models.attractor.model import AttractorAnalysis
from ...models.fields import Optional, Real, required, show
from ..spreadsheets import read_columns, table_rows
from ..storage import number

__all__ = ["EVEN", "read_series", "table_file"]

#: Largest deviation of a time from even spacing, in samples: more than the rounding of times, less than a gap.
EVEN = 0.05
#: Units of time in seconds. Lower case turns the micro sign into the Greek letter.
_UNITS = {
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "μs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0,
}  # fmt: skip
_HEADER = re.compile(r"([^\[\]()]*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))?")


def read_series(
    path: str | os.PathLike[str],
    column: str | None = None,
    *,
    period: float | None = None,
    name: str | None = None,
) -> AttractorAnalysis:
    """Return the model of a series in a CSV or Excel file.

    Parameters
    ----------
    path : path-like
        Name of the file.
    column : str, optional
        Name of the column of values, with or without its unit. Required if there are several.
    period : float, optional
        Seconds between samples, if the file has no times.
    name : str, optional
        Name of the model. Default: name of the file.

    Raises
    ------
    BackendMissing
        The file is an Excel file, and openpyxl is not installed.
    InvalidData
        The header is missing, a time has no or an unknown unit, a value is not a finite number, a row is too
        short or too long, times repeat, decrease, leave a gap or are unevenly spaced, neither times nor a
        period are given or both, or the series is too short or constant. The message gives file, line,
        column and value.
    UnknownName
        The column does not exist.
    """
    lag = Optional(Real(0, strict=True, unit="s")).coerce("period", period, {})
    found = _read(path, None if column is None else required("column", column, str))
    if "period" in found and lag is not None:
        raise InvalidData(
            f"{path}: period must not be given: the file has times, {found['period']:.6g} s apart",
            field="period",
        )
    if "period" not in found:
        if lag is None:
            raise InvalidData(
                f"{path}: has no column of times, such as 'time [s]': period must be given",
                field="period",
            )
        found["period"] = lag
    try:
        return AttractorAnalysis(**found, name=Path(path).stem if name is None else name)
    except InvalidData as error:
        raise InvalidData(f"{path}: {error}", field=error.field) from None


def table_file(file: Path) -> dict[str, Any]:
    """Return the data of an instance from a file of times and one column of values."""
    found = _read(file, None)
    if "period" not in found:
        raise InvalidData(
            f"{file}: must have a column of times, such as 'time [s]', beside the values; without one, "
            "read_series takes a period",
            field="time",
        )
    return found


def _read(path: str | os.PathLike[str], wanted: str | None) -> dict[str, Any]:
    """Return the series, its unit, and the period if the file has times."""
    times: list[str] = []
    values: list[str] = []
    places: list[str] = []

    def check(names: list[str], where: str) -> None:
        times.extend(_times(names, where))
        values.append(_values(names, times, wanted, where))

    def convert(text: str, where: str, name: str) -> float | None:
        if name not in (*times, *values):
            return None
        if name in times:
            places.append(where)
        return number(text, f"{where}, column {name}", "time" if name in times else "series")

    table = read_columns(path, check, convert, what="samples", field="series")
    # Units of values keep their capitals: mV is not MV.
    _, header = next(table_rows(path))
    label = header[list(table).index(values[0])].lstrip("# ")
    found: dict[str, Any] = {"series": np.array(table[values[0]]), "unit": _parts(label)[1]}
    if times:
        factor = _UNITS[_parts(times[0])[1]]
        found["period"] = factor * _spacing(np.array(table[times[0]]), places, times[0])
    return found


def _parts(label: str) -> tuple[str, str]:
    """Return the name and the unit of a column; both may be empty."""
    parts = _HEADER.fullmatch(label)
    return (parts[1], (parts[2] or parts[3] or "").strip()) if parts else (label, "")


def _times(names: list[str], where: str) -> list[str]:
    """Return the column of times in a list, empty without one."""
    found = [name for name in names if _parts(name)[0] in ("time", "t")]
    if len(found) > 1:
        raise InvalidData(f"{where}: column 'time' stands twice", field="time")
    for name in found:
        unit = _parts(name)[1]
        if unit not in _UNITS:
            said = f"got {show(unit)}" if unit else "got none"
            raise InvalidData(
                f"{where}, column {show(name)}: must state its unit in brackets, one of {', '.join(_UNITS)}; {said}",
                field="time",
            )
    return found


def _values(names: list[str], times: list[str], wanted: str | None, where: str) -> str:
    """Return the wanted column of values, or the only one."""
    others = [name for name in names if name not in times]
    if any(not re.search("[^\\W\\d_]", name) for name in names):
        raise InvalidData(
            f"{where}: must be a header of a series, such as 'time [s],x [m]', got "
            f"{show(','.join(names))}",
            field="header",
        )
    if len(set(names)) < len(names):
        raise InvalidData(
            f"{where}: columns must differ, got {show(','.join(names))}", field="header"
        )
    if wanted is not None:
        asked = wanted.strip().casefold()
        found = [name for name in others if asked in (name, _parts(name)[0])]
        if not found:
            raise UnknownName("column of values", wanted, others)
        others = found
    if len(others) != 1:
        several = f"several columns of values, {', '.join(others)}: one must be named (column=)"
        raise InvalidData(
            f"{where}: has {several if others else 'no column of values'}", field="series"
        )
    return others[0]


def _spacing(times: NDArray[np.float64], places: list[str], name: str) -> float:
    """Return the distance of times in their unit; raise an error if they are unevenly spaced."""
    if len(times) < 2:
        raise InvalidData(f"{places[0]}: one sample is no series", field="series")
    steps = np.diff(times)
    usual = float(np.median(steps))
    for bad, rule in (
        (steps == 0, "differ from the time before"),
        (steps < 0, "rise"),
        (steps > 1.5 * usual, f"leave no gap, where samples are {usual:.6g} apart"),
        (steps < 0.5 * usual, f"be {usual:.6g} after the time before, as samples are"),
    ):
        if bad.any():
            k = int(bad.argmax()) + 1
            raise InvalidData(
                f"{places[k]}, column {name}: must {rule}, got {times[k]:.9g} after {times[k - 1]:.9g}",
                field="time",
            )
    even = times[0] + (times[-1] - times[0]) * np.arange(len(times)) / (len(times) - 1)
    spacing = float(times[-1] - times[0]) / (len(times) - 1)
    off = np.abs(times - even)
    if off.max() > EVEN * spacing:
        k = int(off.argmax())
        raise InvalidData(
            f"{places[k]}, column {name}: must be {even[k]:.9g} within {EVEN:g} of the spacing {spacing:.6g}, "
            f"got {times[k]:.9g}: samples must be evenly spaced",
            field="time",
        )
    return spacing
