"""Diagnosis of infeasible fleets: unreachable nodes, excessive loads, conflicting limits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import UnsupportedFormulation
from ...models.fleet.checks import LIMITS, loads_of, measure_of
from ...models.fleet.data import Metric, Objective
from ...models.fleet.model import FleetRouting
from ...models.fleet.plan import FleetPlan
from ..contract.backend import Termination
from ..run.diagnosis import Diagnosis, Finding
from ..run.dispatch import solve

__all__ = ["diagnose_fleet"]

#: Checks that a route with a single node may violate although longer routes hold them.
INCOMPLETE = (
    "each node visited once", "every vehicle used", "one node of each group", "deliveries before backhauls",
    "deviation within limit", "range within limit",
)  # fmt: skip
#: Checks of a visit that depend neither on lengths nor on times.
FIXED = ("skills of the vehicle", "load within capacity")
#: Largest number of nodes whose distances and times are searched for shorter detours, which takes 0.1 s.
MOST_SEARCHED = 300
#: Largest number of nodes times vehicles for routes with a single node, which take a second together.
MOST = 2000


def diagnose_fleet(model: FleetRouting, time_limit: float | None = None) -> Diagnosis:
    """Return the nodes or limits that make the model infeasible, and by how much.

    Nodes that no vehicle can reach or serve are reported first. If every node can be reached, the model is
    solved, and then again without each of its limits. `time_limit` is that of each search, s. If a rich
    model has no plan, the nodes that no vehicle can serve on a route of their own are reported.
    """
    findings = (*(() if model.is_rich else _too_far(model)), *_too_heavy(model))
    method = "each node by itself"
    if not findings and not model.is_rich and model.budget is not None:
        findings, method = tuple(_too_long(model, time_limit)), "the shortest routes in all"
    if findings:
        return Diagnosis(model.name, False, method, f"no plan: {findings[0].text}", findings)
    answer = solve(model, time_limit=time_limit)
    if answer.plan is not None:
        summary = f"a plan exists: {answer.plan}, {answer.primal_bound:.10g}"
        return Diagnosis(model.name, True, answer.backend, summary)
    findings = tuple(_unserved(model)) if model.is_rich else ()
    if answer.termination is not Termination.INFEASIBLE:
        reasons = [str(answer.termination), *(finding.text for finding in findings[:1])]
        summary = f"not settled: {'; '.join(reasons)}"
        return Diagnosis(model.name, None, answer.backend, summary, findings)
    if model.is_rich:
        text = findings[0].text if findings else "the features exclude one another"
        return Diagnosis(model.name, False, answer.backend, f"no plan: {text}", findings)
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


def _required(model: FleetRouting) -> list[int]:
    """Return the nodes that every plan visits and that are in no group and no pair."""
    pairs = [] if model.pairs is None else model.pairs.ravel().tolist()
    free = {*pairs, *(node for group in model.groups or () for node in group)}
    return [
        node for node in model.customers.tolist() if not model.optional[node] and node not in free
    ]


def _too_heavy(model: FleetRouting) -> Iterator[Finding]:
    """Yield loads above the largest capacity, and a total load above the total capacity."""
    if model.capacity is None:
        return
    nodes, capacity = _required(model), model.capacity.reshape(model.vehicles, -1)
    for field, verb in (("demands", "take"), ("pickups", "bring")):
        rows = getattr(model, field)
        if rows is None:
            continue
        for c, loads in enumerate(rows.reshape(model.size, -1).T):
            largest, total = float(capacity[:, c].max()), float(capacity[:, c].sum())
            place = f" in dimension {c}" * (capacity.shape[1] > 1)
            for node in [node for node in nodes if loads[node] > largest * (1 + 1e-6)]:
                load = float(loads[node])
                yield Finding(
                    f"node {model.label(node)} {verb}s {load:.6g}{place}, and no vehicle gives more than "
                    f"{largest:.6g}",
                    where=f"node {model.label(node)}",
                    data={"node": node, "demand": load, "capacity": largest},
                )
            carried = float(loads[nodes].sum())
            if carried > total * (1 + 1e-6) and not model.reloads:
                yield Finding(
                    f"all nodes {verb} {carried:.6g}{place}, and all vehicles give {total:.6g}",
                    data={"demand": carried, "capacity": total},
                )


def _has_detours(model: FleetRouting) -> bool:
    """Return whether a visit of other nodes first may be nearer or sooner than the direct way."""
    if model.releases is not None and model.reloads:
        return True  # a vehicle may wait for the release at a reload beside the node
    is_metric = model.costs is None and model.metric is not Metric.ROUNDED
    ways = [
        rows for rows in (None if is_metric else model.distances, model.times) if rows is not None
    ]
    return bool(ways) and (
        model.size > MOST_SEARCHED
        or any(
            (rows > (rows[:, k, None] + rows[k]) * (1 + 1e-9)).any()
            for rows in ways
            for k in range(model.size)
        )
    )


def _unserved(model: FleetRouting) -> Iterator[Finding]:
    """Yield the nodes that no vehicle can serve, as a route of their own violates a check that all routes would."""
    nodes, has_detours = _required(model), _has_detours(model)
    unproven = (*INCOMPLETE, *(["route within battery"] if model.stations else []))
    for node in nodes if len(nodes) * model.vehicles <= MOST else ():
        broken = []
        for k in range(model.vehicles):
            routes = [[node] if k == vehicle else [] for vehicle in range(model.vehicles)]
            checks = model.verify(model.with_schedule(routes)).violated
            proven = (
                set(FIXED) if has_detours else {check.name for check in checks}.difference(unproven)
            )
            broken.append([check for check in checks if check.name in proven])
            if not broken[-1]:
                break
        else:
            check = broken[0][0]
            yield Finding(
                f"node {model.label(node)} cannot be served on a route of its own: vehicle 0 violates "
                f"{check.name!r}" + (f" by {check.worst:.6g} {check.unit}" if check.unit else ""),
                where=f"node {model.label(node)}",
                data={"node": node, "checks": [entry[0].name for entry in broken]},
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
