"""Independent verification of a tour by walking the path and checking each pair of the relation."""

from __future__ import annotations

import numpy as np

from ...errors import InvalidData
from ..fields import required
from ..verification import Check, Verification, check_tolerance
from .data import GuidedPathData
from .plan import GuidedPathPlan

__all__ = ["verify_tour"]


def verify_tour(model: GuidedPathData, plan: GuidedPathPlan, tolerance: float) -> Verification:
    """Return the length of `plan` and the violation of each constraint of `model`.

    Parameters
    ----------
    model : GuidedPathData
        The model.
    plan : GuidedPathPlan
        The plan.
    tolerance : float
        Largest relative violation accepted.

    Returns
    -------
    Verification
        Length (m) and checks.

    Raises
    ------
    InvalidData
        `plan` is not a GuidedPathPlan, or contains an unknown customer.
    """
    check_tolerance(tolerance)
    required("plan", plan, GuidedPathPlan)
    for stop, customer in enumerate(plan.order):
        if not 1 <= customer < model.size:
            raise InvalidData(
                f"order[{stop}] must lie in 1 … {model.size - 1}, got {customer}", field="order"
            )
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
    checks = (
        _count(
            "each customer served once", wrong.size,
            f"customer {label(int(wrong[0]) + 1)}" if wrong.size else "",
        ),
        _count(
            "precedence", len(broken),
            f"{label(broken[0][0])} before {label(broken[0][1])}" if broken else "",
        ),
    )  # fmt: skip
    return Verification(walked, checks)


def _count(name: str, number: int, where: str) -> Check:
    return Check(name, "", float(number), "", 0.0, where, 0.0)
