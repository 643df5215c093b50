"""The demonstration of attractors: a robot's way in a hunt, as the paper records it."""

from __future__ import annotations

from ..demos import Demo

__all__ = ["DEMO"]

DEMO = Demo("attractor/hunt")
