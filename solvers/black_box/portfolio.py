"""``portfolio``: a division of the cube, then an evolution strategy, then annealing from the best point."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .native import BlackBoxBackend, Objective
from .pymoo_searches import CmaEs
from .scipy_searches import Direct, DualAnnealing

__all__ = ["Portfolio"]

#: Searches in their order, and the share of the evaluations and the time after which each ends. Over the
#: catalogue, each is the best on functions on which another one is far off.
_STAGES: tuple[tuple[type[BlackBoxBackend], float], ...] = (
    (Direct, 0.1),
    (CmaEs, 0.5),
    (DualAnnealing, 1.0),
)


class Portfolio(BlackBoxBackend):
    """Three searches of different kinds in turn, each from the best point of those before it.

    No search is best on all functions. The evaluations are divided between a deterministic division of
    the cube, an evolution strategy, which follows valleys, and annealing with local searches, which
    gives the most digits on smooth functions. A search whose library is missing is left out.
    """

    name = "portfolio"
    summary = "direct, cma-es and dual-annealing in turn, each from the best point so far"
    requires = ("scipy",)

    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Evaluate the centre, then run the searches in turn."""
        # Importing the libraries may take as long as a short time limit.
        objective(np.full((1, objective.dimension), 0.5))
        for kind, share in _STAGES:
            search = kind()
            if not (search.missing() or search.refuses(objective.problem)):
                search.prepare()
                objective.run_stage(share, search)
        return {}
