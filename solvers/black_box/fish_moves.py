"""Equations of the artificial fish swarms: positions in the unit cube, one fish per row.

Source: "The Robot Path Planning Based on Improved Artificial Fish Swarm Algorithm", Mathematical Problems in
Engineering 2016, article 3297585, called the paper below. Lengths are shares of the variables' ranges, so
the functions do not depend on units. Distances are Euclidean in the unit cube. They equal the paper's distances
if all variables have the same range, as in all its test functions.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

__all__ = ["attenuation", "gaussian", "inertia", "leaders", "segment", "towards"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Inertia β of eq. 14 at the start and at the end of a run, as printed in section 4.
_INERTIA = (0.2, 0.9)


def leaders(place: Floats, value: Floats, visual: float) -> Ints:
    """Return the best fish within the visual of each fish (eq. 1), or the fish itself if it sees no better one."""
    near = cdist(place, place) < visual
    best = np.where(near, value, math.inf).argmin(axis=1)
    every = np.arange(len(value))
    # If no fish within the visual has a value, argmin returns a fish out of sight.
    seen = near[every, best] & (value[best] < value)
    return np.where(seen, best, every)


def towards(place: Floats, target: Floats, length: Floats) -> Floats:
    """Return the moves of given lengths towards the targets: the fractions of eq. 3, 5, 6, 17 and 18.

    A length is the step times a random number. A fish at its target does not move.
    """
    way = target - place
    norm = np.linalg.norm(way, axis=1)
    share = np.divide(length, norm, out=np.zeros(len(way)), where=norm > 0)
    move: Floats = way * share[:, None]
    return move


def attenuation(progress: float, power: int) -> float:
    """Return α = exp(-25 (t / T)^s), the factor of the visual (eq. 10)."""
    return math.exp(-25.0 * progress**power)


def gaussian(progress: float, sigma: float) -> float:
    """Return the normal density of t / T with mean 0, the factor of the step (eq. 12)."""
    return math.exp(-0.5 * (progress / sigma) ** 2) / (sigma * math.sqrt(2.0 * math.pi))


def inertia(progress: float) -> float:
    """Return the inertia weight β, linear from 0.2 at the start to 0.9 at the end (eq. 14)."""
    start, end = _INERTIA
    return start - (start - end) * progress


def segment(progress: float, last: float) -> float:
    """Return the factor of visual and step in the three segments of a run of the hybrid swarm.

    It is 1 in the first quarter, `last` in the last quarter, and falls geometrically between them.
    """
    share: float = last ** min(max(2.0 * progress - 0.5, 0.0), 1.0)
    return share
