"""Exact algorithm and diagnosis of infeasible instances."""

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
    """Dynamic program over weights up to the demand, for real-valued weights."""

    name = "dynamic-programming"
    accepts = Covering
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.GAP, Feature.DUAL_BOUND})
    deterministic = True
    single_threaded = True
    summary = "cheapest selection for every weight"

    def run(self, problem, request):
        best = [(0.0, 0.0, ())]  # cost, weight, items; both cost and weight increase
        for item, weight in enumerate(problem.weights.tolist()):
            cost = float(problem.costs[item])
            more = [(c + cost, w + weight, (*items, item)) for c, w, items in best]
            best = pareto([*best, *more], float(problem.demand))
        cost, weight, items = best[-1]
        # Rounding of the sum depends on the order; the check also has a tolerance.
        if weight < problem.demand * (1 - 1e-12):
            return Answer(Termination.INFEASIBLE)
        return Answer(Termination.OPTIMAL, point=Choice(items), dual_bound=cost)


def pareto(choices, demand):
    """Return the selections that are non-dominated in cost and weight, with weight capped at the demand."""
    front = []
    for cost, weight, items in sorted(choices, key=lambda c: (c[0], -c[1])):
        enough = min(weight, demand)
        if not front or enough > front[-1][1]:
            front.append((cost, enough, items))
    return front


def diagnose_covering(model, time_limit):
    missing = model.demand - model.weights.sum()
    if missing <= 0:
        return Diagnosis(model.name, True, "sum of the weights", "all items reach the demand")
    finding = Finding(f"all items together are {missing:g} kg short", "2", "demand")
    return Diagnosis(model.name, False, "sum of the weights", "too little weight", (finding,))
