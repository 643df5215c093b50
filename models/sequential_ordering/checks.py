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
    ends = [f"first node {label(0)}"] * (order[:1] != (0,))
    ends += [f"last node {label(last)}"] * (order[-1:] != (last,))
    stops = np.array(order, np.int64)
    times = np.bincount(stops, minlength=last + 1)
    wrong = [f"node {label(node)}" for node in np.flatnonzero(times != 1).tolist()]
    place = np.full(last + 1, -1)
    place[stops[::-1]] = np.arange(len(order))[::-1]  # the first stop at each node
    first, second = place[precedence].T
    mask = (first >= 0) & (second >= 0) & (first >= second)
    broken = [
        f"{label(a)} before {label(b)}" for a, b in np.unique(precedence[mask], axis=0).tolist()
    ]
    legs = [(a, b, float(distances[a, b])) for a, b in pairwise(order)]
    missing = [f"{label(a)}-{label(b)}" for a, b, leg in legs if a == b or math.isinf(leg)]
    checks = (
        Check.count("first and last node", ends), Check.count("each node once", wrong),
        Check.count("precedence", broken), Check.count("no missing arc", missing),
    )  # fmt: skip
    return Verification(sum(leg for _, _, leg in legs), checks)
