"""How a search ends: one number for the kernels, which know no enumerations."""

from __future__ import annotations

__all__ = ["DEAR", "FOUND", "FULL", "NOTHING", "OPEN", "STOPPED"]

from ..resource_routing.outcomes import FOUND, FULL, NOTHING, OPEN, STOPPED

#: More labels than were allowed.
DEAR = -4
