"""Export of a guided vehicle's tours as tables and as TSPLIB tours."""

from __future__ import annotations

import os
from pathlib import Path

from ...errors import InvalidData, UnsupportedFormulation
from ...files import write_text
from ...models.fields import required
from ...models.guided_path.extensions import name_unsupported
from ...models.guided_path.model import GuidedPathTour
from ...models.guided_path.plan import GuidedPathPlan
from ...models.guided_path.schedule import labels_of, walk_of
from ..exports import ExportFormat
from ..tables import write_rows
from .sop import tour_text

__all__ = ["CSV", "TSPLIB", "write_stops_csv", "write_tour"]


def write_stops_csv(
    plan: GuidedPathPlan, path: str | os.PathLike[str], *, model: GuidedPathTour
) -> Path:
    """Write a tour as CSV with one row per stop; return the path.

    The columns are ``stop,customer,x,walked``: the number of the stop from 0, the name of the
    customer, its coordinate and the distance walked up to it, in m. The first and the last row are
    the start. With optional fields, the columns ``vehicle``, ``begin`` (s) and ``load`` follow, and the last
    row is the end, named ``end`` if it is not the start. The file is written atomically.

    Parameters
    ----------
    plan, path, model
        The tour, file to write, and model of the plan.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InvalidData
        The plan contains an unknown customer, or the file cannot be written.
    """
    stops = _stops(plan, model)
    walk, names = walk_of(model, plan), ["stop", "customer", "x", "walked"]
    places = model.coordinates[stops].tolist()
    places[-1] = (
        model.end if isinstance(model.end, float) else places[-2 if model.end == "free" else -1]
    )
    columns = [range(len(stops)), labels_of(model, walk), places, walk.walked.tolist()]
    if model.vehicles is not None:
        names, columns = [*names, "vehicle"], [*columns, walk.vehicles]
    if model.speed is not None:
        names, columns = [*names, "begin"], [*columns, walk.begin.tolist()]
    if model.loads is not None:
        names, columns = [*names, "load"], [*columns, walk.load.tolist()]
    return write_rows(path, names, zip(*columns, strict=True))


def write_tour(
    plan: GuidedPathPlan, path: str | os.PathLike[str], *, model: GuidedPathTour
) -> Path:
    """Write a tour in TSPLIB format; return the path.

    Nodes are numbered as in :func:`~crosstrack.instances.guided_path.write_sop`: the start is 1,
    customer k is k + 1, and the end is the last node. The file is written atomically.

    Parameters
    ----------
    plan, path, model
        The tour, file to write, and model of the plan.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InvalidData
        The plan contains an unknown customer, or the file cannot be written.
    UnsupportedFormulation
        The model has optional fields.
    """
    if reason := name_unsupported(model):
        raise UnsupportedFormulation(f"a tour of TSPLIB does not cover {reason}")
    stops = _stops(plan, model)
    nodes = [*(stop + 1 for stop in stops[:-1]), model.size + 1]
    return write_text(path, tour_text(model.name, model.size + 1, nodes))


def _stops(plan: GuidedPathPlan, model: GuidedPathTour) -> list[int]:
    """Return the customers of a plan with the start at both ends."""
    required("model", model, GuidedPathTour)
    order = required("plan", plan, GuidedPathPlan).order
    other = next((x for x in order if not 1 <= x < model.size), None)
    if other is not None:
        raise InvalidData(
            f"order must hold customers 1 … {model.size - 1}, got {other}", field="order"
        )
    model.verify(plan)  # rejects unknown vehicles
    return [0, *order, 0]


CSV = ExportFormat("one row per stop (CSV)", ".csv", write_stops_csv)
TSPLIB = ExportFormat("a tour of TSPLIB", ".tour", write_tour)
