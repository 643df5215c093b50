"""Reference solution on the true maps: a lower bound on the cost of every policy."""

from __future__ import annotations

import numpy as np

from ...jit import clock
from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.moving import fewest_run
from ...models.unknown_grid.plan import NavigationRuns, Outcome
from ...models.unknown_grid.scenes import Aspect, aspects_of
from ..contract.backend import Answer, Backend, Feature, Guarantee, Request, Termination

__all__ = ["Oracle"]

_MESSAGE = (
    "the oracle knows the map, the target and the tracks of moving obstacles in advance: its cost is a lower bound "
    "that policies with observations may be unable to attain"
)


class Oracle(Backend):
    """Shortest path on the true map of every scene. Its cost is a lower bound for every policy."""

    name = "oracle"
    accepts = UnknownGridNavigation
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    sees_hidden = True
    summary = "breadth-first search on the true map, which no policy sees: a bound for all"

    def run(self, problem: UnknownGridNavigation, request: Request) -> Answer:
        """Return the shortest paths. A scene without a path gets the outcome ``NO_WAY`` and no action."""
        begin = clock()
        aspects = aspects_of(problem)
        actions, outcomes, costs = [], [], []
        for k, run in enumerate(problem.fewest_runs()):
            if request.control.stopped:
                return Answer(Termination.NO_SOLUTION, request.control.reason)
            letters, outcome, cost = "", Outcome.GAVE_UP, problem.steps + 1.0
            if run is not None and len(run) <= problem.steps:
                letters, outcome, cost = run, Outcome.REACHED, len(run)
            elif run is None and (not problem.moving or fewest_run(problem, k) is None):
                outcome, cost = Outcome.NO_WAY, 0.0
            actions.append(letters)
            outcomes.append(outcome)
            costs.append(cost)
        mean = float(np.mean(costs))
        plan = NavigationRuns(tuple(actions), tuple(outcomes))
        return Answer(
            Termination.OPTIMAL, None, plan, mean, mean,
            seconds={"solve": clock() - begin},
            statistics={"success %": plan.success},
            message=_MESSAGE if aspects - {Aspect.EIGHT} else "",
        )  # fmt: skip
