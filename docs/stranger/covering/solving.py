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
    """The cheapest choice for every weight up to the demand, which may be any real number."""

    name = "dynamic-programming"
    accepts = Covering
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.GAP, Feature.DUAL_BOUND})
    deterministic = True
    single_threaded = True
    summary = "the cheapest choice for every weight"

    def run(self, problem, request):
        best = [(0.0, 0.0, ())]  # cost, weight, items: each heavier than all that cost less
        for item, weight in enumerate(problem.weights.tolist()):
            cost = float(problem.costs[item])
            more = [(c + cost, w + weight, (*items, item)) for c, w, items in best]
            best = pareto([*best, *more], float(problem.demand))
        cost, weight, items = best[-1]
        # Sums of weights in another order differ by rounding, which the check accepts as well.
        if weight < problem.demand * (1 - 1e-12):
            return Answer(Termination.INFEASIBLE)
        return Answer(Termination.OPTIMAL, point=Choice(items), dual_bound=cost)


def pareto(choices, demand):
    """Return the choices that no cheaper one outweighs; weight beyond the demand does not count."""
    kept = []
    for cost, weight, items in sorted(choices, key=lambda c: (c[0], -c[1])):
        enough = min(weight, demand)
        if not kept or enough > kept[-1][1]:
            kept.append((cost, enough, items))
    return kept


def diagnose_covering(model, time_limit):
    missing = model.demand - model.weights.sum()
    if missing <= 0:
        return Diagnosis(model.name, True, "sum of the weights", "all items reach the demand")
    finding = Finding(f"all items together are {missing:g} kg short", "2", "demand")
    return Diagnosis(model.name, False, "sum of the weights", "too little weight", (finding,))
