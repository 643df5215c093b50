"""Searches of others: ``cma-es`` by ``cma``, ``particle-swarm`` by ``pymoo``, which brings ``cma``.

The covariance matrix adaptation is asked for from ``cma`` itself: pymoo's wrapper of it swallows every
exception, so that a run that must end would seem to have converged.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..backend import Option
from .native import BlackBoxBackend, Objective, latin_hypercube

__all__ = ["CmaEs", "ParticleSwarm"]

Floats = NDArray[np.float64]

#: Restarts that double the number of points; those that follow have as many as the last.
_DOUBLED = 9
#: Share of the cube within which all particles' best places lie when a swarm has converged.
_CONVERGED = 1e-8


class CmaEs(BlackBoxBackend):
    """Evolution by a normal distribution whose covariance adapts, restarted with twice as many points.

    N. Hansen and A. Ostermeier, Evolutionary Computation 9 (2001); A. Auger and N. Hansen, "A restart CMA
    evolution strategy with increasing population size", IEEE CEC 2005.
    """

    name = "cma-es"
    summary = "covariance matrix adaptation (cma), restarted with ever more points"
    requires = ("cma",)
    extra = "blackbox"
    options: ClassVar[Mapping[str, Option]] = {
        "sigma": Option(
            0.3,
            "Standard deviation at the start, as a share of each range.",
            lower=1e-9,
            upper=10.0,
        ),
        "population": Option(
            None,
            "Points of the first generation; 4 + 3 ln d where None.",
            int,
            lower=3,
            upper=10**6,
        ),
    }
    most = 1000
    grows = "its matrix has their square"

    def prepare(self) -> None:
        """Load what the search needs: no part of a time limit."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of libraries that it could use for pictures
            import cma  # noqa: F401

    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Evolve, from a drawn point after the first time, until the run is ended."""
        from cma import CMAEvolutionStrategy

        d = objective.dimension
        size = max(d, 2)  # cma knows no single variable: a second one, which counts for nothing
        asked: dict[str, Any] = {
            "bounds": [0.0, 1.0],
            "verbose": -9,
            "verb_log": 0,
            "seed": np.nan,  # no seed of NumPy's own generator, which others may use
            "randn": lambda *shape: objective.generator.standard_normal(shape),
        }
        if objective.options["population"] is not None:
            asked["popsize"] = objective.options["population"]
        restarts = 0
        while True:
            middle = objective.generator.random(size)
            if objective.start is not None:
                middle[:d], objective.start = objective.start, None
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")  # of flat functions, which end in a restart
                search = CMAEvolutionStrategy(middle, objective.options["sigma"], asked)
                while not search.stop():
                    points = search.ask()
                    search.tell(points, objective(np.array(points)[:, :d]).tolist())
            if restarts < _DOUBLED:
                asked["popsize"] = 2 * search.popsize
            restarts += 1


class ParticleSwarm(BlackBoxBackend):
    """A particle swarm whose weights adapt, started again when it has converged.

    J. Kennedy and R. Eberhart, "Particle swarm optimization", ICNN 1995; the weights after Z.-H. Zhan, J.
    Zhang, Y. Li and H. S.-H. Chung, IEEE Transactions on Systems, Man, and Cybernetics B 39 (2009).
    """

    name = "particle-swarm"
    summary = "adaptive particle swarm (pymoo), started again when it has converged"
    requires = ("pymoo",)
    extra = "blackbox"
    options: ClassVar[Mapping[str, Option]] = {
        "particles": Option(25, "Particles of a swarm.", int, lower=2, upper=10**5),
        "adaptive": Option(True, "Whether the weights follow the swarm's spread.", bool),
    }

    def prepare(self) -> None:
        """Load what the search needs: no part of a time limit."""
        from pymoo.config import Config

        Config.warnings["not_compiled"] = False  # which it would print
        import pymoo.algorithms.soo.nonconvex.pso  # noqa: F401

    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Move one swarm after another until the run is ended."""
        from pymoo.algorithms.soo.nonconvex.pso import PSO
        from pymoo.core.problem import Problem
        from pymoo.core.termination import NoTermination

        d, count = objective.dimension, objective.options["particles"]
        problem = Problem(n_var=d, n_obj=1, xl=np.zeros(d), xu=np.ones(d))
        while True:
            first = latin_hypercube(objective.generator, count, d)
            if objective.start is not None:
                first[0], objective.start = objective.start, None
            swarm = PSO(count, sampling=first, adaptive=objective.options["adaptive"])
            seed = int(objective.generator.integers(2**32))
            swarm.setup(problem, termination=NoTermination(), seed=seed)
            spread = 1.0
            while spread > _CONVERGED:
                asked = swarm.ask()
                asked.set("F", objective(asked.get("X"))[:, None])
                swarm.tell(infills=asked)
                spread = float(np.ptp(swarm.pop.get("X"), axis=0).max())
