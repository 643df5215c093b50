"""Flight of a vehicle from a start to a goal on a map, within its limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .corridors import Corridor as Corridor, corridor as corridor
    from .model import Flight as Flight, FlightObjective as FlightObjective
    from .plan import FlightPlan as FlightPlan
    from .voxels import VoxelMap as VoxelMap

MODELS = {"flight": ".model:Flight"}
PICTURES = {"flight": ".plot:draw"}
ANIMATIONS = {"flight": ".plot:animate_flight"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
