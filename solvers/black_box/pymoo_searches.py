"""Third-party searches: ``cma-es`` by ``cma``; ``particle-swarm`` and ``nsga-ii`` by ``pymoo``, which installs ``cma``.

The covariance matrix adaptation is called from ``cma`` directly. Pymoo's wrapper suppresses every
exception, so that a run that must end would appear to have converged.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from importlib import import_module
from types import ModuleType
from typing import Any, ClassVar

import numpy as np

from ...models.black_box.model import BlackBoxMinimisation
from ..contract.backend import Option
from .native import BlackBoxBackend, Objective, latin_hypercube
from .quiet import quiet

__all__ = ["CmaEs", "NsgaII", "ParticleSwarm"]


#: Number of restarts that double the population; later ones keep its size.
_DOUBLED = 9
#: Value for the model at a point without a value, before the first point with one.
_MISSING = 1e10
#: Largest value for the model, which computes products of values.
_LARGEST = 1e100
#: Finite substitute for no value.
_WALL = 1e150
#: Extent of all particles' best positions, as a share of the cube, at which a swarm has converged.
_CONVERGED = 1e-8


def _shortcut(name: str) -> Any:
    """Return an attribute of ``cma.s``, aliases for interactive use, which import Matplotlib."""
    if name.startswith("__"):
        raise AttributeError(name)
    sys.modules.pop("cma.s", None)
    return getattr(import_module("cma.s"), name)


class CmaEs(BlackBoxBackend):
    """Covariance matrix adaptation evolution strategy, restarted with twice as many points.

    N. Hansen and A. Ostermeier, Evolutionary Computation 9 (2001); A. Auger and N. Hansen, "A restart CMA
    evolution strategy with increasing population size", IEEE CEC 2005.
    """

    name = "cma-es"
    summary = "covariance matrix adaptation (cma), restarted with ever more points"
    requires = ("cma",)
    extra = "blackbox"
    options: ClassVar[Mapping[str, Option]] = {
        "sigma": Option(
            0.2, "Initial standard deviation, as a share of each range.", lower=1e-9, upper=10.0
        ),
        "population": Option(
            None,
            "Points of the first generation; if None, 4 + 3 ln d, rounded up to a multiple of the workers.",
            int,
            lower=3,
            upper=10**6,
        ),
        "surrogate": Option(
            False, "Whether a quadratic model replaces most evaluations (lq-CMA-ES).", bool
        ),
    }
    most = 1000
    grows = "its matrix has their square"

    def prepare(self) -> None:
        """Import the search's libraries, outside of the time limit."""
        shortcuts = ModuleType("cma.s")
        vars(shortcuts)["__getattr__"] = _shortcut
        sys.modules.setdefault("cma.s", shortcuts)
        import_module("cma")

    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Evolve from the warm start or the centre, then from random points, until the run ends."""
        from cma import CMAEvolutionStrategy
        from cma.fitness_models import SurrogatePopulation

        d = objective.dimension
        size = max(d, 2)  # cma needs two variables: the second one is ignored
        options: dict[str, Any] = {
            "bounds": [0.0, 1.0],
            "verbose": -9,
            "verb_log": 0,
            "seed": np.nan,  # leaves NumPy's global generator untouched
            "randn": lambda *shape: objective.generator.standard_normal(shape),
        }
        count = objective.options["population"]
        options["popsize"] = count or objective.filled(4 + int(3 * np.log(size)))

        def value(x: Any) -> float:
            """Return the value at a point; no value becomes the largest one of the model."""
            result = float(objective(np.asarray(x, float)[None, :d])[0])
            if not np.isfinite(result):
                return float(max(model.model.F, default=_MISSING))
            return min(max(result, -_LARGEST), _LARGEST)

        # A quadratic model cannot follow the steps between feasible and infeasible points.
        has_model = objective.options["surrogate"] and objective.problem.columns == 1
        restarts, middle = 0, np.full(size, 0.5)
        while True:
            if objective.start is not None:
                middle[:d], objective.start = objective.start, None
            with quiet():  # about flat functions, which lead to a restart
                search = CMAEvolutionStrategy(middle, objective.options["sigma"], options)
                model = SurrogatePopulation(value)
                while not search.stop():
                    points = search.ask()
                    if has_model:
                        search.tell(points, model(points))
                        if np.isfinite(model.model.xopt).all():
                            search.inject([model.model.xopt])
                    else:
                        search.tell(points, objective(np.array(points)[:, :d]).tolist())
            if restarts < _DOUBLED:
                options["popsize"] = 2 * search.popsize
            restarts += 1
            middle = objective.generator.random(size)


class _Pymoo(BlackBoxBackend):
    """Base of the searches of pymoo."""

    requires = ("pymoo",)
    extra = "blackbox"
    #: Module of the algorithm.
    module: ClassVar[str]

    def prepare(self) -> None:
        """Import the search's libraries, outside of the time limit."""
        from pymoo.config import Config

        Config.warnings["not_compiled"] = False  # suppresses a printed warning
        import_module(self.module)


class ParticleSwarm(_Pymoo):
    """Particle swarm with adaptive weights, restarted after convergence.

    J. Kennedy and R. Eberhart, "Particle swarm optimization", ICNN 1995; the weights after Z.-H. Zhan, J.
    Zhang, Y. Li and H. S.-H. Chung, IEEE Transactions on Systems, Man, and Cybernetics B 39 (2009).
    """

    name = "particle-swarm"
    summary = "adaptive particle swarm (pymoo), started again when it has converged"
    module = "pymoo.algorithms.soo.nonconvex.pso"
    options: ClassVar[Mapping[str, Option]] = {
        "particles": Option(25, "Particles of a swarm.", int, lower=2, upper=10**5),
        "adaptive": Option(True, "Whether the weights follow the swarm's spread.", bool),
    }

    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Run one swarm after another until the run ends."""
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
                infills = swarm.ask()
                infills.set("F", objective(infills.get("X"))[:, None])
                swarm.tell(infills=infills)
                spread = float(np.ptp(swarm.pop.get("X"), axis=0).max())


class NsgaII(_Pymoo):
    """Non-dominated sorting genetic algorithm II with feasibility rules.

    K. Deb, A. Pratap, S. Agarwal and T. Meyarivan, "A fast and elitist multiobjective genetic algorithm:
    NSGA-II", IEEE Transactions on Evolutionary Computation 6 (2002). The answer is the front with the largest
    hypervolume over all evaluated points, not the last population.
    """

    name = "nsga-ii"
    summary = "non-dominated sorting genetic algorithm (pymoo), for two to four objectives"
    module = "pymoo.algorithms.moo.nsga2"
    options: ClassVar[Mapping[str, Option]] = {
        "population": Option(
            100, "Points per generation, at most evaluations / 10.", int, lower=4, upper=10**4
        ),
        "front": Option(100, "Largest number of points of the front.", int, lower=1, upper=1000),
    }
    several_objectives = True

    def refuses(self, problem: BlackBoxMinimisation) -> str:
        """Return the reason if the model has one objective, else an empty string."""
        if problem.objectives == 1:
            return "it needs at least two objectives, got 1"
        return super().refuses(problem)

    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Evolve until the run ends; start again if no new points can be made."""
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.problem import Problem
        from pymoo.core.termination import NoTermination

        d, m = objective.dimension, objective.problem.objectives
        count = max(min(objective.options["population"], objective.granted // 10), 4)
        problem = Problem(n_var=d, n_obj=m, n_ieq_constr=1, xl=np.zeros(d), xu=np.ones(d))
        while True:
            first = latin_hypercube(objective.generator, count, d)
            if objective.start is not None:
                first[0], objective.start = objective.start, None
            search = NSGA2(count, sampling=first)
            seed = int(objective.generator.integers(2**32))
            search.setup(problem, termination=NoTermination(), seed=seed)
            while (infills := search.ask()) is not None and len(infills):
                points = objective.point(infills.get("X"))
                table = objective.table(points)
                violation = objective.constraints.violation(table)
                infills.set("X", np.clip(objective.unit(points), 0.0, 1.0))
                infills.set("F", np.clip(table[:, :m], -_WALL, _WALL))
                infills.set("G", np.clip(violation, 0.0, _WALL)[:, None])
                search.tell(infills=infills)
