"""Base of the searches of a black box."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ...errors import InvalidData, UnsupportedFormulation
from ...jit import clock
from ...models.black_box.model import BlackBoxMinimisation
from ..contract.backend import Answer, Backend, Feature, Guarantee, Limit, Request, Termination
from .objective import Ended, Objective, latin_hypercube

__all__ = ["BlackBoxBackend", "Ended", "Objective", "latin_hypercube"]


class BlackBoxBackend(Backend):
    """Base of the searches; a subclass defines the points to evaluate."""

    accepts = BlackBoxMinimisation
    guarantee = Guarantee.HEURISTIC
    features = frozenset(
        {
            *(Feature.SEED, Feature.EVALUATIONS, Feature.INCUMBENTS, Feature.INTERRUPT),
            Feature.WARM_START,
        }
    )
    single_threaded = True
    shares_process = True
    #: Largest number of free variables, and its reason; 0 for no limit.
    most: ClassVar[int] = 0
    #: Whether the search uses the size of values, so that constraints need an augmented Lagrangian.
    uses_size: ClassVar[bool] = False
    #: Whether the search carries models with several objectives.
    several_objectives: ClassVar[bool] = False
    grows: ClassVar[str] = ""

    def refuses(self, problem: BlackBoxMinimisation) -> str:
        """Return the reason if there are too many variables or objectives, else an empty string."""
        if problem.objectives > 1 and not self.several_objectives:
            return f"it does not support several objectives, got {problem.objectives}"
        free = int((problem.highs > problem.lows).sum())
        if not self.most or free <= self.most:
            return ""
        return f"it takes at most {self.most} variables that are free, got {free}: {self.grows}"

    def explore(self, objective: Objective) -> Mapping[str, Any]:
        """Run :meth:`search` with the handling of constraints that suits it."""
        return objective.search_in_parts(self) if self.uses_size else self.search(objective)

    @abstractmethod
    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Request values until the search ends itself or ``Ended`` is raised through it; return statistics.

        At least one variable is free.
        """

    def run(self, problem: BlackBoxMinimisation, request: Request) -> Answer:
        """Search, and return the best point."""
        refusal = self.refuses(problem)
        if refusal:
            raise UnsupportedFormulation(f"backend {self.name!r}: {refusal}")
        begin = clock()
        objective = Objective(problem, request)
        additional: Mapping[str, Any] = {}
        limit: Limit | None = None
        message = ""
        try:
            if request.warm_start is not None or not objective.dimension:
                # The warm start itself, because the unit cube would round it.
                warm = request.warm_start
                points = [problem.lows] if warm is None else warm.front or [warm.x]
                x = problem.layout.canonical(np.array(points, float))
                objective.start = np.clip(objective.unit(x[0]), 0.0, 1.0)
                objective.at(x)
            if objective.dimension:
                additional = self.explore(objective)
        except Ended:
            limit = request.control.reason or Limit.EVALUATIONS
        except InvalidData as error:
            if objective.x is None:
                raise
            message = str(error)  # exception of the function; earlier points are kept
        used = (objective.granted - objective.left) * problem.repeats
        counts: dict[str, Any] = {"evaluations": used, "variables": objective.dimension}
        counts.update(objective.counts)
        if objective.missing:
            counts["points without a value"] = objective.missing
            points = objective.granted - objective.left
            lacking = f"the function has no value at {objective.missing} of {points} points"
            message = f"{message}; {lacking}" if message else lacking
        plan = objective.plan()
        if plan is None and problem.columns > 1 and not message:
            needs = ["holds all constraints"] * (problem.columns > problem.objectives)
            needs += ["is better than the reference"] * (problem.objectives > 1)
            points = objective.granted - objective.left
            message = f"none of {points} points {' and '.join(needs)}"
        return Answer(
            Termination.FEASIBLE if plan is not None else Termination.NO_SOLUTION,
            limit,
            plan,
            None if plan is None else objective.best,
            seconds={"solve": clock() - begin},
            statistics={**counts, **additional},
            message=message,
        )
