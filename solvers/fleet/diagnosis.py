"""Diagnosis of infeasible fleets: unreachable nodes, excessive loads, conflicting limits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import UnsupportedFormulation
from ...models.fleet.checks import LIMITS, loads_of, measure_of
from ...models.fleet.data import Objective
from ...models.fleet.model import FleetRouting
from ...models.fleet.plan import FleetPlan
from ..contract.backend import Termination
from ..run.diagnosis import Diagnosis, Finding
from ..run.dispatch import solve

__all__ = ["diagnose_fleet"]


def diagnose_fleet(model: FleetRouting, time_limit: float | None = None) -> Diagnosis:
    """Return the nodes or limits that make the model infeasible, and by how much.

    Nodes that no vehicle can reach or serve are reported first. If every node can be reached, the model is
    solved, and then again without each of its limits. `time_limit` is that of each search, s. Rich
    features are not analysed: the model is only solved.
    """
    findings = () if model.is_rich else (*_too_far(model), *_too_heavy(model))
    method = "each node by itself"
    if not findings and not model.is_rich and model.budget is not None:
        findings, method = tuple(_too_long(model, time_limit)), "the shortest routes in all"
    if findings:
        return Diagnosis(model.name, False, method, f"no plan: {findings[0].text}", findings)
    answer = solve(model, time_limit=time_limit)
    if answer.plan is not None:
        summary = f"a plan exists: {answer.plan}, {answer.primal_bound:.10g}"
        return Diagnosis(model.name, True, answer.backend, summary)
    if answer.termination is not Termination.INFEASIBLE:
        return Diagnosis(model.name, None, answer.backend, f"not settled: {answer.termination}")
    if model.is_rich:
        return Diagnosis(
            model.name, False, answer.backend, "no plan: the features exclude one another"
        )
    findings = tuple(_without_limits(model, time_limit))
    summary = "no plan: " + (
        findings[0].text
        if findings
        else "the limits exclude one another, also without any single one"
    )
    return Diagnosis(model.name, False, "solved without each limit", summary, findings)


def _too_far(model: FleetRouting) -> Iterator[Finding]:
    """Yield the nodes beyond the reach of every battery, the largest excess first."""
    if model.battery is None:
        return
    nodes, trips = model.customers, model.round_trips
    excess = (trips - model.battery[:, None] * (1 + 1e-9)).min(axis=0)
    unit = f" {model.length_unit}".rstrip()
    for place in np.argsort(-excess, kind="stable")[: int((excess > 0).sum())].tolist():
        k = int((trips[:, place] - model.battery).argmin())
        node, trip, limit = int(nodes[place]), float(trips[k, place]), float(model.battery[k])
        yield Finding(
            f"node {model.label(node)} is out of reach: the shortest way there and back takes "
            f"{trip:.6g}{unit}, and the battery of vehicle {k} lasts {limit:.6g}{unit}",
            where=f"node {model.label(node)}",
            data={"node": node, "vehicle": k, "round_trip": trip, "battery": limit},
        )


def _too_heavy(model: FleetRouting) -> Iterator[Finding]:
    """Yield demands above the largest capacity, and a total demand above the total capacity."""
    if model.capacity is None:
        return
    assert model.demands is not None
    largest, total = float(model.capacity.max()), float(model.capacity.sum())
    for node in model.customers[model.demands[model.customers] > largest * (1 + 1e-9)].tolist():
        demand = float(model.demands[node])
        yield Finding(
            f"node {model.label(node)} takes {demand:.6g}, and no vehicle gives more than {largest:.6g}",
            where=f"node {model.label(node)}",
            data={"node": node, "demand": demand, "capacity": largest},
        )
    demanded = float(model.demands[model.customers].sum())
    if demanded > total * (1 + 1e-9):
        yield Finding(
            f"all nodes take {demanded:.6g}, and all vehicles give {total:.6g}",
            data={"demand": demanded, "capacity": total},
        )


def _too_long(model: FleetRouting, time_limit: float | None) -> Iterator[Finding]:
    """Yield a finding if the lower bound on the sum, without other limits, exceeds the budget."""
    limits: dict[str, Any] = dict.fromkeys((*model.limits, "demands"))
    free = replace(model, objective=Objective.SUM, q=0.0, **limits)
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
    """Yield the limits whose removal makes the model feasible, with the value that a plan needs."""
    aims = {rule.field: rule.objective for rule in LIMITS if rule.objective}
    # The capacity is the last.
    for name in sorted(model.limits, key="capacity".__eq__):
        changes: dict[str, Any] = {name: None}
        if name == "capacity":
            changes["demands"] = None
        # Minimise the limited quantity itself: its optimum is the smallest feasible limit.
        if name in aims:
            changes |= {"objective": aims[name], "q": 0.0}
        answer = solve(replace(model, **changes), time_limit=time_limit)
        if answer.plan is None:
            continue
        limit, needed = _limit_and_value(model, name, answer.plan)
        prefix = "at least " if name in aims and answer.termination is Termination.OPTIMAL else ""
        yield Finding(
            f"{name} {limit:.6g} is in the way: without it a plan exists that needs {prefix}"
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


def _limit_and_value(model: FleetRouting, name: str, plan: FleetPlan) -> tuple[float, float]:
    """Return the limit, the greatest of all vehicles, and the value that `plan` needs."""
    loads = loads_of(model, plan)
    if name == "capacity":
        assert model.demands is not None
        carried = [float(model.demands[list(route)].sum()) for route in plan.routes]
        return float(np.max(np.asarray(model.capacity))), max(carried)
    measure = next(rule.measure for rule in LIMITS if rule.field == name)
    return float(np.max(getattr(model, name))), measure_of(model, measure, loads)
