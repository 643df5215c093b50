"""Smoothest trajectory through waypoints, with corridors, limits and free times."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .bounds import (
        FREE as FREE,
        Bound as Bound,
        Halfspaces as Halfspaces,
        derivative_name as derivative_name,
    )
    from .gates import Gate as Gate
    from .model import MinimumDerivative as MinimumDerivative, MinimumSnap as MinimumSnap
    from .time_allocation import TimeAllocation as TimeAllocation
    from .trajectory import Extremes as Extremes, Trajectory as Trajectory
    from .vehicles import (
        DifferentialDrive as DifferentialDrive,
        PointMass as PointMass,
        Quadrotor as Quadrotor,
    )

#: Private names that modules of other problems import.
SHARED = (
    "bounds.derivative_unit",
    "motion.heading_jumps",
    "polynomials.bernstein_matrix",
    "polynomials.derived",
    "polynomials.factorials",
    "polynomials.gauss_legendre",
    "vehicles.Vehicle",
    "vehicles.VehicleSpec",
)
MODELS = {
    "minimum-derivative": ".model:MinimumDerivative",
    "minimum-snap": ".model:MinimumSnap",
    "time-allocation": ".time_allocation:TimeAllocation",
}
PICTURES = dict.fromkeys(MODELS, ".plot.picture:draw")
ANIMATIONS = dict.fromkeys(MODELS, ".plot.picture:animate_flight")

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
