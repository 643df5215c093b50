"""Flights through maps: corridors of convex polytopes and trajectories inside them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .corridors import Corridor as Corridor, corridor as corridor
    from .voxels import VoxelMap as VoxelMap

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
