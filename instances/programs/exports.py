"""Export of the values of a program by the names of its author."""

from __future__ import annotations

import csv
import io
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...files import write_text
from ...models.programs.base import Program
from ...models.programs.sources.link import named_values
from ...models.verification import stated
from ..exports import ExportFormat

__all__ = ["CSV", "SOL"]


def _write_csv(plan: NDArray[np.float64], path: str | os.PathLike[str], *, model: Program) -> None:
    """Write one row per variable: its name and its value."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["variable", "value"])
    rows.writerows((name, _exact(value)) for name, value in _values(model, plan))
    write_text(path, text.getvalue())


def _write_sol(plan: NDArray[np.float64], path: str | os.PathLike[str], *, model: Program) -> None:
    """Write the values as ``name value`` lines, as Gurobi and SCIP read them for a start."""
    objective = stated(model.verify(plan).objective, model.maximise)
    lines = [f"# Objective value = {_exact(objective)}"]
    lines += [f"{name.replace(' ', '')} {_exact(value)}" for name, value in _values(model, plan)]
    write_text(path, "\n".join(lines) + "\n")


def _values(model: Program, plan: NDArray[np.float64]) -> list[tuple[str, Any]]:
    """Return all values in the order of the columns."""
    return named_values(model.values_of(plan), by_size=False)


def _exact(value: Any) -> str:
    return repr(value) if isinstance(value, float) else str(value)


CSV = ExportFormat("the values by name, one row per variable", ".csv", _write_csv)
SOL = ExportFormat("the values by name, as solvers read them", ".sol", _write_sol)
