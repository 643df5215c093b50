"""Optimal control problems that you declare: states and controls over time, in phases."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .arcs import Arc as Arc, structure as structure
    from .checks import motion as motion
    from .declaration.tables import Table as Table, table as table
    from .estimation import Estimate as Estimate, covariance as covariance
    from .flights import (
        FlightLimit as FlightLimit,
        MonteCarlo as MonteCarlo,
        monte_carlo as monte_carlo,
    )
    from .hamiltonian import (
        HamiltonianReport as HamiltonianReport,
        MinimumReport as MinimumReport,
        hamiltonian_spread as hamiltonian_spread,
        minimum_principle as minimum_principle,
    )
    from .integration import Reintegration as Reintegration
    from .model import OptimalControlProblem as OptimalControlProblem
    from .piecewise import Piecewise as Piecewise
    from .plan import ControlPlan as ControlPlan, PhasePlan as PhasePlan, Signal as Signal
    from .rounding import RoundedPlan as RoundedPlan, round_controls as round_controls
    from .scenario import scenario_plan as scenario_plan, scenarios as scenarios
    from .simulation import Breach as Breach, Simulation as Simulation, simulate as simulate

#: Names used by modules of other problems, in addition to the public ones.
SHARED = (
    "lagrange.interpolation",
    "model.cached_verification",
    "plot.curves_of",
    "plot.guessed",
    "plot.nodes_of",
    "plot.sampled",
    "simulation.checked_function",
    "transcription.methods.Gauss",
)
MODELS = {"optimal-control": ".model:OptimalControlProblem"}
PICTURES = {"optimal-control": ".plot:draw"}
ANIMATIONS = {"optimal-control": ".plot:animate_control"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
