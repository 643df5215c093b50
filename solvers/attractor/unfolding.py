"""How many coordinates unfold an attractor: what becomes of nearest neighbours with one coordinate more.

Sources: L. Cao, "Practical method for determining the minimum embedding dimension of a scalar time series",
Physica D 110, 1997; M. B. Kennel, R. Brown and H. D. I. Abarbanel, "Determining embedding dimension for
phase-space reconstruction using a geometrical construction", Physical Review A 45, 1992.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .nearest import nearest, states_of, thin_out

__all__ = [
    "LARGEST",
    "cao_curves",
    "cao_dimension",
    "false_shares",
    "largest_dimension",
    "saturated",
]

Floats = NDArray[np.float64]

#: Dimensions that are tried at the most.
LARGEST = 10
#: States at the most among which neighbours are sought, and whose neighbours.
_AMONG, _ASKED = 20_000, 2_000
#: Share of its limit 1 at which Cao's E₁ counts as saturated.
_SATURATED = 0.9
#: Kennel's tolerances: of the growth of a distance, and of the distance in deviations of the series.
_RATIO, _ATTRACTOR = 15.0, 2.0


def largest_dimension(count: int, delay: int, most: int = LARGEST) -> int:
    """Return the largest dimension up to `most` whose states span no more than half of `count` samples."""
    return max(min(most, count // 2 // delay), 1)


@dataclass(frozen=True)
class Neighbours:
    """States and their nearest neighbours in some coordinates, with one coordinate more.

    Parameters
    ----------
    apart : ndarray, shape (k,)
        Distances in the coordinates.
    new : ndarray, shape (k,)
        Differences of the next coordinate.
    """

    apart: Floats
    new: Floats


def neighbours(series: Floats, delay: int, dimension: int, theiler: int, norm: float) -> Neighbours:
    """Return nearest neighbours, of 2000 states at most among 20 000 at most; states without one are left out."""
    at = thin_out(len(series) - dimension * delay, _AMONG)
    states = states_of(series, at, delay, dimension + 1)
    asked = thin_out(len(at), _ASKED)
    found, apart = nearest(states[:, :dimension], at, asked, theiler, norm)
    good = found >= 0
    return Neighbours(apart[good], np.abs(states[asked[good], -1] - states[found[good], -1]))


def cao_curves(
    series: Floats, delay: int, most: int, theiler: int | None = None
) -> tuple[Floats, Floats]:
    """Return Cao's E₁ and E₂ of the dimensions 1 … `most`.

    E(d) is how much further nearest neighbours in d coordinates are in d + 1, on average, and E₁(d) =
    E(d + 1) / E(d). E₂ is the same of the distance of the new coordinates alone: 1 in every dimension for noise.
    Neighbours are more than a delay apart in time, for those on the same piece of a trajectory say
    nothing of its folds.

    Parameters
    ----------
    series : ndarray, shape (n,)
    delay : int
    most : int
        ``(most + 1) * delay < n``.
    theiler : int, optional
        Samples that neighbours must be more than apart; the delay.

    Returns
    -------
    ndarray, shape (most,)
    ndarray, shape (most,)
        Not a number where neighbours are nowhere apart.
    """
    grows, moves = np.full(most + 1, np.nan), np.full(most + 1, np.nan)
    for k in range(most + 1):
        found = neighbours(series, delay, k + 1, delay if theiler is None else theiler, np.inf)
        if found.new.size:
            grows[k] = np.maximum(found.new / found.apart, 1.0).mean()
            moves[k] = found.new.mean()
    with np.errstate(all="ignore"):
        return grows[1:] / grows[:-1], moves[1:] / moves[:-1]


def cao_dimension(series: Floats, delay: int) -> int:
    """Return the least dimension at which Cao's E₁ is within a tenth of 1, and stays there at the next.

    Parameters
    ----------
    series : ndarray, shape (n,)
        Not constant.
    delay : int
        Samples between coordinates, at most a tenth of the series.

    Returns
    -------
    int
        The largest that was tried, 10 or what the series has samples for, where the curve does not saturate.
    """
    most = largest_dimension(len(series), delay)
    return saturated(cao_curves(series, delay, most)[0])


def saturated(curve: Floats) -> int:
    """Return the first dimension at which `curve` is within a tenth of 1, and at the next one too; else the last.

    Later dips are left aside: in many dimensions short series have no near neighbours.
    """
    good = np.append(curve >= _SATURATED, True)
    found = good[:-1] & good[1:]
    return int(found.argmax()) + 1 if found.any() else len(curve)


def false_shares(series: Floats, delay: int, most: int, theiler: int) -> Floats:
    """Return the share of false nearest neighbours of the dimensions 1 … `most`.

    A neighbour is false where the next coordinate is more than 15 times as far apart as the states are, or where
    the states with it are more than two deviations of the series apart.

    Parameters
    ----------
    series : ndarray, shape (n,)
    delay : int
    most : int
        ``most * delay < n``.
    theiler : int
        Samples that neighbours must be more than apart.

    Returns
    -------
    ndarray, shape (most,)
        Not a number where no state has a neighbour.
    """
    shares = np.full(most, np.nan)
    size = float(series.std())
    for k in range(most):
        found = neighbours(series, delay, k + 1, theiler, 2)
        if found.new.size:
            far = np.hypot(found.new, found.apart) > _ATTRACTOR * size
            shares[k] = (far | (found.new > _RATIO * found.apart)).mean()
    return shares
