"""Routes of several robots, with a balanced workload."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .data import Deviation as Deviation, Metric as Metric, Objective as Objective
    from .model import FleetRouting as FleetRouting
    from .plan import FleetPlan as FleetPlan

#: Names that modules of other problems import, beside the public ones.
SHARED = ("checks.objective_of",)
MODELS = {"fleet-routing": ".model:FleetRouting"}
PICTURES = {"fleet-routing": ".plot:draw"}
ANIMATIONS = {"fleet-routing": ".plot:animate_routes"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
