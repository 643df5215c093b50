"""The recorded race-track drive of Stanford's Revs program in ../shared/data/sideslip, for tests and benchmarks."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from crosstrack.instances.sideslip import read_recording
from crosstrack.models import SideslipEstimation
from crosstrack.models.sideslip import Recording, Vehicle

FILE = Path(__file__).resolve().parents[3] / "shared/data/sideslip/stanford-250lm-first-half.csv"
#: Columns of the file by the names of a recording.
COLUMNS = {
    "time": "t (s)", "speed": "vx (m/s)", "lateral_acceleration": "ay (m/s^2)", "steering": "delta (rad)",
    "yaw_rate": "yaw rate (rad/s)", "sideslip": "beta (rad)", "longitudinal_acceleration": "ax (m/s^2)",
}  # fmt: skip
#: Rough guess of the car, a mid-engined racing car, and the car of the catalogue, which is another one.
GUESS = Vehicle(1100.0, 1300.0, 1.35, 1.05, 90_000.0, 140_000.0)
OTHER = Vehicle(1818.2, 3885.0, 1.463, 1.585, 62_618.0, 110_185.0)
#: Share of the file for training. The rest is for the test.
SHARE = 0.6


def whole() -> Recording:
    """Return the drive with its measured angle."""
    return read_recording(FILE, columns=COLUMNS)


def cut(drive: Recording, begin: int, end: int) -> Recording:
    """Return the samples from `begin` to before `end`."""
    names = [*COLUMNS]
    names[names.index("time")] = "times"
    return Recording(**{name: getattr(drive, name)[begin:end] for name in names})


def model(
    here: Recording, training: list[Recording], vehicle: Vehicle = GUESS
) -> SideslipEstimation:
    """Return the estimation of a part of the drive with other parts for training."""
    names = (
        "times",
        "speed",
        "steering",
        "yaw_rate",
        "lateral_acceleration",
        "longitudinal_acceleration",
    )
    recording = Recording(**{name: getattr(here, name) for name in names})
    return SideslipEstimation(vehicle, recording, training=training, truth=here.sideslip)


def folds(drive: Recording, count: int) -> list[tuple[Recording, list[Recording]]]:
    """Return each of `count` equal parts with the other parts."""
    edges = np.linspace(0, len(drive), count + 1).astype(int).tolist()
    parts = [cut(drive, begin, end) for begin, end in pairwise(edges)]
    return [(part, [other for other in parts if other is not part]) for part in parts]
