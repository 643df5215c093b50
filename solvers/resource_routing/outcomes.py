"""Status codes of searches, as whole numbers for the kernels."""

from __future__ import annotations

__all__ = ["DEAR", "FOUND", "FULL", "NOTHING", "OPEN", "STOPPED"]

#: Optimal route proven; infeasibility proven; stopped by the flag; out of memory for labels; ended
#: without a proof; budget of labels exceeded.
FOUND, NOTHING, STOPPED, FULL, OPEN, DEAR = 1, 0, -1, -2, -3, -4
