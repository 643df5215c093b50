"""The states of an embedding as a table."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ...models.attractor.model import AttractorAnalysis
from ...models.attractor.plan import AttractorEstimate
from ...models.fields import required
from ..exports import ExportFormat
from ..tables import write_rows

__all__ = ["CSV", "write_states_csv"]


def write_states_csv(
    plan: AttractorEstimate, path: str | os.PathLike[str], *, model: AttractorAnalysis
) -> Path:
    """Write the states of the plan's embedding as CSV, one row per state, and return the path.

    The columns are ``time [s]``, counted from the first sample, and ``x0``, ``x1`` and so on with the unit
    of the series: the sample at that time, one delay later and so on, then those of further coordinates with
    the mean and the deviation of the series. Numbers have all digits.

    Parameters
    ----------
    plan, path, model
        The embedding, file to write, and model of the plan.

    Raises
    ------
    InvalidData
        The series is too short for the embedding, or the file cannot be written.
    """
    required("plan", plan, AttractorEstimate)
    states = required("model", model, AttractorAnalysis).states(plan.delay, plan.dimension)
    unit = f" [{model.unit}]" if model.unit else ""
    head = ["time [s]", *(f"x{k}{unit}" for k in range(states.shape[1]))]
    times = model.period * np.arange(len(states))
    return write_rows(path, head, np.column_stack([times, states]).tolist())


CSV = ExportFormat("one row per state of the embedding (CSV)", ".csv", write_states_csv)
