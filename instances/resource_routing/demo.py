"""The demonstration of routes with resources: a network of streets, proven by two methods."""

from __future__ import annotations

from ..demos import Demo

__all__ = ["DEMO"]

DEMO = Demo("resource-routing/network-20")
