"""Number of coordinates that unfold an attractor, from nearest neighbours with one coordinate more.

Sources: L. Cao, "Practical method for determining the minimum embedding dimension of a scalar time series",
Physica D 110, 1997; M. B. Kennel, R. Brown and H. D. I. Abarbanel, "Determining embedding dimension for
phase-space reconstruction using a geometrical construction", Physical Review A 45, 1992.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "LARGEST",
    "cao_curves",
    "cao_dimension",
    "false_shares",
    "largest_dimension",
    "nearest",
    "saturated",
    "states_of",
    "thin_out",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Default of the largest dimension.
LARGEST = 10
#: Largest number of states among which neighbours are searched, and of states whose neighbours are searched.
_AMONG, _ASKED = 20_000, 2_000
#: Value of Cao's E₁ at which it is saturated; the limit is 1.
_SATURATED = 0.9
#: Kennel's tolerances: relative growth of a distance, and distance in deviations of the series.
_RATIO, _ATTRACTOR = 15.0, 2.0
#: Number of neighbours in the first query, and largest number, above which a state has no neighbour.
_FIRST, _MOST = 4, 1024
#: Fractional part of the golden ratio, whose multiples do not synchronise with any period.
_GOLDEN = 0.6180339887498949
#: Distance relative to the extent of the states that is due to rounding.
_SAME = 1e-10


def thin_out(count: int, most: int) -> Ints:
    """Return at most `most` of the numbers 0 … count - 1, ascending, one from each of equal stretches.

    The position within a stretch follows the multiples of the golden ratio, because an even step would see
    a periodic series at few phases only.
    """
    if count <= most:
        return np.arange(count)
    k = np.arange(most)
    return np.floor((k + k * _GOLDEN % 1.0) * (count / most)).astype(np.int64)


def states_of(series: Floats, at: Ints, delay: int, dimension: int) -> Floats:
    """Return the states that begin at the given samples, shape (len(at), dimension)."""
    result: Floats = series[at[:, None] + delay * np.arange(dimension)]
    return result


def nearest(
    states: Floats, times: Ints, asked: Ints, theiler: int, norm: float = np.inf
) -> tuple[Ints, Floats]:
    """Return the nearest distinct state of each given state that is not near in time, and its distance.

    `states`, shape (m, d), have ascending `times`. States at most `theiler` samples apart are not
    neighbours, nor are those within 1e-10 of the extent of the states. The norm is infinity or 2. Without a
    neighbour the index is -1, and the distance infinite.
    """
    from scipy.spatial import KDTree

    same = _SAME * float(np.ptp(states))
    # A tree of equal states cannot be split, so it contains one of each group of equal states. The first
    # and the last state of a group show whether any is distant in time.
    first, last = _repeats(states)
    tree = KDTree(states[first])
    result = np.full(len(asked), -1)
    apart = np.full(len(asked), np.inf)
    left, count = np.arange(len(asked)), _FIRST
    while left.size and count <= _MOST:
        mine = asked[left]
        far, who = tree.query(states[mine], range(1, min(count, len(first)) + 1), p=norm)
        early, late = first[who], last[who]
        before = np.abs(times[early] - times[mine][:, None]) > theiler
        good = (before | (np.abs(times[late] - times[mine][:, None]) > theiler)) & (far > same)
        some = good.any(axis=1)
        best = good[some].argmax(axis=1)[:, None]
        which = np.where(before, early, late)[some]
        result[left[some]] = np.take_along_axis(which, best, 1)[:, 0]
        apart[left[some]] = np.take_along_axis(far[some], best, 1)[:, 0]
        left = left[~some] if count < len(first) else left[:0]
        count *= 4
    return result, apart


def _repeats(states: Floats) -> tuple[Ints, Ints]:
    """Return the first and the last index of each group of equal states."""
    every = np.arange(len(states))
    if len(np.unique(states[:, 0])) == len(states):
        return every, every
    _, group = np.unique(states, axis=0, return_inverse=True)
    group = group.ravel()
    first, last = np.full((2, int(group.max()) + 1), -1)
    last[group] = every
    first[group[::-1]] = every[::-1]
    return first, last


def largest_dimension(count: int, delay: int, most: int = LARGEST) -> int:
    """Return the largest dimension up to `most` whose states span no more than half of `count` samples."""
    return max(min(most, count // 2 // delay), 1)


@dataclass(frozen=True)
class Neighbours:
    """Distances of nearest neighbours in some coordinates, and differences of the next coordinate."""

    apart: Floats
    new: Floats


def neighbours(series: Floats, delay: int, dimension: int, theiler: int, norm: float) -> Neighbours:
    """Return nearest neighbours of at most 2000 states among at most 20 000; states without one are omitted."""
    at = thin_out(len(series) - dimension * delay, _AMONG)
    states = states_of(series, at, delay, dimension + 1)
    asked = thin_out(len(at), _ASKED)
    result, apart = nearest(states[:, :dimension], at, asked, theiler, norm)
    good = result >= 0
    return Neighbours(apart[good], np.abs(states[asked[good], -1] - states[result[good], -1]))


def cao_curves(
    series: Floats, delay: int, most: int, theiler: int | None = None
) -> tuple[Floats, Floats]:
    """Return Cao's E₁ and E₂ of the dimensions 1 … `most`; NaN if all neighbours have distance 0.

    E(d) is the mean growth of the distance of nearest neighbours from d to d + 1 coordinates, and E₁(d) =
    E(d + 1) / E(d). E₂ is the same for the distance of the new coordinates alone: 1 in every dimension for
    noise. Neighbours are more than `theiler` samples, by default a delay, apart in time, because neighbours
    on the same piece of a trajectory do not show its folds. The series has more than ``(most + 1) * delay``
    samples.
    """
    grows, moves = np.full(most + 1, np.nan), np.full(most + 1, np.nan)
    for k in range(most + 1):
        result = neighbours(series, delay, k + 1, delay if theiler is None else theiler, np.inf)
        if result.new.size:
            grows[k] = np.maximum(result.new / result.apart, 1.0).mean()
            moves[k] = result.new.mean()
    with np.errstate(all="ignore"):
        return grows[1:] / grows[:-1], moves[1:] / moves[:-1]


def cao_dimension(series: Floats, delay: int) -> int:
    """Return the smallest dimension at which Cao's E₁ is at least 0.9, and at the next dimension, too.

    If the curve does not saturate, it is the largest dimension tried, 10 or fewer for a short series.
    """
    most = largest_dimension(len(series), delay)
    return saturated(cao_curves(series, delay, most)[0])


def saturated(curve: Floats) -> int:
    """Return the first dimension at which `curve` is at least 0.9, and at the next one, too; else the last.

    Later dips are ignored, because short series have no near neighbours in many dimensions.
    """
    is_saturated = np.append(curve >= _SATURATED, True)
    stays_saturated = is_saturated[:-1] & is_saturated[1:]
    return int(stays_saturated.argmax()) + 1 if stays_saturated.any() else len(curve)


def false_shares(series: Floats, delay: int, most: int, theiler: int) -> Floats:
    """Return the share of false nearest neighbours of the dimensions 1 … `most`; NaN without neighbours.

    A neighbour is false if the next coordinates differ by more than 15 times the distance, or if the
    distance with them exceeds two deviations of the series.
    """
    shares = np.full(most, np.nan)
    size = float(series.std())
    for k in range(most):
        result = neighbours(series, delay, k + 1, theiler, 2)
        if result.new.size:
            far = np.hypot(result.new, result.apart) > _ATTRACTOR * size
            shares[k] = (far | (result.new > _RATIO * result.apart)).mean()
    return shares
