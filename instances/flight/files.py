"""Files of flights: samples, and pieces for Crazyflies."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ...models.fields import required
from ...models.flight.plan import FlightPlan
from ...models.minimum_snap.trajectory import Trajectory
from ..exports import ExportFormat
from ..minimum_snap.poly7 import Poly7Report, write_poly7
from ..minimum_snap.tables import write_samples

__all__ = ["POLY7", "SAMPLES", "write_flight_poly7", "write_flight_samples"]


def write_flight_samples(
    plan: FlightPlan, path: str | os.PathLike[str], *, rate: float = 100.0, derivatives: int = 4
) -> Path:
    """Write samples of the curve of a flight at equal time steps as CSV; return the path.

    Parameters
    ----------
    plan : FlightPlan
        The flight.
    path : path-like
        File to write.
    rate : float
        Samples per second (Hz), 100 by default. The last knot is always included.
    derivatives : int
        Highest order of a written derivative; 4, snap, by default.
    """
    curve = required("plan", plan, FlightPlan).trajectory
    return write_samples(curve, path, rate=rate, derivatives=derivatives)


def write_flight_poly7(
    plan: FlightPlan, path: str | os.PathLike[str], *, height: float = 1.0, strict: bool = False
) -> Poly7Report:
    """Write the curve of a flight as a poly7 file, as Crazyflies fly it, and report the rounding.

    Parameters
    ----------
    plan : FlightPlan
        The flight.
    path : path-like
        File to write.
    height : float
        z of a flight in two dimensions, m.
    strict : bool
        Refuse more pieces than fit into the firmware's memory, instead of reporting it.
    """
    curve = required("plan", plan, FlightPlan).trajectory
    if curve.dimensions == 2:
        level = np.zeros((curve.segments, curve.degree + 1, 1))
        level[:, 0] = height
        curve = Trajectory(curve.times, np.concatenate([curve.coefficients, level], axis=2))
    return write_poly7(curve, path, strict=strict)


SAMPLES = ExportFormat("samples of all derivatives (CSV)", ".csv", write_flight_samples)
POLY7 = ExportFormat(
    "pieces of degree 7 as a Crazyflie flies them (CSV)", ".csv", write_flight_poly7
)
