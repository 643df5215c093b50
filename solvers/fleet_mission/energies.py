"""Energies of the legs between the places of a mission: eq. 14 and 17, in three interpretations."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ...models.fleet_mission.data import MissionData
from ...models.grid_path import Sight, distances

__all__ = ["READINGS", "Reading", "leg_energies", "unit_energies"]

Floats = NDArray[np.float64]
Reading = Literal["direct", "manhattan", "paths"]
READINGS: tuple[str, ...] = get_args(Reading)


def unit_energies(places: Floats) -> Floats:
    """Return the energy per metre between places, shape (n, n), 1 … √2 (eq. 17): Manhattan over Euclidean distance.

    `places`, shape (n, 2), are in m. Coinciding places have the value 1.
    """
    step = np.abs(places[:, None] - places[None])
    straight = np.hypot(step[..., 0], step[..., 1])
    units: Floats = np.ones_like(straight)
    np.divide(step.sum(axis=-1), straight, out=units, where=straight > 0)
    return units


def leg_energies(problem: MissionData, reading: Reading) -> Floats:
    """Return the energy of each leg between the depot and the nodes, m, shape (n + 1, n + 1) (eq. 14).

    "direct" takes the Euclidean distance of places that see each other on the map and applies eq. 17 to all
    other pairs (Algorithm 1, lines 8-13). "manhattan" applies eq. 17 to every pair. "paths" takes the length of
    the shortest path along four neighbours. Row 0 is the depot.
    """
    if reading == "paths":
        return distances(problem.map, problem.cells, diagonal=False)
    places, units = problem.places, unit_energies(problem.places)
    if reading == "direct":
        sight = Sight(problem.map)
        for entry, other in zip(*np.triu_indices(len(places), 1), strict=True):
            if sight.between(places[entry], places[other]):
                units[entry, other] = units[other, entry] = 1.0
    step = places[:, None] - places[None]
    return np.asarray(np.hypot(step[..., 0], step[..., 1]) * units)
