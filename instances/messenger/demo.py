"""Demonstration of messenger tours: ten vehicles with the paper's sparsity."""

from __future__ import annotations

from ..demos import Demo

__all__ = ["DEMO"]

DEMO = Demo("messenger/B-10-05")
