"""The demonstration of fleet routing: three robots share ten nodes, proven by two exact methods."""

from __future__ import annotations

from ..demos import Demo

__all__ = ["DEMO"]

DEMO = Demo("fleet/max-10")
