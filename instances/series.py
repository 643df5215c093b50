"""Missing cells and rows of samples over time."""

from __future__ import annotations

import logging

import numpy as np

from ..errors import InvalidData
from .tables import Table

__all__ = ["insert_rows", "interpolate"]

log = logging.getLogger("crosstrack")

#: Largest number of inserted rows per row of the file, which bounds the memory.
MOST_INSERTED = 10


def insert_rows(table: Table, longest: float, time: str = "time") -> None:
    """Insert the missing rows of a table, in place, with NaN in all columns but `time`.

    Rows are missing if a step exceeds 1.5 times the median and is at most `longest`.

    Raises
    ------
    InvalidData
        More than 10 rows are missing per row of the file.
    """
    times = np.array(table.values[time])
    steps = np.diff(times)
    usual = float(np.median(steps)) if steps.size else 0.0
    (gaps,) = np.nonzero((steps > 1.5 * usual) & (steps <= longest) & (usual > 0.0))
    lacking = np.rint(steps[gaps] / (usual or 1.0)) - 1
    if lacking.sum() > MOST_INSERTED * len(times):
        raise InvalidData(
            f"{table.places[gaps[lacking.argmax()] + 1]}, column {time}: {lacking.sum():.6g} rows are "
            f"missing for {len(times)} rows of a step of {usual:.6g}; at most {MOST_INSERTED} per row "
            "are interpolated: resample the file evenly",
            field=time,
        )
    counts = lacking.astype(int)
    after = np.repeat(gaps + 1, counts)
    share = np.concatenate([np.arange(1, n + 1) / (n + 1) for n in counts] or [np.zeros(0)])
    fresh = times[after - 1] + share * steps[after - 1]
    for name, cells in table.values.items():
        cells[:] = np.insert(cells, after, fresh if name == time else np.nan).tolist()
    table.places[:] = np.insert(table.places, after, [table.places[k] for k in after]).tolist()
    if after.size:
        log.warning("%s …: %d missing rows are interpolated", table.places[0], after.size)


def interpolate(table: Table, longest: float, unit: str, time: str = "time") -> None:
    """Fill missing cells, NaN, linearly over time, in place; name their number in the log.

    Parameters
    ----------
    table : Table
        Table whose column `time` is without missing cells.
    longest : float
        Largest time between the neighbours of a missing cell.
    unit : str
        Unit of the times, for messages.
    time : str
        Name of the column of times.

    Raises
    ------
    InvalidData
        A missing cell has no value before or after it, or its neighbours are too far apart.
    """
    times = np.array(table.values[time])
    count, widest = 0, 0.0
    for name, cells in table.values.items():
        values = np.array(cells, float)
        (holes,), (present,) = np.isnan(values).nonzero(), np.isfinite(values).nonzero()
        if not holes.size:
            continue
        after = present.searchsorted(holes)
        lost = holes[(after == 0) | (after == present.size)]
        if lost.size:
            raise InvalidData(
                f"{table.places[lost[0]]}, column {name}: must have a value, because no sample "
                f"{'before' if after[0] == 0 else 'after'} it has one",
                field=name,
            )
        spans = times[present[after]] - times[present[after - 1]]
        wide = int(spans.argmax())
        if spans[wide] > longest:
            raise InvalidData(
                f"{table.places[holes[wide]]}, column {name}: values are missing for {spans[wide]:.6g} "
                f"{unit}; at most {longest:.6g} {unit} are interpolated: split the file there",
                field=name,
            )
        values[holes] = np.interp(times[holes], times[present], values[present])
        table.values[name][:] = values.tolist()
        count, widest = count + holes.size, max(widest, float(spans[wide]))
    if count:
        log.warning(
            "%s …: %d missing cells are interpolated, the longest gap is %.6g %s",
            table.places[0], count, widest, unit,
        )  # fmt: skip
