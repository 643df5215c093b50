"""Algorithms that minimise a function by its values alone."""

BACKENDS = {
    "portfolio": ".portfolio:Portfolio",
    "dual-annealing": ".scipy_searches:DualAnnealing",
    "differential-evolution": ".scipy_searches:DifferentialEvolution",
    "direct": ".scipy_searches:Direct",
    "shgo": ".scipy_searches:Shgo",
    "iafsa": ".fish:ImprovedFishSwarm",
    "haafsa": ".fish:HybridFishSwarm",
    "afsa": ".fish:FishSwarm",
    "cma-es": ".pymoo_searches:CmaEs",
    "particle-swarm": ".pymoo_searches:ParticleSwarm",
    "random-search": ".random_search:RandomSearch",
}
DIAGNOSES = {"black-box": ".diagnosis:diagnose_black_box"}
