"""An exact algorithm, and why there is no choice."""

from __future__ import annotations

from crosstrack.solvers import (
    Answer,
    Backend,
    Diagnosis,
    Feature,
    Finding,
    Guarantee,
    Termination,
)

from .model import Choice, Covering


class CoverByWeight(Backend):
    """The cheapest choice for every weight up to the demand."""

    name = "dynamic-programming"
    accepts = Covering
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.GAP, Feature.DUAL_BOUND})
    deterministic = True
    single_threaded = True
    summary = "the cheapest choice for every weight"

    def run(self, problem, request):
        best = {0: (0.0, ())}
        for item, weight in enumerate(problem.weights.astype(int).tolist()):
            for reached, (cost, items) in list(best.items()):
                further = min(reached + weight, problem.demand)
                more = (cost + float(problem.costs[item]), (*items, item))
                if further not in best or more[0] < best[further][0]:
                    best[further] = more
        if problem.demand not in best:
            return Answer(Termination.INFEASIBLE)
        cost, items = best[problem.demand]
        return Answer(Termination.OPTIMAL, point=Choice(items), dual_bound=cost)


def diagnose_covering(model, time_limit):
    missing = model.demand - model.weights.sum()
    if missing <= 0:
        return Diagnosis(model.name, True, "sum of the weights", "all items reach the demand")
    finding = Finding(f"all items together are {missing:g} kg short", "2", "demand")
    return Diagnosis(model.name, False, "sum of the weights", "too little weight", (finding,))
