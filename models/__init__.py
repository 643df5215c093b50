"""Models, their formulations as programs, and the verification of plans."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from ..lazy import attach

if TYPE_CHECKING:
    from .error_correction import (
        ErrorCorrectionRouting as ErrorCorrectionRouting,
        Route as Route,
    )
    from .formulation import Formulation as Formulation
    from .minimum_snap import (
        FREE as FREE,
        MinimumDerivative as MinimumDerivative,
        MinimumSnap as MinimumSnap,
        TimeAllocation as TimeAllocation,
        Trajectory as Trajectory,
    )
    from .model import Model as Model
    from .optimal_control import (
        ControlPlan as ControlPlan,
        OptimalControlProblem as OptimalControlProblem,
        PhasePlan as PhasePlan,
    )
    from .problems import (
        model_type as model_type,
        model_types as model_types,
        register_model as register_model,
    )
    from .programs import (
        Block as Block,
        ConeBlock as ConeBlock,
        ConeKind as ConeKind,
        ConicProgram as ConicProgram,
        MixedIntegerProgram as MixedIntegerProgram,
        NonlinearProgram as NonlinearProgram,
        Program as Program,
        ProgramBuilder as ProgramBuilder,
        QuadraticProgram as QuadraticProgram,
    )
    from .satellite_slew import (
        SatelliteSlew as SatelliteSlew,
        Tracking as Tracking,
        track as track,
    )
    from .verification import Check as Check, Verification as Verification

_get, _, __all__ = attach(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name in __all__ or name.startswith("_"):
        return _get(name)
    problems = importlib.import_module(".problems", __name__)
    for problem in problems.PROBLEMS:
        folder = importlib.import_module(f".{problem}", __name__)
        if name in folder.__all__:
            return getattr(folder, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
