"""``random-search``: uniform random points, the baseline of other searches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .native import BlackBoxBackend, Objective

__all__ = ["RandomSearch"]

#: Number of points per request.
_BATCH = 256


class RandomSearch(BlackBoxBackend):
    """Uniform random points."""

    name = "random-search"
    summary = "uniform random points, the baseline of other searches"
    several_objectives = True

    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Draw points until the run ends."""
        shape = _BATCH, objective.dimension
        points = objective.generator.random(shape)
        objective.begin(points)
        while True:
            following = objective.generator.random(shape)
            objective.begin(following)  # no worker waits for the slowest point of a batch
            objective(points)
            points = following
