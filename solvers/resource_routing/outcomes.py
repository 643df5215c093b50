"""How a search ends: one number for the kernels, which know no enumerations."""

from __future__ import annotations

__all__ = ["FOUND", "FULL", "NOTHING", "OPEN", "STOPPED"]

#: A proven route; proof that no route exists; stopped from outside; out of room for labels; ended without a
#: proof.
FOUND, NOTHING, STOPPED, FULL, OPEN = 1, 0, -1, -2, -3
