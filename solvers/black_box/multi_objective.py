"""``nsga-ii`` by ``pymoo``: fronts of several objectives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ...models.black_box.model import BlackBoxMinimisation
from ..contract.backend import Option
from .native import BlackBoxBackend, Objective, latin_hypercube

__all__ = ["NsgaII"]

#: Finite substitute for no value.
_WALL = 1e150


class NsgaII(BlackBoxBackend):
    """Non-dominated sorting genetic algorithm II with feasibility rules.

    K. Deb, A. Pratap, S. Agarwal and T. Meyarivan, "A fast and elitist multiobjective genetic algorithm:
    NSGA-II", IEEE Transactions on Evolutionary Computation 6 (2002). The answer is the front with the largest
    hypervolume over all evaluated points, not the last population.
    """

    name = "nsga-ii"
    summary = "non-dominated sorting genetic algorithm (pymoo), for two to four objectives"
    requires = ("pymoo",)
    extra = "blackbox"
    options: ClassVar[Mapping[str, Option]] = {
        "population": Option(
            100,
            "Points of a generation; at most a tenth of the evaluations.",
            int,
            lower=4,
            upper=10**4,
        ),
        "front": Option(100, "Largest number of points of the front.", int, lower=1, upper=1000),
    }
    several_objectives = True

    def refuses(self, problem: BlackBoxMinimisation) -> str:
        """Return the reason if the model has one objective, else an empty string."""
        if problem.objectives == 1:
            return "it needs at least two objectives, got 1"
        return super().refuses(problem)

    def prepare(self) -> None:
        """Import the search's libraries, outside of the time limit."""
        from pymoo.config import Config

        Config.warnings["not_compiled"] = False  # suppresses a printed warning
        import pymoo.algorithms.moo.nsga2  # noqa: F401

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
