"""The demonstration of black boxes: many local minima, the best of which is not in the middle."""

from __future__ import annotations

from ..demos import Demo

__all__ = ["DEMO"]

DEMO = Demo("black-box/example")
