"""Diagnosis of flights: the places that obstacles separate."""

from __future__ import annotations

from ...models.flight.model import Flight
from ..run.diagnosis import Diagnosis, Finding
from .proofs import separations

__all__ = ["diagnose_flight"]


def diagnose_flight(model: Flight, time_limit: float | None = None) -> Diagnosis:
    """Return the consecutive places of a flight that are proven to be separated, and by what.

    Parameters
    ----------
    model : Flight
        The model to diagnose.
    time_limit : float, optional
        Ignored: the components of the free space are computed without a search.

    Returns
    -------
    Diagnosis
        An infeasible flight with one finding per separated pair of places. Without such a pair, neither
        feasibility nor infeasibility is proven.
    """
    method = "components of the free space"
    findings = tuple(
        Finding(
            str(pair),
            where=f"{pair.first} to {pair.second}",
            data={"first": pair.first, "second": pair.second, "reason": pair.reason},
        )
        for pair in separations(model)
    )
    if findings:
        summary = "no plan: obstacles separate consecutive places"
        return Diagnosis(model.name, False, method, summary, findings)
    summary = "no cause is proven: consecutive places are connected or not proven to be separated"
    return Diagnosis(model.name, None, method, summary)
