"""Demonstration of guided path tours: eight chains of five, proven by several exact methods."""

from __future__ import annotations

from ..demos import Demo

__all__ = ["DEMO"]

DEMO = Demo("guided-path/table-1-k8")
