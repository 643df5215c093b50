"""What artificial fish see and how they move: positions in the unit cube, one fish a row.

Sources: "The Robot Path Planning Based on Improved Artificial Fish Swarm Algorithm", Mathematical
Problems in Engineering 2016, article 3297585, called the paper below; X.-L. Li, Z.-J. Shao and J.-X. Qian,
"An optimizing method based on autonomous animats: fish-swarm algorithm", Systems Engineering: Theory and
Practice 22(11), 2002. Lengths are shares of the variables' ranges, so nothing here knows the units.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

__all__ = ["attenuation", "centres", "leaders", "neighbours", "segment", "towards"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


def neighbours(place: Floats, visual: float) -> Bools:
    """Return which fish each fish sees, shape (n, n): those nearer than `visual` in every variable.

    Visual is a share of each variable's range, so what a fish sees is a box, the same as where it preys.
    Nobody sees itself.
    """
    near: Bools = cdist(place, place, "chebyshev") < visual
    np.fill_diagonal(near, False)
    return near


def centres(place: Floats, near: Bools) -> Floats:
    """Return the mean place X_c of the fish that each fish sees (eq. 4), its own place where it sees none."""
    count = near.sum(axis=1)[:, None]
    found: Floats = np.divide(near @ place, count, out=place.copy(), where=count > 0)
    return found


def leaders(value: Floats, near: Bools) -> Ints:
    """Return the best fish X_max that each fish sees (eq. 6), itself where none has a value."""
    best = np.where(near, value, math.inf).argmin(axis=1)
    rows = np.arange(len(value))
    return np.where(near[rows, best], best, rows)


def towards(place: Floats, target: Floats, length: Floats) -> Floats:
    """Return the moves of the given lengths to the targets, (X_v - X) / ‖X_v - X‖ · length (eq. 2).

    The norm is the largest change of a variable, as step, like vision, is a share of each variable's
    range: with the Euclidean norm, fish hardly move where there are many variables.

    Parameters
    ----------
    place, target : ndarray, shape (m, d)
    length : ndarray, shape (m,)

    Returns
    -------
    ndarray, shape (m, d)
        0 where a fish is at its target.
    """
    way = target - place
    norm = np.abs(way).max(axis=1)
    share = np.divide(length, norm, out=np.zeros(len(way)), where=norm > 0)
    found: Floats = way * share[:, None]
    return found


def attenuation(progress: float, power: int) -> float:
    """Return α = exp(-30 (t / T)^s) for eq. 10, with the share of the evaluations for t / T.

    It is 1 at first and exp(-30) = 9e-14 at the end. The form is the one in common use for
    swarms of fish; the least vision that is often added (eq. 11) is left out, as α is never 0.
    """
    return math.exp(-30.0 * progress**power)


def segment(progress: float, last: float) -> float:
    """Return what vision and step are multiplied with, in three segments of the run.

    1 in the first quarter, then falling by the same factor for the same share of the evaluations down to
    `last`, which holds in the last quarter.
    """
    share: float = last ** min(max(2.0 * progress - 0.5, 0.0), 1.0)
    return share
