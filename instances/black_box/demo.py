"""Demonstration of black boxes: a function with many local minima."""

from __future__ import annotations

from ..demos import Demo

__all__ = ["DEMO"]

DEMO = Demo("black-box/example")
