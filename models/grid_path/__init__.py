"""Shortest paths on a grid of free and blocked cells."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .gridmap import GridMap as GridMap
    from .model import Connectivity as Connectivity, GridPath as GridPath, Reach as Reach
    from .plan import GridPlan as GridPlan
    from .shortest import distances as distances
    from .trails import trail as trail

MODELS = {"grid-path": ".model:GridPath"}

__getattr__, __dir__, __all__ = attach(
    __name__,
    {
        "gridmap": ("GridMap",),
        "model": ("Connectivity", "GridPath", "Reach"),
        "plan": ("GridPlan",),
        "shortest": ("distances",),
        "trails": ("trail",),
    },
)
