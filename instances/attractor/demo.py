"""The demonstration of attractors: the path of a robot in a hunt, as in the paper."""

from __future__ import annotations

from ..demos import Demo

__all__ = ["DEMO"]

DEMO = Demo("attractor/hunt")
