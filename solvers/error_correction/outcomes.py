"""How a search ends: one number for the kernels, which know no enumerations."""

from __future__ import annotations

__all__ = ["DEAR", "FOUND", "FULL", "NOTHING", "STOPPED"]

#: A route; no route; stopped from outside; out of room for labels; more labels than were allowed.
FOUND, NOTHING, STOPPED, FULL, DEAR = 1, 0, -1, -2, -3
