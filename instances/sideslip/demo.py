"""Demonstration of sideslip estimation: the paper's double lane change."""

from __future__ import annotations

from ..demos import Demo

__all__ = ["DEMO"]

DEMO = Demo("sideslip/lane-change")
