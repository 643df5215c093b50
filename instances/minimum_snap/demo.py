"""Demonstration of minimum-snap trajectories along a square."""

from __future__ import annotations

from ..demos import Demo

__all__ = ["DEMO"]

DEMO = Demo("minimum-snap/square")
