"""How a search ends: one number for the kernels, which know no enumerations."""

from __future__ import annotations

__all__ = ["FOUND", "FULL", "NOTHING", "STOPPED"]

#: A route; no route; stopped from outside; out of room for labels.
FOUND, NOTHING, STOPPED, FULL = 1, 0, -1, -2
