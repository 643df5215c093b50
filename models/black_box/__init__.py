"""Minimum of a function that can only be evaluated, such as the cost of a path."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .functions import Named as Named, PythonFunction as PythonFunction
    from .model import BlackBoxMinimisation as BlackBoxMinimisation
    from .plan import BlackBoxPoint as BlackBoxPoint
    from .waypoints import (
        WaypointPath as WaypointPath,
        as_grid_plan as as_grid_plan,
        path_problem as path_problem,
    )

MODELS = {"black-box": ".model:BlackBoxMinimisation"}
PICTURES = {"black-box": ".plot:draw"}
ANIMATIONS = {"black-box": ".plot:animate_search"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
