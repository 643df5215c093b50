"""Feasibility of a messenger tour: a tour always exists, because vehicles are slower than the UAV."""

from __future__ import annotations

from ...models.messenger.model import MessengerTour
from ..run.diagnosis import Diagnosis
from ..run.dispatch import solve

__all__ = ["diagnose_tour"]


def diagnose_tour(model: MessengerTour, time_limit: float | None = None) -> Diagnosis:
    """Return a diagnosis, feasible in every case, with the tour found in time (s)."""
    answer = solve(model, model.preferred_backend, time_limit=time_limit)
    if answer.plan is not None:
        return Diagnosis(model.name, True, answer.backend, f"a tour exists: {answer.plan}")
    if model.no_fly is not None:
        return Diagnosis(
            model.name, None, answer.backend, answer.message or str(answer.termination)
        )
    summary = (
        "a tour exists, as every vehicle is slower than the UAV, but none was found: "
        f"{answer.message or answer.termination}"
    )
    return Diagnosis(model.name, True, "vehicles are slower than the UAV", summary)
