"""Verification of a plan of several UAVs by one tour per UAV."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..verification import Check, Verification, check_entries
from .checks import check_start, verify_tour
from .data import TourData
from .plan import TourPlan

__all__ = ["verify_crew"]


def verify_crew(model: TourData, plan: TourPlan, tolerance: float) -> Verification:
    """Return the latest finish as a length (m), and the checks of the tour of each UAV.

    The tour of a UAV is verified on the model of its vehicles alone. Each check is named after its UAV.
    """
    check_entries("order", plan.order, 0, model.size - 1, "order")
    counts = np.bincount(np.array(plan.order, int), minlength=model.size)
    wrong = [f"vehicle {model.label(int(k))}" for k in np.flatnonzero(counts != 1)]
    starts = model.starts
    parts = plan.parts()
    stray = [] if len(parts) == len(starts) else [f"{len(parts)} UAVs instead of {len(starts)}"]
    flights = sum(len(part.primitives) for part in parts)
    if flights != len(plan.primitives):
        stray.append(f"{len(plan.primitives) - flights} primitives of no UAV")
    checks = [
        Check.count("each vehicle met once", wrong, unit="vehicles"),
        Check.count("one tour per UAV", stray, unit="UAVs"),
    ]
    longest = 0.0
    for k, part in enumerate(parts[: len(starts)]):
        if part.order:
            alone = replace(part, order=tuple(range(len(part.order))))
            result = verify_tour(model.share(k, part.order), alone, tolerance)
            longest = max(longest, result.objective or 0.0)
            more = result.checks
        else:
            pieces = [f"primitive {row}" for row in range(len(part.primitives))]
            idle = replace(model, start=starts[k], uavs=None)
            more = (
                Check.count("no flight without vehicles", pieces, unit="primitives"),
                *check_start(idle, part, tolerance),
            )
        checks += [replace(item, name=f"{item.name} (UAV {k})") for item in more]
    return Verification(longest, tuple(checks), scale=0.0)
