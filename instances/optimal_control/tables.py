"""Plans of states and controls as tables that other software reads."""

from __future__ import annotations

import csv
import io
import os
from pathlib import Path

import numpy as np

from ...files import write_text
from ...models.fields import required
from ...models.optimal_control.definition import entry_names
from ...models.optimal_control.plan import ControlPlan, PhasePlan
from ...models.sampling import sample_count
from ..exports import ExportFormat

__all__ = ["SAMPLES", "write_control_samples"]


def write_control_samples(
    plan: ControlPlan, path: str | os.PathLike[str], *, rate: float = 100.0
) -> Path:
    """Write a plan at equal steps of time as CSV, in one step; return the path.

    The first column is the phase's number, the second the time, then one a state, a control and
    each entry of path constraints, invariants and outputs, with its unit in brackets; the latter
    where the plan knows its declaration. A column that a phase does not have is empty there.

    Parameters
    ----------
    plan : ControlPlan
        The plan.
    path : path-like
        The file.
    rate : float
        Samples a unit of time; the end of every phase is always included.

    Raises
    ------
    InvalidData
        A rate that is no number > 0 or gives too many samples, or a file that cannot be written.
    """
    required("plan", plan, ControlPlan)
    names = list(
        dict.fromkeys(
            name
            for one in plan.phases
            for name in (*one.state_names, *one.control_names, *_observed(one))
        )
    )
    table = io.StringIO()
    rows = csv.writer(table, lineterminator="\n")
    rows.writerow(["phase", "t", *names])
    sample_count(sum(one.duration for one in plan.phases), rate)
    for number, one in enumerate(plan.phases, start=1):
        count = sample_count(one.duration, rate)
        times = one.start + np.arange(count + 1) / rate
        times = np.append(times[times < one.end - 1e-9 * one.duration], one.end)
        columns = dict(zip(one.state_names, one.states(times).T.tolist(), strict=True))
        columns.update(zip(one.control_names, one.controls(times).T.tolist(), strict=True))
        if seen := _observed(one):
            columns.update(zip(seen, one.observed(times).T.tolist(), strict=True))
        for k, t in enumerate(times.tolist()):
            values = [repr(columns[name][k]) if name in columns else "" for name in names]
            rows.writerow([number, repr(t), *values])
    return write_text(path, table.getvalue())


def _observed(part: PhasePlan) -> tuple[str, ...]:
    """Return the headings of a phase's path constraints, invariants and outputs, one an entry."""
    found: list[str] = []
    for one in () if part.declared is None else part.declared.observed:
        unit = f" ({one.unit})" if one.unit else ""
        found += [name + unit for name in entry_names([one])]
    return tuple(found)


SAMPLES = ExportFormat("samples of states and controls (CSV)", ".csv", write_control_samples)
