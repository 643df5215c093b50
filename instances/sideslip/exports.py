"""Estimates of the sideslip angle as tables."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ...models.fields import required
from ...models.sideslip.model import SideslipEstimation
from ...models.sideslip.plan import SideslipEstimate
from ..exports import ExportFormat
from ..tables import write_rows

__all__ = ["CSV", "write_sideslip_csv"]

#: Header: the columns of a recording, and the claimed deviation.
_COLUMNS = (
    "time [s]", "sideslip [rad]", "deviation [rad]", "speed [m/s]", "steering [rad]",
    "yaw_rate [rad/s]", "lateral_acceleration [m/s^2]",
)  # fmt: skip


def write_sideslip_csv(
    plan: SideslipEstimate, path: str | os.PathLike[str], *, model: SideslipEstimation
) -> Path:
    """Write an estimate as CSV with one row per sample, atomically, and return the path.

    The columns are time (s), the estimated angle and its deviation (rad), and the measurements: speed
    (m/s), steering angle (rad), yaw rate (rad/s) and lateral acceleration (m/s²), with all digits.
    :func:`~crosstrack.instances.sideslip.read_recording` reads the file as a recording with the estimate as angle.

    Parameters
    ----------
    plan, path, model
        The estimate, file to write, and model of the plan.

    Returns
    -------
    pathlib.Path
        Path of the file.

    Raises
    ------
    InvalidData
        The estimate has another number of samples than the model, or the file cannot be written.
    """
    recording = required("model", model, SideslipEstimation).recording
    model.checked_plan(plan)
    table = np.column_stack(
        [
            *(recording.times, plan.sideslip, plan.deviation, recording.speed, recording.steering),
            *(recording.yaw_rate, recording.lateral_acceleration),
        ]
    )
    return write_rows(path, _COLUMNS, table.tolist())


CSV = ExportFormat("one row per sample (CSV)", ".csv", write_sideslip_csv)
