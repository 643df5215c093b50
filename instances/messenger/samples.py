"""Export of tours as tables for other software."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ...models.fields import required
from ...models.messenger.model import MessengerTour
from ...models.messenger.plan import TourPlan
from ...models.messenger.sampling import track
from ...models.sampling import sample_count
from ..exports import ExportFormat
from ..tables import write_rows

__all__ = ["SAMPLES", "write_tour_samples"]


def write_tour_samples(
    plan: TourPlan, path: str | os.PathLike[str], *, model: MessengerTour, rate: float = 10.0
) -> Path:
    """Write the poses along a tour at equal time steps as CSV; return the path.

    The columns are ``t,x,y,heading,leg``: s, m, m, rad, and the number of the leg, from 0. Headings
    are counter-clockwise from the x axis, and are not wrapped. In wind, places are over the ground, and
    headings are relative to the air. With several UAVs, a column ``uav`` has the index of the UAV, and the
    rows of each end at its last encounter or at its home. The file is written atomically.

    Parameters
    ----------
    plan : TourPlan
        The tour.
    path : path-like
        The file.
    model : MessengerTour
        Model of the plan, for its speed, turning radius and wind.
    rate : float
        Samples per second (Hz). The end of the tour is always included.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InvalidData
        The rate is not positive, or yields too many samples, or the file cannot be written.
    """
    required("plan", plan, TourPlan)
    required("model", model, MessengerTour)
    duration = plan.length / model.speed
    times = np.arange(sample_count(duration, rate) + 1) / rate
    rows: list[tuple[float, ...]] = []
    for uav, part in enumerate(plan.parts()):
        end = part.length / model.speed
        now = np.append(times[times < end * (1 - 1e-9)], end)
        samples = track(part, model.turning_radius, now * model.speed, model.drift)
        more = [[uav] * len(now)] if plan.shares else []
        rows += zip(
            now.tolist(), *samples.poses.T.tolist(), samples.legs.tolist(), *more, strict=True
        )
    columns = ("t", "x", "y", "heading", "leg", "uav")
    return write_rows(path, columns if plan.shares else columns[:-1], rows)


SAMPLES = ExportFormat("samples of the path (CSV)", ".csv", write_tour_samples)
