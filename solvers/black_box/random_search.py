"""``random-search``: points drawn alike from everywhere, what any search has to be better than."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .native import BlackBoxBackend, Objective

__all__ = ["RandomSearch"]

#: Points asked for at once.
_BATCH = 256


class RandomSearch(BlackBoxBackend):
    """Uniformly drawn points."""

    name = "random-search"
    summary = "uniformly drawn points: what other searches are measured against"

    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Draw until the run is ended."""
        while True:
            objective(objective.generator.random((_BATCH, objective.dimension)))
