"""Independent verification of a tour by walking the path and checking each pair of the relation."""

from __future__ import annotations

import numpy as np

from ..fields import required
from ..verification import Check, Verification, check_entries, check_tolerance
from .data import GuidedPathData
from .plan import GuidedPathPlan

__all__ = ["verify_tour"]


def verify_tour(model: GuidedPathData, plan: GuidedPathPlan, tolerance: float) -> Verification:
    """Return the length of `plan` (m) and the violation of each constraint, see :meth:`.Model.verify`."""
    check_tolerance(tolerance)
    required("plan", plan, GuidedPathPlan)
    check_entries("order", plan.order, 1, model.size - 1, "order")
    times = np.bincount(np.array(plan.order, int), minlength=model.size)[1:]
    wrong = np.flatnonzero(times != 1)
    first: dict[int, int] = {}
    for stop, customer in enumerate(plan.order):
        first.setdefault(customer, stop)
    broken = [
        (before, after)
        for before, after in model.pairs
        if before in first and after in first and first[before] >= first[after]
    ]
    walked, position = 0.0, float(model.coordinates[0])
    for customer in (*plan.order, 0):
        there = float(model.coordinates[customer])
        walked += abs(there - position)
        position = there
    label = model.label
    served = [f"customer {label(int(k) + 1)}" for k in wrong]
    pairs = [f"{label(before)} before {label(after)}" for before, after in broken]
    checks = Check.count("each customer served once", served), Check.count("precedence", pairs)
    return Verification(walked, checks)
