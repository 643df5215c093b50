"""The states of an embedding as a table."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ...files import write_text
from ...models.attractor.model import AttractorAnalysis
from ...models.attractor.plan import AttractorEstimate
from ...models.fields import required
from ..exports import ExportFormat

__all__ = ["CSV", "write_states_csv"]


def write_states_csv(
    plan: AttractorEstimate, path: str | os.PathLike[str], *, model: AttractorAnalysis
) -> Path:
    """Write one row a state of the plan's embedding as CSV, in one step; return the path.

    The columns are ``time [s]``, counted from the first sample, and ``x0``, ``x1`` and so on with the unit of the
    series and all digits: what was measured then, one delay later and so on.

    Parameters
    ----------
    plan : AttractorEstimate
        The embedding.
    path : path-like
        The file.
    model : AttractorAnalysis
        What it is for.

    Raises
    ------
    InvalidData
        A series too short for the embedding, or a file that cannot be written.
    """
    required("plan", plan, AttractorEstimate)
    states = required("model", model, AttractorAnalysis).states(plan.delay, plan.dimension)
    unit = f" [{model.unit}]" if model.unit else ""
    head = ["time [s]", *(f"x{k}{unit}" for k in range(plan.dimension))]
    times = model.period * np.arange(len(states))
    rows = np.column_stack([times, states]).tolist()
    lines = [",".join(map(repr, row)) for row in rows]
    return write_text(path, "\n".join([",".join(head), *lines]) + "\n")


CSV = ExportFormat("one row a state of the embedding (CSV)", ".csv", write_states_csv)
