"""Independent check of a fleet's routes; lengths are recomputed from the distances."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import required
from ..verification import Check, Verification, check_tolerance
from .data import LEXICOGRAPHIC, Deviation, FleetData, Objective
from .plan import FleetPlan

__all__ = ["deviation_of", "loads_of", "objective_of", "variance_of", "verify_routes"]

Floats = NDArray[np.float64]


def loads_of(model: FleetData, plan: FleetPlan) -> Floats:
    """Return the length of each route, from its depot and back, shape (routes,)."""
    loads = np.zeros(len(plan.routes))
    for k, route in enumerate(plan.routes):
        if route:
            home = int(model.homes[min(k, model.vehicles - 1)])
            stops = [home, *route, home]
            loads[k] = sum(model.distances[a, b] for a, b in itertools.pairwise(stops))
    return loads


def variance_of(loads: Floats) -> float:
    """Return the variance Y of the route lengths (eq. 16); the divisor is the number of routes."""
    return float(np.var(loads))


def deviation_of(model: FleetData, loads: Floats) -> float:
    """Return the standard deviation of the route lengths, 0 for a single vehicle.

    The field `deviation` of `model` selects the divisor: m - 1, or m for the root of eq. 16.
    """
    if loads.size < 2:
        return 0.0
    return float(np.std(loads, ddof=1 if model.deviation is Deviation.SAMPLE else 0))


def objective_of(model: FleetData, loads: Floats) -> float:
    """Return the objective value of `model` for routes of lengths `loads`."""
    total, longest = float(loads.sum()), float(loads.max())
    if model.objective is Objective.SUM:
        return total
    if model.objective is Objective.MAX:
        return longest
    if model.objective is Objective.VARIANCE:
        return total + model.q * variance_of(loads)
    if model.objective is Objective.DEVIATION:
        return total + model.q * deviation_of(model, loads)
    if model.objective is Objective.RANGE:
        return longest - float(loads.min())
    return longest + LEXICOGRAPHIC * total


def verify_routes(model: FleetData, plan: FleetPlan, tolerance: float) -> Verification:
    """Compute the objective of `plan` and check every constraint of `model`."""
    check_tolerance(tolerance)
    required("plan", plan, FleetPlan)
    for k, route in enumerate(plan.routes):
        for stop, node in enumerate(route):
            if not 0 <= node < model.size:
                raise InvalidData(
                    f"routes[{k}][{stop}] must be in 0 … {model.size - 1}, got {node}",
                    field="routes",
                )
    visited = np.bincount(
        np.array([node for route in plan.routes for node in route], int), minlength=model.size
    )
    required_visits = np.zeros(model.size, int)
    required_visits[model.customers] = 1
    wrong = np.flatnonzero(visited != required_visits)
    loads = loads_of(model, plan)
    unit = model.length_unit
    empty = [k for k, route in enumerate(plan.routes) if not route]
    checks = [
        _count("one route for each vehicle", abs(len(plan.routes) - model.vehicles), ""),
        _count(
            "each node visited once", float(wrong.size),
            f"node {model.label(int(wrong[0]))}" if wrong.size else "",
        ),
    ]  # fmt: skip
    if model.use_all:
        where = f"vehicle {empty[0]}" if empty else ""
        checks.append(_count("every vehicle used", float(len(empty)), where))
    if len(plan.routes) != model.vehicles:
        return Verification(None, tuple(checks))

    def check_each(name: str, values: Floats, limits: Floats, unit: str) -> Check:
        excess = values - limits
        share = excess / np.maximum(limits, 1e-300)
        k = int(np.argmax(np.where(excess > 0, share, -1.0)))
        limit = float(limits[k])
        # A limit of 0 has no scale, so the longest distance is used instead.
        scale = limit or float(model.distances.max())
        return Check.scaled(
            name, "", max(float(excess[k]), 0.0), unit, f"vehicle {k}" if len(values) > 1 else "",
            tolerance, scale, limit=limit,
        )  # fmt: skip

    def check_total(name: str, value: float, limit: float) -> Check:
        """Return the check of a limit on all routes; `noise` absorbs rounding in the lengths."""
        noise = 1e-12 * float(loads.max(initial=0.0))
        return Check.scaled(
            name, "", max(value - limit, 0.0), unit, "", tolerance, limit, noise=noise, limit=limit,
        )  # fmt: skip

    if model.capacity is not None:
        assert model.demands is not None
        carried = np.array([model.demands[list(route)].sum() for route in plan.routes])
        checks.append(check_each("demands within capacity", carried, model.capacity, ""))
    if model.battery is not None:
        checks.append(check_each("route within battery", loads, model.battery, unit))
    if model.budget is not None:
        checks.append(check_total("sum within budget", float(loads.sum()), model.budget))
    if model.deviation_limit is not None:
        spread = deviation_of(model, loads)
        checks.append(check_total("deviation within limit", spread, model.deviation_limit))
    if model.range_limit is not None:
        spread = float(np.ptp(loads))
        checks.append(check_total("range within limit", spread, model.range_limit))
    # The range of nearly equal lengths is almost 0: compare it with the mean length instead.
    scale = float(loads.mean()) if model.objective is Objective.RANGE else 0.0
    return Verification(objective_of(model, loads), tuple(checks), scale=scale)


def _count(name: str, number: float, where: str) -> Check:
    return Check(name, "", float(number), "", 0.0, where, 0.0)
