"""Independent verification of a tour by walking the path and checking each pair of the relation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import required
from ..verification import Check, Verification, check_entries, check_tolerance
from .data import GuidedPathData
from .plan import GuidedPathPlan
from .schedule import Walk, time_scales, walk_of

__all__ = ["verify_tour"]

Floats = NDArray[np.float64]


def verify_tour(model: GuidedPathData, plan: GuidedPathPlan, tolerance: float) -> Verification:
    """Return the length of `plan` (m) and the violation of each constraint, see :meth:`.Model.verify`."""
    check_tolerance(tolerance)
    required("plan", plan, GuidedPathPlan)
    check_entries("order", plan.order, 1, model.size - 1, "order")
    fleet = 0 if model.vehicles is None else len(model.vehicles)
    if len(plan.vehicles) != (len(plan.order) if fleet else 0):
        raise InvalidData(
            f"vehicles must name the vehicle of each of {len(plan.order)} stops, got {len(plan.vehicles)}"
            if fleet
            else f"vehicles must be empty for a model without vehicles, got {len(plan.vehicles)}",
            field="vehicles",
        )
    check_entries("vehicles", plan.vehicles, 0, fleet - 1, "vehicles")
    times = np.bincount(np.array(plan.order, int), minlength=model.size)[1:]
    wrong = np.flatnonzero(times != 1)
    first = np.full(model.size, len(plan.order))
    first[np.array(plan.order[::-1], int)] = np.arange(len(plan.order))[::-1]
    before, after = first[model.links].T
    broken = model.links[(before >= after) & (before < len(plan.order))].tolist()
    label = model.label
    served = [f"customer {label(int(k) + 1)}" for k in wrong]
    checks = [
        Check.count("each customer served once", served),
        Check.count("precedence", [f"{label(a)} before {label(b)}" for a, b in broken]),
    ]
    walk = walk_of(model, plan)
    if fleet:
        split = [
            f"chain {k}"
            for k, chain in enumerate(model.chains)
            if len({plan.vehicles[first[c]] for c in chain if first[c] < len(plan.order)}) > 1
        ]
        checks.append(Check.count("chain served by one vehicle", split))
    if model.loads is not None:
        checks.append(_check_load(model, model.loads, walk, tolerance))
    if model.windows is not None:
        checks += _check_windows(model, model.windows, walk, tolerance)
    return Verification(float(walk.walked[-1]), tuple(checks))


def _check_load(model: GuidedPathData, loads: Floats, walk: Walk, tolerance: float) -> Check:
    """Return the check that the load after each stop is within 0 … capacity."""
    load = walk.load[1:-1]
    capacity = np.inf if model.capacity is None else model.capacity
    return Check.largest(
        "load within 0 … capacity", np.maximum(-load, load - capacity),
        max(float(np.abs(loads).max()), 1e-300), "",
        lambda k: f"customer {model.label(walk.stops[k + 1])}", tolerance, limit=model.capacity,
    )  # fmt: skip


def _check_windows(
    model: GuidedPathData, windows: Floats, walk: Walk, tolerance: float
) -> list[Check]:
    """Return the checks of the latest begin of each service and of the end of the tour."""
    late = walk.begin - windows[walk.stops, 1]
    scales, noise = (values[walk.stops] for values in time_scales(windows))
    scales = np.maximum(scales, 1e-300)
    return [
        Check.largest(
            "begin within the time window", late[1:-1], scales[1:-1], "s",
            lambda k: f"customer {model.label(walk.stops[k + 1])}", tolerance,
            noise=noise[1:-1],
        ),
        Check.largest(
            "end of the tour in time", late[-1:], scales[-1:], "s", "end of the tour", tolerance,
            noise=noise[-1:],
        ),
    ]  # fmt: skip
