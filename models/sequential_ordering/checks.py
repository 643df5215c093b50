"""Independent verification of an order, leg by leg and pair by pair from the raw data."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..fields import required
from ..verification import Check, Verification, check_entries, check_tolerance
from .plan import SequentialOrderingPlan

__all__ = ["verify_ordering"]


def verify_ordering(
    distances: NDArray[np.float64], precedence: NDArray[np.int64], label: Callable[[int], str],
    plan: SequentialOrderingPlan, tolerance: float,
) -> Verification:  # fmt: skip
    """Return the length of `plan` and the violation of each constraint, see :meth:`.Model.verify`.

    `label` returns the name of a node.
    """
    check_tolerance(tolerance)
    order = required("plan", plan, SequentialOrderingPlan).order
    last = len(distances) - 1
    check_entries("order", order, 0, last, "order")
    times, place = [0] * len(distances), dict[int, int]()
    for stop, node in enumerate(order):
        times[node] += 1
        place.setdefault(node, stop)
    ends = [f"first node {label(0)}"] * (order[:1] != (0,))
    ends += [f"last node {label(last)}"] * (order[-1:] != (last,))
    wrong = [f"node {label(node)}" for node, count in enumerate(times) if count != 1]
    broken = [
        f"{label(before)} before {label(after)}"
        for before, after in dict.fromkeys(map(tuple, precedence.tolist()))
        if before in place and after in place and place[before] >= place[after]
    ]
    legs = [(a, b, float(distances[a, b])) for a, b in pairwise(order)]
    missing = [f"{label(a)}-{label(b)}" for a, b, leg in legs if a == b or math.isinf(leg)]
    checks = (
        Check.count("first and last node", ends), Check.count("each node once", wrong),
        Check.count("precedence", broken), Check.count("no missing arc", missing),
    )  # fmt: skip
    return Verification(sum(leg for _, _, leg in legs), checks)
