"""Fleet routing on a map with obstacles, from polygons to trajectories."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .curves import lengths_of as lengths_of
    from .model import FleetMission as FleetMission
    from .moving import MovingObstacle as MovingObstacle
    from .plan import MissionPlan as MissionPlan

#: Private names that modules of other problems import.
SHARED = (
    "collision.Obstacles",
    "collision.Solids",
    "collision.deepest",
    "curves.Pieces",
    "curves.nearest",
    "curves.pieces_of",
)
MODELS = {"fleet-mission": ".model:FleetMission"}
PICTURES = {"fleet-mission": ".plot:draw"}
ANIMATIONS = {"fleet-mission": ".plot:animate_mission"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
