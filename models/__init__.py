"""WHAT is asked: models, their formulations as programs, and the check of a plan."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .attitude_tracking import Tracking, track
    from .builder import ProgramBuilder
    from .control_plan import ControlPlan, PhasePlan
    from .error_correction import ErrorCorrectionRouting, Route
    from .formulation import Formulation
    from .minimum_snap import FREE, MinimumDerivative, MinimumSnap
    from .model import Model
    from .optimal_control import OptimalControlProblem
    from .programs import (
        Block,
        MixedIntegerProgram,
        NonlinearProgram,
        Program,
        QuadraticProgram,
    )
    from .satellite_slew import SatelliteSlew
    from .time_allocation import TimeAllocation
    from .trajectory import Trajectory
    from .verification import Check, Verification

__all__ = [
    "FREE",
    "Block",
    "Check",
    "ControlPlan",
    "ErrorCorrectionRouting",
    "Formulation",
    "MinimumDerivative",
    "MinimumSnap",
    "MixedIntegerProgram",
    "Model",
    "NonlinearProgram",
    "OptimalControlProblem",
    "PhasePlan",
    "Program",
    "ProgramBuilder",
    "QuadraticProgram",
    "Route",
    "SatelliteSlew",
    "TimeAllocation",
    "Tracking",
    "Trajectory",
    "Verification",
    "model_type",
    "model_types",
    "register_model",
    "track",
]

_HOMES = {
    "FREE": "minimum_snap",
    "Block": "programs",
    "Check": "verification",
    "ControlPlan": "control_plan",
    "ErrorCorrectionRouting": "error_correction",
    "Formulation": "formulation",
    "MinimumDerivative": "minimum_snap",
    "MinimumSnap": "minimum_snap",
    "MixedIntegerProgram": "programs",
    "Model": "model",
    "NonlinearProgram": "programs",
    "OptimalControlProblem": "optimal_control",
    "PhasePlan": "control_plan",
    "Program": "programs",
    "ProgramBuilder": "builder",
    "QuadraticProgram": "programs",
    "Route": "error_correction",
    "SatelliteSlew": "satellite_slew",
    "TimeAllocation": "time_allocation",
    "Tracking": "attitude_tracking",
    "Trajectory": "trajectory",
    "Verification": "verification",
    "track": "attitude_tracking",
}

#: Model types by their JSON name, loaded when first asked for.
_TYPES: dict[str, str | type[Model[Any]]] = {
    "error-correction": ".models.error_correction:ErrorCorrectionRouting",
    "minimum-derivative": ".models.minimum_snap:MinimumDerivative",
    "minimum-snap": ".models.minimum_snap:MinimumSnap",
    "mixed-integer-program": ".models.programs:MixedIntegerProgram",
    "nonlinear-program": ".models.programs:NonlinearProgram",
    "optimal-control": ".models.optimal_control:OptimalControlProblem",
    "quadratic-program": ".models.programs:QuadraticProgram",
    "satellite-slew": ".models.satellite_slew:SatelliteSlew",
    "time-allocation": ".models.time_allocation:TimeAllocation",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__


def model_types() -> tuple[str, ...]:
    """Return the JSON names of all model types."""
    return tuple(_TYPES)


def model_type(kind: str) -> type[Model[Any]]:
    """Return the model type with the JSON name `kind`; ``UnknownName`` where there is none."""
    from ..errors import UnknownName
    from .model import resolve

    if kind not in _TYPES:
        raise UnknownName("model", kind, _TYPES)
    found: type[Model[Any]] = resolve(_TYPES[kind])
    return found


def register_model(cls: type[Model[Any]]) -> type[Model[Any]]:
    """Make a user's model type readable from JSON by its ``kind``; usable as a decorator."""
    _TYPES[cls.kind] = cls
    return cls
