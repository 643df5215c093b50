"""Files of sequential ordering: instances of TSPLIB and SOPLIB (``.sop``), tours of TSPLIB, tables.

The format is described in :mod:`crosstrack.instances.guided_path.sop`. An entry of 1000000 is a missing arc if no entry
is larger, as in TSPLIB.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InvalidData
from ...files import as_path, write_text
from ...models.fields import required
from ...models.sequential_ordering.model import MOST, SequentialOrdering
from ...models.sequential_ordering.plan import SequentialOrderingPlan
from ..exports import ExportFormat
from ..guided_path.sop import INFINITE, read_matrix, read_sop, sop_text, tour_text
from ..storage import Find, reference
from ..tables import write_rows

__all__ = ["CSV", "TSPLIB", "read_ordering", "write_ordering", "write_ordering_csv", "write_path"]


def read_ordering(path: str | os.PathLike[str]) -> SequentialOrdering:
    """Return the sequential ordering problem in a file of TSPLIB or SOPLIB.

    Node k of the file has number k - 1. The relation is stated as the fewest pairs.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    SequentialOrdering
        The model.

    Raises
    ------
    InvalidData
        The file is not such a problem, a number is missing or malformed, or the relation has a cycle. The message
        contains the file, and the nodes if applicable.
    """
    file = as_path(path)
    distances, before = read_matrix(file, MOST, "distances")
    if distances.max(initial=0.0, where=~before) == INFINITE:
        distances[distances == INFINITE] = np.inf
    distances[before] = np.inf
    np.fill_diagonal(distances, 0.0)
    inner = before.T.copy()
    inner[0], inner[:, -1] = False, False
    try:
        model = SequentialOrdering(distances, precedence=np.argwhere(inner), name=file.stem)
        return SequentialOrdering(distances, precedence=model.links, name=file.stem)
    except InvalidData as error:
        raise InvalidData(f"{file}: {error}", field=error.field) from None


def load_ordering(path: Path, *, model: str | None = None) -> SequentialOrdering:
    """Return the problem in a file; raise for a line, which is a guided path tour unless `model` is given."""
    result = read_ordering(path)
    if model is None:
        try:
            read_sop(path)
        except InvalidData:
            return result
        raise InvalidData("its distances are those of a line", field="distances")
    return result


def write_ordering(model: SequentialOrdering, path: str | os.PathLike[str]) -> Path:
    """Write a model as a sequential ordering problem of TSPLIB; return the path.

    The file contains the transitive closure of the relation, 1000000 for missing arcs, and integers if all distances
    are, because many readers accept only integers. It is written atomically.

    Parameters
    ----------
    model : SequentialOrdering
        The model.
    path : path-like
        The file, usually with the suffix ``.sop``.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InvalidData
        The format cannot express the distances, because arcs are missing and others have a length of 1000000 or
        more, or the file cannot be written.
    """
    closure = required("model", model, SequentialOrdering).closure
    finite = np.where(np.isfinite(model.distances) & ~closure.T, model.distances, 0.0)
    np.fill_diagonal(finite, 0.0)
    lacks = ~np.isfinite(model.distances) & ~closure.T & ~np.eye(model.size, dtype=bool)
    longest = finite.max()
    if longest == INFINITE or (longest > INFINITE and lacks.any()):
        raise InvalidData(
            f"distances must be below {INFINITE}, which means a missing arc in the file, got {longest:.10g}",
            field="distances",
        )
    finite[lacks] = INFINITE
    whole = bool((finite == np.round(finite)).all()) and longest < 2**52
    rows = (finite.astype(np.int64) if whole else finite).tolist()
    words = [
        ["-1" if after else str(value) for value, after in zip(row, column, strict=True)]
        for row, column in zip(rows, closure.T, strict=True)
    ]
    return write_text(path, sop_text(model.name or "ordering", f"{model.size} nodes", words))


def write_ordering_csv(
    plan: SequentialOrderingPlan, path: str | os.PathLike[str], *, model: SequentialOrdering
) -> Path:
    """Write an order as CSV with the columns ``stop,node,distance,length``; return the path.

    `distance` is that from the node before, and `length` the sum up to the node.

    Parameters
    ----------
    plan, path, model
        The order, file to write, and model of the plan.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InvalidData
        The plan contains an unknown node, or the file cannot be written.
    """
    order = _order(plan, model)
    legs = np.append(0.0, model.distances[order[:-1], order[1:]])[: len(order)]
    sums = np.cumsum(legs).tolist()
    rows = zip(range(len(order)), map(model.label, order), legs.tolist(), sums, strict=True)
    return write_rows(path, ("stop", "node", "distance", "length"), rows)


def write_path(
    plan: SequentialOrderingPlan, path: str | os.PathLike[str], *, model: SequentialOrdering
) -> Path:
    """Write an order as a tour of TSPLIB, with nodes counted from 1; return the path.

    Parameters and exceptions are those of :func:`write_ordering_csv`.
    """
    nodes = [node + 1 for node in _order(plan, model)]
    return write_text(path, tour_text(model.name.strip() or "ordering", model.size, nodes))


def _order(plan: SequentialOrderingPlan, model: SequentialOrdering) -> list[int]:
    required("model", model, SequentialOrdering)
    order = required("plan", plan, SequentialOrderingPlan).order
    other = next((node for node in order if not 0 <= node < model.size), None)
    if other is not None:
        raise InvalidData(f"order must hold nodes 0 … {model.size - 1}, got {other}", field="order")
    return list(order)


def _content(file: Path) -> dict[str, Any]:
    """Return the data of a file, without the names of its nodes."""
    items = read_ordering(file).data().items()
    return {key: value for key, value in items if key != "ids" and len(value)}


def resolve_references(data: Mapping[str, Any], find: Find) -> dict[str, Any]:
    """Return instance data with the content of the file in ``"sop": "file.sop"``."""
    return reference("sop", _content, only=True)(data, find)


CSV = ExportFormat("one row per node (CSV)", ".csv", write_ordering_csv)
TSPLIB = ExportFormat("a tour of TSPLIB", ".tour", write_path)
