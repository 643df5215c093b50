"""Algorithms that minimise a function by its values alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .asking import AskTell as AskTell

BACKENDS = {
    "portfolio": ".portfolio:Portfolio",
    "dual-annealing": ".scipy_searches:DualAnnealing",
    "differential-evolution": ".scipy_searches:DifferentialEvolution",
    "cobyqa": ".scipy_searches:Cobyqa",
    "direct": ".scipy_searches:Direct",
    "shgo": ".scipy_searches:Shgo",
    "iafsa": ".fish:ImprovedFishSwarm",
    "haafsa": ".fish:HybridFishSwarm",
    "afsa": ".fish:FishSwarm",
    "cma-es": ".pymoo_searches:CmaEs",
    "particle-swarm": ".pymoo_searches:ParticleSwarm",
    "nsga-ii": ".pymoo_searches:NsgaII",
    "surrogate-search": ".surrogate:SurrogateSearch",
    "random-search": ".random_search:RandomSearch",
}
DIAGNOSES = {"black-box": ".diagnosis:diagnose_black_box"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
