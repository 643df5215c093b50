"""Why a fleet has no plan: nodes out of reach, loads that are too large, limits that exclude one another."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import UnsupportedFormulation
from ...models.fleet.checks import deviation_of, loads_of
from ...models.fleet.data import Objective
from ...models.fleet.model import FleetRouting
from ...models.fleet.plan import FleetPlan
from ..backend import Termination
from ..diagnosis import Diagnosis, Finding
from ..dispatch import solve

__all__ = ["diagnose_fleet"]

#: The limits that may be left out.
_LIMITS = ("battery", "budget", "deviation_limit", "range_limit", "capacity")


def diagnose_fleet(model: FleetRouting, time_limit: float | None = None) -> Diagnosis:
    """Return which nodes or limits leave no plan, and by how much.

    Nodes that no vehicle reaches or can serve are named first. Where each node alone is within reach,
    the model is solved, and then again without each of its limits.

    Parameters
    ----------
    model : FleetRouting
        What is asked.
    time_limit : float, optional
        Seconds for each search.
    """
    found = (*_too_far(model), *_too_heavy(model))
    method = "each node by itself"
    if not found and model.budget is not None:
        found, method = tuple(_too_long(model, time_limit)), "the shortest routes in all"
    if found:
        return Diagnosis(model.name, False, method, f"no plan: {found[0].text}", found)
    answer = solve(model, time_limit=time_limit)
    if answer.plan is not None:
        summary = f"a plan exists: {answer.plan}, {answer.primal_bound:.10g}"
        return Diagnosis(model.name, True, answer.backend, summary)
    if answer.termination is not Termination.INFEASIBLE:
        return Diagnosis(model.name, None, answer.backend, f"not settled: {answer.termination}")
    found = tuple(_without_limits(model, time_limit))
    summary = "no plan: " + (
        found[0].text if found else "the limits exclude one another, also without any single one"
    )
    return Diagnosis(model.name, False, "solved without each limit", summary, found)


def _too_far(model: FleetRouting) -> Iterator[Finding]:
    """Yield the nodes that no battery reaches, the farthest first."""
    if model.battery is None:
        return
    nodes, trips = model.customers, model.round_trips
    over = (trips - model.battery[:, None] * (1 + 1e-9)).min(axis=0)
    unit = f" {model.length_unit}".rstrip()
    for place in np.argsort(-over, kind="stable")[: int((over > 0).sum())].tolist():
        k = int((trips[:, place] - model.battery).argmin())
        node, trip, limit = int(nodes[place]), float(trips[k, place]), float(model.battery[k])
        yield Finding(
            f"node {model.label(node)} is out of reach: the shortest way there and back takes "
            f"{trip:.6g}{unit}, and the battery of vehicle {k} lasts {limit:.6g}{unit}",
            where=f"node {model.label(node)}",
            data={"node": node, "vehicle": k, "round_trip": trip, "battery": limit},
        )


def _too_heavy(model: FleetRouting) -> Iterator[Finding]:
    """Yield the nodes that take more than any vehicle gives, and that all take more than all give."""
    if model.capacity is None:
        return
    assert model.demands is not None
    most, total = float(model.capacity.max()), float(model.capacity.sum())
    for node in model.customers[model.demands[model.customers] > most * (1 + 1e-9)].tolist():
        demand = float(model.demands[node])
        yield Finding(
            f"node {model.label(node)} takes {demand:.6g}, and no vehicle gives more than {most:.6g}",
            where=f"node {model.label(node)}",
            data={"node": node, "demand": demand, "capacity": most},
        )
    asked = float(model.demands[model.customers].sum())
    if asked > total * (1 + 1e-9):
        yield Finding(
            f"all nodes take {asked:.6g}, and all vehicles give {total:.6g}",
            data={"demand": asked, "capacity": total},
        )


def _too_long(model: FleetRouting, time_limit: float | None) -> Iterator[Finding]:
    """Yield that all routes together, whatever their loads, are longer than the budget."""
    free = replace(
        model, objective=Objective.SUM, q=0.0, budget=None, deviation_limit=None, range_limit=None,
        battery=None, capacity=None, demands=None,
    )  # fmt: skip
    try:
        answer = solve(free, "highs", formulation="two-index", time_limit=time_limit)
    except UnsupportedFormulation:
        answer = solve(free, time_limit=time_limit)
    bound, budget = answer.dual_bound, model.budget
    assert budget is not None
    if bound is not None and bound > budget * (1 + 1e-6):
        unit = f" {model.length_unit}".rstrip()
        yield Finding(
            f"all routes together take at least {bound:.6g}{unit}, and the budget is {budget:.6g}{unit}",
            where="budget",
            data={"field": "budget", "limit": budget, "needed": bound},
        )


def _without_limits(model: FleetRouting, time_limit: float | None) -> Iterator[Finding]:
    """Yield the limits without which there is a plan, with what the best plan then needs."""
    for name in _LIMITS:
        if getattr(model, name) is None:
            continue
        left_out: dict[str, Any] = {name: None}
        if name == "capacity":
            left_out["demands"] = None
        # The least sum, or the least longest route, is what the limit misses.
        aims = {"budget": Objective.SUM, "battery": Objective.MAX, "range_limit": Objective.RANGE}
        if name in aims:
            left_out |= {"objective": aims[name], "q": 0.0}
        answer = solve(replace(model, **left_out), time_limit=time_limit)
        if answer.plan is None:
            continue
        limit, needed = _measured(model, name, answer.plan)
        least = "at least " if name in aims and answer.termination is Termination.OPTIMAL else ""
        yield Finding(
            f"{name} {limit:.6g} is in the way: without it a plan exists that needs {least}"
            f"{needed:.6g}",
            "",
            name,
            {"field": name, "limit": limit, "needed": needed, "plan": answer.plan.to_data()},
        )
    if model.use_all:
        answer = solve(replace(model, use_all=False), time_limit=time_limit)
        if answer.plan is not None:
            used = sum(bool(route) for route in answer.plan.routes)
            yield Finding(
                f"use_all is in the way: a plan exists with {used} of {model.vehicles} vehicles",
                where="use_all",
                data={"field": "use_all", "plan": answer.plan.to_data()},
            )


def _measured(model: FleetRouting, name: str, plan: FleetPlan) -> tuple[float, float]:
    """Return a limit, the greatest where there are several, and what a plan makes of it."""
    loads = loads_of(model, plan)
    if name == "capacity":
        assert model.demands is not None
        carried = [float(model.demands[list(route)].sum()) for route in plan.routes]
        return float(np.max(np.asarray(model.capacity))), max(carried)
    needed = {
        "battery": float(loads.max()),
        "budget": float(loads.sum()),
        "deviation_limit": deviation_of(model, loads),
        "range_limit": float(np.ptp(loads)),
    }
    return float(np.max(getattr(model, name))), needed[name]
