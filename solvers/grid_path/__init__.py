"""Solvers of shortest paths on grid maps, with kernels compiled by Numba."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .prepared import PathAnswer as PathAnswer, PreparedMap as PreparedMap

#: Private names that modules of other problems import.
SHARED = ("smoothing.smooth",)
BACKENDS = {
    "a-star": ".exact:AStar",
    "dijkstra": ".exact:Dijkstra",
    "jump-point": ".exact:JumpPoint",
    "any-angle": ".any_angle:AnyAngle",
    "theta-star": ".theta_star:ThetaStar",
    "shortcut-visibility": ".smoothing:ShortcutVisibility",
    "shortcut-greedy": ".smoothing:ShortcutGreedy",
    "rrt-star": ".rrt_star:RRTStar",
}
DIAGNOSES = {"grid-path": ".diagnosis:diagnose_path"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
