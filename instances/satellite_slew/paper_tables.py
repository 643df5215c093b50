"""Our values for the result tables of the slew's paper."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np

from ...models.satellite_slew.data import VectorLimits
from ...models.satellite_slew.dynamics import SlewMotion
from ...models.satellite_slew.gyros import singularity_measure
from ...models.satellite_slew.model import SatelliteSlew
from ...models.satellite_slew.tracking import track
from ..paper import Run, Trials

__all__ = ["methods", "readings"]

#: Number of samples for the largest values of a plan.
SAMPLES = 4001
#: Disturbance of the tracked flights about each axis, N m.
DISTURBANCE = 0.1
#: Errors of quaternion and rates (rad/s) printed in the paper.
BOUNDS = (4e-4, 1e-3)
#: Backend with formulation, tolerance, and options of the formulation, by row.
METHODS: Mapping[str, tuple[str, float, Mapping[str, Any]]] = {
    "one interval, 20 nodes, SQP": ("slsqp:paper", 0.05, {"degree": 20, "refine": False}),
    "one interval, degree raised, interior point": ("ipopt:paper", 1e-2, {}),
    "Gauss, several intervals": ("ipopt:gauss", 1e-4, {}),
    "Radau, several intervals": ("ipopt:radau", 1e-4, {}),
    "Hermite-Simpson": ("ipopt:hermite-simpson", 1e-4, {}),
    "eigenaxis, pseudo-inverse": ("slew-pseudo-inverse", 1e-4, {}),
    "eigenaxis, generalised inverse": ("slew-generalised", 1e-4, {}),
}


def readings(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return final time, seconds, tracking errors and largest values of one reading of eq. 23."""
    reading, momentum = row
    model = SatelliteSlew(
        momentum=float(momentum),
        vector_limits=VectorLimits(reading),
        name=f"{reading}, h0 = {momentum}",
    )
    run = trials.run(model, "ipopt:gauss", runs=1, tolerance=1e-4)[0]
    if run.plan is None:
        return {"final time, s": str(run.termination)}
    phase = run.plan.phases[0]
    times = np.linspace(0.0, phase.end, SAMPLES)
    states, controls = phase.states(times), phase.controls(times)
    torque = SlewMotion.of(model).torque(states[:, 7:], controls)
    signs = product((-DISTURBANCE, DISTURBANCE), repeat=3)
    flights = [track(model, run.plan, disturbance=push, law="paper") for push in signs]
    errors = np.array([(flight.max_quaternion_error, flight.max_rate_error) for flight in flights])
    quaternion, rate = errors.max(axis=0)
    return {
        "final time, s": phase.end,
        "computing time, min": run.seconds["total"] / 60.0,
        "mean rate of turn, deg/s": float(np.rad2deg(model.turn[1])) / phase.end,
        "error of the quaternion": quaternion,
        "error of the rates, rad/s": rate,
        "flights within both errors": int((errors < BOUNDS).all(axis=1).sum()),
        "largest |w|, rad/s": np.linalg.norm(states[:, 4:7], axis=1).max(),
        "largest |T|, N m": np.linalg.norm(torque, axis=1).max(),
        "largest gimbal rate, rad/s": np.abs(controls).max(),
        "least det(A A')": singularity_measure(states[:, 7:], model.gyros).min(),
    }


def methods(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return final time, seconds and the worst violation of one method on ``satellite-slew/paper``."""
    from .listing import catalogue_entries

    entry = next(item for item in catalogue_entries() if item.name == "satellite-slew/paper")
    model = entry.build()
    backend, tolerance, options = METHODS[row[0]]
    run: Run = trials.run(
        model, backend, runs=1, tolerance=tolerance, formulation_options=options or None
    )[0]
    values = {
        "seconds": run.seconds.get("total"),
        "tolerance": tolerance,
        "verdict": str(run.termination),
    }
    if run.plan is None:
        return {**values, "final time, s": "no plan within the tolerance"}
    checks = model.verify(run.plan, tolerance=tolerance).checks
    worst = max(checks, key=lambda item: item.worst / item.scale)
    return {
        **values,
        "final time, s": run.plan.phases[0].end,
        "J, s": run.primal_bound,
        "worst violation": worst.worst / worst.scale,
        "at": worst.name,
    }
