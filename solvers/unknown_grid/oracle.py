"""Reference solution on the true maps: a lower bound on the cost of every policy."""

from __future__ import annotations

import numpy as np

from ...jit import clock
from ...models.grid_path import GridMap, path_between
from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.plan import ACTIONS, STEPS, NavigationRuns, Outcome
from ..contract.backend import Answer, Backend, Feature, Guarantee, Request, Termination

__all__ = ["Oracle"]


class Oracle(Backend):
    """Shortest path on the true map of every scene. Its cost is a lower bound for every policy."""

    name = "oracle"
    accepts = UnknownGridNavigation
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    sees_hidden = True
    summary = "A* on the true map, which no policy sees: a bound for all"

    def run(self, problem: UnknownGridNavigation, request: Request) -> Answer:
        """Return the shortest paths. A scene without a path gets the outcome ``NO_WAY`` and no action."""
        begin = clock()
        fewest = problem.fewest_steps()
        actions, outcomes, costs = [], [], []
        for k, steps in enumerate(fewest.tolist()):
            if request.control.stopped:
                return Answer(Termination.NO_SOLUTION, request.control.reason)
            ways = {True: (Outcome.NO_WAY, 0.0), False: (Outcome.GAVE_UP, problem.steps + 1.0)}
            outcome, cost = ways[steps == np.inf]
            letters = ""
            if steps <= problem.steps:
                outcome, cost = Outcome.REACHED, steps
                path = path_between(
                    GridMap(problem.blocked[k]),
                    problem.starts[k],
                    problem.targets[k],
                    diagonal=False,
                )
                moves = dict(zip(STEPS, ACTIONS, strict=True))
                letters = "".join(moves[a, b] for a, b in np.diff(path, axis=0).tolist())
            actions.append(letters)
            outcomes.append(outcome)
            costs.append(cost)
        mean = float(np.mean(costs))
        plan = NavigationRuns(tuple(actions), tuple(outcomes))
        return Answer(
            Termination.OPTIMAL, None, plan, mean, mean,
            seconds={"solve": clock() - begin},
            statistics={"success %": plan.success},
        )  # fmt: skip
