"""The demonstration of fleet missions: three robots, one map, equal batteries."""

from __future__ import annotations

from ..demos import Demo

__all__ = ["DEMO"]

DEMO = Demo("fleet-mission/example")
