"""Export of points of black boxes as tables."""

from __future__ import annotations

import os
from pathlib import Path

from ...errors import InvalidData
from ...models.black_box.model import BlackBoxMinimisation
from ...models.black_box.plan import BlackBoxPoint
from ...models.fields import required
from ..exports import ExportFormat
from ..tables import write_rows

__all__ = ["CSV", "write_point_csv"]


def write_point_csv(
    plan: BlackBoxPoint, path: str | os.PathLike[str], *, model: BlackBoxMinimisation
) -> Path:
    """Write one row per variable as CSV; return the path.

    The columns are ``variable,value,lower,upper``: the index from 0, the value, and the bounds, with
    all digits.

    Parameters
    ----------
    plan, path, model
        Point, file to write, and model of the plan.

    Returns
    -------
    pathlib.Path
        `path`.

    Raises
    ------
    InvalidData
        The point has another number of variables, or the file cannot be written.
    """
    required("plan", plan, BlackBoxPoint)
    required("model", model, BlackBoxMinimisation)
    if len(plan.x) != model.dimension:
        raise InvalidData(f"x must have {model.dimension} entries, got {len(plan.x)}", field="x")
    indices = range(model.dimension)
    rows = zip(indices, plan.x, model.lows.tolist(), model.highs.tolist(), strict=True)
    return write_rows(path, ("variable", "value", "lower", "upper"), rows)


CSV = ExportFormat("one row per variable (CSV)", ".csv", write_point_csv)
