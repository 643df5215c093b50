"""Tours as tables that other software reads."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ...files import write_text
from ...models.fields import required
from ...models.messenger.model import MessengerTour
from ...models.messenger.plan import TourPlan
from ...models.messenger.sampling import track
from ...models.sampling import sample_count
from ..exports import ExportFormat

__all__ = ["SAMPLES", "write_tour_samples"]


def write_tour_samples(
    plan: TourPlan, path: str | os.PathLike[str], *, model: MessengerTour, rate: float = 10.0
) -> Path:
    """Write the path of a tour at equal steps of time as CSV, in one step; return the path.

    The columns are ``t,x,y,heading,leg``: s, m, m, rad, and the number of the leg, from 0. Headings
    are counter-clockwise from the x axis, and are not wrapped.

    Parameters
    ----------
    plan : TourPlan
        The tour.
    path : path-like
        The file.
    model : MessengerTour
        What it is for, which tells speed and turning radius.
    rate : float
        Samples a second (Hz); the end is always included.

    Raises
    ------
    InvalidData
        A rate that is no number > 0 or gives too many samples, or a file that cannot be written.
    """
    required("plan", plan, TourPlan)
    required("model", model, MessengerTour)
    duration = plan.length / model.speed
    times = np.arange(sample_count(duration, rate) + 1) / rate
    times = np.append(times[times < duration * (1 - 1e-9)], duration)
    found = track(plan, model.turning_radius, times * model.speed)
    table = zip(times.tolist(), *found.poses.T.tolist(), found.legs.tolist(), strict=True)
    lines = [",".join(map(repr, row)) for row in table]
    return write_text(path, "\n".join(["t,x,y,heading,leg", *lines]) + "\n")


SAMPLES = ExportFormat("samples of the path (CSV)", ".csv", write_tour_samples)
