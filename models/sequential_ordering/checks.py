"""Independent verification of an order, leg by leg and pair by pair from the raw data."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

from ..fields import required
from ..verification import Check, Verification, check_entries, check_tolerance
from .plan import SequentialOrderingPlan

if TYPE_CHECKING:
    from .model import SequentialOrdering

__all__ = ["verify_ordering"]


def verify_ordering(
    model: SequentialOrdering, plan: SequentialOrderingPlan, tolerance: float
) -> Verification:
    """Return the length of `plan` and the violation of each constraint, see :meth:`.Model.verify`."""
    check_tolerance(tolerance)
    order = required("plan", plan, SequentialOrderingPlan).order
    last = model.size - 1
    check_entries("order", order, 0, last, "order")
    label, times, place = model.label, [0] * model.size, dict[int, int]()
    for stop, node in enumerate(order):
        times[node] += 1
        place.setdefault(node, stop)
    ends = [f"first node {label(0)}"] * (order[:1] != (0,))
    ends += [f"last node {label(last)}"] * (order[-1:] != (last,))
    wrong = [f"node {label(node)}" for node, count in enumerate(times) if count != 1]
    broken = [
        f"{label(before)} before {label(after)}"
        for before, after in dict.fromkeys(map(tuple, model.precedence.tolist()))
        if before in place and after in place and place[before] >= place[after]
    ]
    legs = [(a, b, float(model.distances[a, b])) for a, b in pairwise(order)]
    missing = [f"{label(a)}-{label(b)}" for a, b, leg in legs if a == b or math.isinf(leg)]
    checks = (
        Check.count("first and last node", ends), Check.count("each node once", wrong),
        Check.count("precedence", broken), Check.count("no missing arc", missing),
    )  # fmt: skip
    return Verification(sum(leg for _, _, leg in legs), checks)
