"""Whether a mission can be carried out: what its data allows always can, and how wide robots may be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...errors import InvalidData
from ...models.fleet_mission.model import FleetMission
from ..diagnosis import Diagnosis, Finding

__all__ = ["diagnose_mission"]

#: Halvings of the interval in which the greatest radius lies.
HALVINGS = 12


def diagnose_mission(model: FleetMission, time_limit: float | None = None) -> Diagnosis:
    """Return that there is a plan, what limits the robots' radius, and the greatest one.

    A model whose nodes no robot can reach is refused when it is made, and its error says which and
    why. Otherwise robots may go one after the other, and rest wherever they turn.

    Parameters
    ----------
    model : FleetMission
        What is asked.
    time_limit : float, optional
        Not needed: no search is made.
    """
    room = -model.solids.depths(model.places, 0.0)
    k = int(np.argmin(room))
    low = model.radius
    high = float(min(room[k], np.ptp(model.bounds.reshape(2, 2), axis=0).max()))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if _possible(model, middle):
            low = middle
        else:
            high = middle
    place = "the depot" if k == 0 else f"node {model.label(k - 1)}"
    findings = []
    if np.isfinite(room[k]):
        findings.append(
            Finding(
                f"{place} is the nearest to an obstacle, {room[k]:.4g} m from it",
                where=place,
                data={"distance": float(room[k])},
            )
        )
        findings.append(
            Finding(
                f"robots of a radius of up to {low:.4g} m could do it on cells of {model.cell:g} m; "
                f"radius is {model.radius:g} m",
                data={"radius": model.radius, "greatest": low},
            )
        )
    return Diagnosis(
        model.name, True, "connected free cells",
        "a plan exists: all nodes can be reached from the depot, by robots that go one after the other "
        "and rest where they turn",
        tuple(findings),
    )  # fmt: skip


def _possible(model: FleetMission, radius: float) -> bool:
    """Return whether robots of another radius could reach all nodes."""
    try:
        replace(model, radius=radius)
    except InvalidData:
        return False
    return True
