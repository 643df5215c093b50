"""Measured series in CSV and Excel files.

A file has a header with a column ``time`` with its unit in brackets, such as ``time [ms]``, and one or more
columns of values, such as ``x [m]``. Times must be evenly spaced, because the delays of an embedding are
numbers of samples. Columns that are not named are ignored.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, UnknownName
from ...models.attractor.model import AttractorAnalysis
from ...models.fields import Optional, Real, required, show
from ..series import insert_rows, interpolate
from ..tables import TIMES, Column, Sheet, TableOptions

__all__ = ["EVEN", "read_series", "table_file"]

#: Largest deviation of a time from even spacing, in samples: more than the rounding of times, less than a gap.
EVEN = 0.05
#: Largest number of consecutive samples that are interpolated.
LONGEST = 5


def read_series(
    path: str | os.PathLike[str],
    column: str | None = None,
    *,
    period: float | None = None,
    name: str | None = None,
    **options: Unpack[TableOptions],
) -> AttractorAnalysis:
    """Return the model of a series in a CSV or Excel file.

    Parameters
    ----------
    path : path-like
        Name of the file.
    column : str, optional
        Name of the column of values, with or without its unit. Required if there are several. The names of
        several columns, separated by commas, are the series and the further coordinates.
    period : float, optional
        Seconds between samples, if the file has no times.
    name : str, optional
        Name of the model. Default: name of the file.
    **options
        See :class:`~crosstrack.instances.TableOptions`. With ``missing="interpolate"``, at most 5
        consecutive samples are interpolated, with a warning in the log.

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
        A column does not exist.
    """
    data = table_file(path, column=column, period=period, **options)
    try:
        return AttractorAnalysis(**data, name=Path(path).stem if name is None else name)
    except InvalidData as error:
        raise InvalidData(f"{path}: {error}", field=error.field) from None


def table_file(
    file: str | os.PathLike[str],
    *,
    column: str | None = None,
    period: float | None = None,
    **options: Unpack[TableOptions],
) -> dict[str, Any]:
    """Return the data of an instance from a file of times and values, see :func:`read_series`."""
    lag = Optional(Real(0, strict=True, unit="s")).coerce("period", period, {})
    data = _read(file, None if column is None else required("column", column, str), options)
    if "period" in data and lag is not None:
        raise InvalidData(
            f"{file}: period must not be given: the file has times, {data['period']:.6g} s apart",
            field="period",
        )
    if "period" not in data:
        if lag is None:
            raise InvalidData(
                f"{file}: has no column of times, such as 'time [s]': period must be given",
                field="period",
            )
        data["period"] = lag
    return data


def _read(
    path: str | os.PathLike[str], wanted: str | None, options: TableOptions
) -> dict[str, Any]:
    """Return the series, its unit, and the period if the file has times."""
    sheet = Sheet(path, "sample", "series", series=True, **options)
    times = _times(sheet)
    at, *further = _columns(sheet, times, wanted)
    # Times stay in the unit of the file, in which messages state them.
    selection = {k: Column(f"further[{k}]", series=True) for k in further}
    selection |= {at: Column("series", series=True), **{k: Column("time") for k in times}}
    table = sheet.read(selection)
    unit = sheet.parts(times[0])[1] if times else "samples"
    if not times:
        table.values["time"] = [float(k) for k in range(len(table.places))]
    if options.get("missing") is not None:
        usual = float(np.median(np.diff(table.values["time"]))) if len(table.places) > 1 else 0.0
        longest = (LONGEST + 1 + EVEN) * usual
        insert_rows(table, longest)
        interpolate(table, longest, unit)
    result = {"series": np.array(table.values["series"]), "unit": sheet.parts(at)[1]}
    if further:
        values = [table.values[f"further[{k}]"] for k in further]
        result["further"] = np.stack(values, axis=1)
    for k in times:
        spacing = _spacing(np.array(table.values["time"]), table.places, sheet.names[k])
        result["period"] = sheet.factor(k, TIMES, "time") * spacing
    return result


def _times(sheet: Sheet) -> list[int]:
    """Return the position of the column of times, or an empty list."""
    result = [
        at for at in range(len(sheet.names)) if sheet.parts(at)[0].casefold() in ("time", "t")
    ]
    if len(result) > 1:
        raise InvalidData(f"{sheet.where}: column 'time' stands twice", field="time")
    for at in result:
        sheet.factor(at, TIMES, "time")
    return result


def _columns(sheet: Sheet, times: list[int], wanted: str | None) -> list[int]:
    """Return the positions of the wanted columns: one, or several if no column has the whole name."""
    labels = {*sheet.names, *(sheet.parts(at)[0].casefold() for at in range(len(sheet.names)))}
    if wanted is None or "," not in wanted or wanted.strip().casefold() in labels:
        return [_values(sheet, times, wanted)]
    places = [_values(sheet, times, name) for name in wanted.split(",")]
    if len(set(places)) < len(places):
        raise InvalidData(f"{sheet.where}: columns must differ, got {show(wanted)}", field="column")
    return places


def _values(sheet: Sheet, times: list[int], wanted: str | None) -> int:
    """Return the position of the wanted column of values, or of the only one."""
    names, where = sheet.names, sheet.where
    if any(not re.search("[^\\W\\d_]", name) for name in names):
        raise InvalidData(
            f"{where}: must be a header of a series, such as 'time [s],x [m]', got "
            f"{show(','.join(names))}: every column must have a name",
            field="header",
        )
    if len(set(names)) < len(names):
        raise InvalidData(
            f"{where}: columns must differ, got {show(','.join(names))}", field="header"
        )
    others = [at for at in range(len(names)) if at not in times]
    if wanted is not None:
        name = wanted.strip().casefold()
        matches = [at for at in others if name in (names[at], sheet.parts(at)[0].casefold())]
        if not matches:
            raise UnknownName("column of values", wanted, [names[at] for at in others])
        others = matches
    if len(others) != 1:
        several = (
            f"several columns of values, {', '.join(names[at] for at in others)}: one must be named "
            "(column=, on the command line --data column=NAME)"
        )
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
