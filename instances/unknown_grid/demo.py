"""Demonstration of unknown grids: a pocket between start and target."""

from __future__ import annotations

from ..demos import Demo

__all__ = ["DEMO"]

DEMO = Demo("unknown-grid/u-trap")
