"""Independent check of a fleet's routes; lengths are recomputed from the distances."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import required
from ..verification import Check, Verification, check_entries, check_tolerance
from .data import LEXICOGRAPHIC, Deviation, FleetData, Objective
from .plan import FleetPlan
from .rich_checks import (
    cost_of,
    describe_visits,
    longest_stretch,
    makespan_of,
    missing_times,
    rich_checks,
)
from .rich_data import RichData

__all__ = [
    "LIMITS", "LoadLimit", "deviation_of", "loads_of", "measure_of", "objective_of", "value_of",
    "variance_of", "verify_routes",
]  # fmt: skip

Floats = NDArray[np.float64]


class LoadLimit(NamedTuple):
    """Upper limit on a measure of the route lengths.

    `name` is that of its check. `objective` minimises the measure, if there is one. A `monotone` measure
    never decreases if a route gets longer, so no detour pays.
    """

    field: str
    measure: str
    name: str
    objective: Objective | None
    monotone: bool


#: Limits on the route lengths in the order of their checks. A new limit also needs its field in
#: :class:`FleetData`, its measure below, and its rows in the program and in the energy of the search.
LIMITS = (
    LoadLimit("battery", "max", "route within battery", Objective.MAX, True),
    LoadLimit("budget", "sum", "sum within budget", Objective.SUM, True),
    LoadLimit("deviation_limit", "deviation", "deviation within limit", None, False),
    LoadLimit("range_limit", "range", "range within limit", Objective.RANGE, False),
)


def loads_of(model: FleetData, plan: FleetPlan) -> Floats:
    """Return the length of each route, from its depot to its end, shape (routes,)."""
    loads = np.zeros(len(plan.routes))
    for k, route in enumerate(plan.routes):
        stops = model.path_of(min(k, model.vehicles - 1), route)
        loads[k] = sum(model.legs(stops[:-1], stops[1:]).tolist())
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


def measure_of(model: FleetData, name: str, loads: Floats) -> float:
    """Return the "max", "sum", "deviation" or "range" of the route lengths."""
    if name == "deviation":
        return deviation_of(model, loads)
    if name == "sum":
        return float(loads.sum())
    return float(loads.max() if name == "max" else np.ptp(loads))


def objective_of(model: FleetData, loads: Floats) -> float:
    """Return the objective value of `model` for routes of lengths `loads`.

    The objectives "cost" and "makespan" also depend on the plan, see ``value_of``.
    """
    if model.objective in (Objective.COST, Objective.MAKESPAN):
        raise InvalidData(
            f"objective {str(model.objective)!r} is not a function of the route lengths",
            field="objective",
        )
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


def value_of(model: RichData, plan: FleetPlan) -> float | None:
    """Return the objective value of `plan` with one route per vehicle; None if it lacks needed times."""
    timed = model.objective is Objective.MAKESPAN or model.time_cost is not None
    if timed and missing_times(plan):
        return None
    if model.objective is Objective.MAKESPAN:
        return makespan_of(plan)
    loads = loads_of(model, plan)
    is_cost = model.objective is Objective.COST
    return cost_of(model, plan, loads) if is_cost else objective_of(model, loads)


def verify_routes(model: RichData, plan: FleetPlan, tolerance: float) -> Verification:
    """Compute the objective of `plan` and check every constraint of `model`."""
    check_tolerance(tolerance)
    required("plan", plan, FleetPlan)
    for k, route in enumerate(plan.routes):
        check_entries(f"routes[{k}]", route, 0, model.size - 1, "routes")
    loads = loads_of(model, plan)
    unit = model.length_unit
    checks = [
        Check.count("one route for each vehicle", abs(len(plan.routes) - model.vehicles)),
        Check.count("each node visited once", describe_visits(model, plan)),
    ]
    if model.use_all:
        idle = [f"vehicle {k}" for k, route in enumerate(plan.routes) if not route]
        checks.append(Check.count("every vehicle used", idle))
    if len(plan.routes) != model.vehicles:
        return Verification(None, tuple(checks))

    def check_each(name: str, values: Floats, limits: Floats, unit: str) -> Check:
        # A limit of 0 has no scale, so the longest distance is used instead.
        scale = np.where(limits > 0, limits, model.longest)

        def place(k: int) -> str:
            return f"vehicle {k}" if len(values) > 1 else ""

        return Check.within(name, values, limits, unit, place, tolerance, scale=scale)

    if model.is_rich:
        checks += rich_checks(model, plan, tolerance)
    elif model.capacity is not None:
        assert model.demands is not None
        carried = np.array([model.demands[list(route)].sum() for route in plan.routes])
        checks.append(check_each("demands within capacity", carried, model.capacity, ""))
    noise = 1e-12 * float(loads.max(initial=0.0))  # rounding in the lengths
    for rule in LIMITS:
        limit = getattr(model, rule.field)
        if limit is None:
            continue
        if rule.field == "battery":
            # Each vehicle has its own.
            stretches = loads
            if model.stations:
                routes = enumerate(plan.routes)
                stretches = np.array([longest_stretch(model, k, route) for k, route in routes])
            checks.append(check_each(rule.name, stretches, limit, unit))
        else:
            value = measure_of(model, rule.measure, loads)
            checks.append(Check.within(rule.name, value, limit, unit, "", tolerance, noise=noise))
    # The range of nearly equal lengths is almost 0: compare it with the mean length instead.
    scale = float(loads.mean()) if model.objective is Objective.RANGE else 0.0
    return Verification(value_of(model, plan), tuple(checks), scale=scale)
