"""Diagnosis of missions: every valid mission is feasible; report the largest possible radius."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...errors import InvalidData
from ...models.fleet_mission.model import FleetMission
from ..run.diagnosis import Diagnosis, Finding

__all__ = ["diagnose_mission"]

#: Bisections of the interval of the largest radius.
HALVINGS = 12


def diagnose_mission(model: FleetMission, time_limit: float | None = None) -> Diagnosis:
    """Return the feasibility of a mission, the place that limits the radius, and the largest radius.

    A model with unreachable nodes raises when it is constructed. In every other model a plan exists: robots
    move one after the other and rest wherever they turn. `time_limit` is ignored, because no search is needed.
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
    text = "all nodes can be reached from the depot, by robots that go one after the other"
    if model.moving:
        text += "; whether moving obstacles leave the way free is not decided"
        return Diagnosis(model.name, None, "connected free cells", text, tuple(findings))
    text = f"a plan exists: {text} and rest where they turn"
    return Diagnosis(model.name, True, "connected free cells", text, tuple(findings))


def _possible(model: FleetMission, radius: float) -> bool:
    """Return whether robots of the given radius, m, can reach all nodes."""
    try:
        replace(model, radius=radius)
    except InvalidData:
        return False
    return True
