"""Feasibility of a messenger tour: without zones and windows a tour exists, as vehicles are slower than the UAV."""

from __future__ import annotations

import math
from dataclasses import replace

from ...models.messenger.model import MessengerTour
from ..run.diagnosis import Diagnosis
from ..run.dispatch import solve

__all__ = ["diagnose_tour"]

#: Margin of the proof, relative to length and radius, above the tolerance of the verification.
MARGIN = 1e-5


def diagnose_tour(model: MessengerTour, time_limit: float | None = None) -> Diagnosis:
    """Return a diagnosis with the tour found in time (s), or a vehicle that no UAV can meet in its window."""
    if (reason := _missed_window(model)) is not None:
        return Diagnosis(model.name, False, "bounds of single vehicles", reason)
    answer = solve(model, model.preferred_backend, time_limit=time_limit)
    if answer.plan is not None:
        return Diagnosis(model.name, True, answer.backend, f"a tour exists: {answer.plan}")
    if model.no_fly is not None or model.windows is not None:
        return Diagnosis(
            model.name, None, answer.backend, answer.message or str(answer.termination)
        )
    summary = (
        "a tour exists, as every vehicle is slower than the UAV, but none was found: "
        f"{answer.message or answer.termination}"
    )
    return Diagnosis(model.name, True, "vehicles are slower than the UAV", summary)


def _missed_window(model: MessengerTour) -> str | None:
    """Return the reason why a vehicle cannot be met in its window, even as the first one; None if none is proven."""
    if model.windows is None:
        return None
    open_tour = replace(model, windows=None, no_fly=None, closed=False, home_velocity=None)
    for k, end in enumerate(model.windows[:, 1].tolist()):
        if end < math.inf:
            first = min(
                solve(open_tour.share(uav, [k]), "curvature-bound").dual_bound or 0.0
                for uav in range(len(model.starts))
            )
            if first - MARGIN * (first + float(model.radius[k])) > model.speed * end:
                return (
                    f"vehicle {model.label(k)} can be met after {first / model.speed:.4g} s at the earliest, but its "
                    f"window ends at {end:g} s"
                )
    return None
