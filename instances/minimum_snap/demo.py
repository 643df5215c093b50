"""The demonstration of minimum-snap trajectories: an eight with a turning heading."""

from __future__ import annotations

from ..demos import Demo

__all__ = ["DEMO"]

DEMO = Demo("minimum-snap/figure-eight-yaw")
