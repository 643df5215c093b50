"""Export of states and controls as tables."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from ...models.fields import required
from ...models.optimal_control.definition import entry_names
from ...models.optimal_control.plan import ControlPlan, PhasePlan
from ...models.sampling import sample_count
from ..exports import ExportFormat
from ..tables import write_rows

__all__ = ["SAMPLES", "write_control_samples"]


def write_control_samples(
    plan: ControlPlan, path: str | os.PathLike[str], *, rate: float = 100.0
) -> Path:
    """Write a plan at equal time steps as CSV; return the path.

    The first column is the number of the phase and the second the time. One column follows per
    state, control, and entry of path constraints, invariants and outputs, with its unit in brackets.
    The latter require a plan with its declaration. A column is empty in phases without the quantity.

    Parameters
    ----------
    plan, path
        Plan, and file to write.
    rate : float
        Samples per unit of time; the end of every phase is always included.

    Returns
    -------
    pathlib.Path
        `path`.

    Raises
    ------
    InvalidData
        The rate is not positive, or yields too many samples, or the file cannot be written.
    """
    required("plan", plan, ControlPlan)
    names = list(
        dict.fromkeys(
            name
            for part in plan.phases
            for name in (*part.state_names, *part.control_names, *_observed(part))
        )
    )
    rows: list[list[Any]] = []
    sample_count(sum(part.duration for part in plan.phases), rate)
    for number, part in enumerate(plan.phases, start=1):
        count = sample_count(part.duration, rate)
        times = part.start + np.arange(count + 1) / rate
        times = np.append(times[times < part.end - 1e-9 * part.duration], part.end)
        columns = dict(zip(part.state_names, part.states(times).T.tolist(), strict=True))
        columns.update(zip(part.control_names, part.controls(times).T.tolist(), strict=True))
        if heads := _observed(part):
            columns.update(zip(heads, part.observed(times).T.tolist(), strict=True))
        for k, t in enumerate(times.tolist()):
            values = [columns[name][k] if name in columns else "" for name in names]
            rows.append([number, t, *values])
    return write_rows(path, ["phase", "t", *names], rows)


def _observed(part: PhasePlan) -> tuple[str, ...]:
    """Return the column heads of a phase's path constraints, invariants and outputs, one per entry."""
    result: list[str] = []
    for quantity in () if part.declared is None else part.declared.observed:
        unit = f" ({quantity.unit})" if quantity.unit else ""
        result += [name + unit for name in entry_names([quantity])]
    return tuple(result)


SAMPLES = ExportFormat("samples of states and controls (CSV)", ".csv", write_control_samples)
