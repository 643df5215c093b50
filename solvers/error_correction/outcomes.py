"""Status codes of searches, as whole numbers for the kernels."""

from __future__ import annotations

__all__ = ["DEAR", "FOUND", "FULL", "NOTHING", "OPEN", "STOPPED"]

from ..resource_routing.outcomes import FOUND, FULL, NOTHING, OPEN, STOPPED

#: The search exceeded its budget of labels.
DEAR = -4
