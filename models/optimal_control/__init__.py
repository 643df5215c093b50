"""Optimal control: states and controls over time, in phases."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .checks import motion as motion
    from .hamiltonian import (
        HamiltonianReport as HamiltonianReport,
        hamiltonian_spread as hamiltonian_spread,
    )
    from .integration import Reintegration as Reintegration
    from .model import OptimalControlProblem as OptimalControlProblem
    from .plan import (
        ControlPlan as ControlPlan,
        PhasePlan as PhasePlan,
        Piecewise as Piecewise,
        Signal as Signal,
    )

MODELS = {"optimal-control": ".model:OptimalControlProblem"}
PICTURES = {"optimal-control": ".plot:draw"}

__getattr__, __dir__, __all__ = attach(
    __name__,
    {
        "checks": ("motion",),
        "hamiltonian": ("HamiltonianReport", "hamiltonian_spread"),
        "integration": ("Reintegration",),
        "model": ("OptimalControlProblem",),
        "plan": ("ControlPlan", "PhasePlan", "Piecewise", "Signal"),
    },
)
