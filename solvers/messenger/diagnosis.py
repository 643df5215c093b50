"""Whether a messenger tour exists: it always does, for vehicles are slower than the UAV."""

from __future__ import annotations

from ...models.messenger.model import MessengerTour
from ..diagnosis import Diagnosis
from ..dispatch import solve

__all__ = ["diagnose_tour"]


def diagnose_tour(model: MessengerTour, time_limit: float | None = None) -> Diagnosis:
    """Return that there is a tour, and the one that was found.

    Parameters
    ----------
    model : MessengerTour
        What is asked.
    time_limit : float, optional
        Seconds for the search.
    """
    answer = solve(model, "tour-search", time_limit=time_limit)
    if answer.plan is not None:
        return Diagnosis(model.name, True, "tour-search", f"a tour exists: {answer.plan}")
    summary = (
        "a tour exists, as every vehicle is slower than the UAV, but none was found: "
        f"{answer.message or answer.termination}"
    )
    return Diagnosis(model.name, True, "vehicles are slower than the UAV", summary)
