"""``portfolio``: searches in turn, chosen by the number of variables and of evaluations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...jit import clock
from .native import BlackBoxBackend, Objective
from .pymoo_searches import CmaEs
from .scipy_searches import Cobyqa, DifferentialEvolution, DualAnnealing
from .surrogate import SurrogateSearch

__all__ = ["Portfolio", "stages"]

#: A search, the share of the evaluations and of the time after which it ends, and its options.
Stage = tuple[type[BlackBoxBackend], float, dict[str, Any]]

#: Evaluations per variable up to which they are few, or some.
_FEW, _SOME = 35, 150
#: Largest number of evaluations of the surrogate search.
_MODELLED = 500
#: Largest number of variables of the evolution strategy's quadratic model, which has d (d + 3) / 2 + 1
#: coefficients: a fit takes 0.1 s with 40 variables and more than a minute with 100.
_FITTED = 40
#: Duration of an evaluation (s) above which a time limit, not the budget, may determine the stages.
_SLOW = 0.01


def stages(dimension: int, evaluations: int, parallel: bool = False) -> list[Stage]:
    """Return the searches in their order. The last one uses all remaining evaluations.

    The shares were chosen on the development set of ``tests/benchmarks/black_box/search_ranks.py``, never on the
    functions of the published table.

    Parameters
    ----------
    dimension, evaluations : int
        Number of free variables and of evaluations.
    parallel : bool
        Whether several points are evaluated at once. Searches that request single points are then left out.
    """
    many, few = evaluations > _SOME * dimension, evaluations <= _FEW * dimension
    parts: list[Stage]
    if parallel:
        parts = [] if few else [(CmaEs, 1.0 if many else 0.6, {})]
        return [*parts, (SurrogateSearch, 1.0, {}), (DifferentialEvolution, 1.0, {})]
    if many:
        parts = [_local(0.05), (DualAnnealing, 0.2, {}), (CmaEs, 1.0, {})]
    else:
        # Share of the evaluations before the surrogate search.
        share = max(1.0 - _MODELLED / evaluations, 0.0)
        local, evolved = (max(0.35, min(share, 0.6)), share) if few else (0.2, max(0.6, share))
        parts = [_local(local)]
        if evolved > local:
            parts.append((CmaEs, evolved, {"surrogate": dimension <= _FITTED, "sigma": 0.2}))
        parts.append((SurrogateSearch, 1.0, {"surrogate": _MODELLED}))
    return [*parts, (DualAnnealing, 1.0, {})]


def _local(share: float) -> Stage:
    return Cobyqa, share, {"restarts": False, "radius": 0.25}


class Portfolio(BlackBoxBackend):
    """Searches of different kinds in turn, each from the best point of those before it.

    No search is best on all functions. All runs begin with local quadratic models. With few evaluations a
    surrogate search follows, with more of them first an evolution strategy with a quadratic model. With many
    evaluations, annealing and an evolution strategy with restarts follow. A search whose library is missing is
    left out.
    """

    name = "portfolio"
    summary = "local models, then surrogates or annealing and an evolution strategy, by the budget"
    requires = ("scipy",)

    def prepare(self) -> None:
        """Import the libraries of all stages, outside of the time limit."""
        for kind in (Cobyqa, CmaEs):
            if not kind().missing():
                kind().prepare()

    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Evaluate the centre, then run the searches in turn."""
        count = objective.granted
        unit = np.full((1, objective.dimension), 0.5)
        for _ in range(2):  # the first evaluation may compile or load something
            begin = clock()
            objective(unit)
            seconds = (clock() - begin) / objective.parallel
            if seconds < _SLOW or objective.affordable(seconds) == objective.granted:
                break
            unit = objective.generator.random(unit.shape)
        else:
            count = objective.affordable(seconds)
        for kind, share, options in stages(objective.dimension, count, objective.parallel > 1):
            search = kind()
            if kind is Cobyqa and objective.problem.layout.discrete[objective.free].all():
                continue  # rounded variables have no slopes
            if not (search.missing() or search.refuses(objective.problem)):
                objective.run_stage(share, search, **options)
        return {}
