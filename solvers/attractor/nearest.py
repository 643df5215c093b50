"""Nearest states of an embedding, and representative samples of states."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["nearest", "states_of", "thin_out"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

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
    found: Floats = series[at[:, None] + delay * np.arange(dimension)]
    return found


def nearest(
    states: Floats, times: Ints, asked: Ints, theiler: int, norm: float = np.inf
) -> tuple[Ints, Floats]:
    """Return the nearest distinct state of each given state that is not near in time.

    Parameters
    ----------
    states : ndarray, shape (m, d)
        All states.
    times : ndarray, shape (m,)
        First sample of each state, ascending.
    asked : ndarray, shape (k,)
        Indices of the states whose neighbours are searched.
    theiler : int
        States at most this number of samples apart are not neighbours.
    norm : float
        Norm of the distance: infinity or 2.

    Returns
    -------
    found : ndarray, shape (k,)
        Index of the neighbour; -1 without a neighbour.
    apart : ndarray, shape (k,)
        Distance, above 1e-10 of the extent of the states; infinite without a neighbour.
    """
    from scipy.spatial import KDTree

    same = _SAME * float(np.ptp(states))
    # A tree of equal states cannot be split, so it contains one of each group of equal states. The first
    # and the last state of a group show whether any is distant in time.
    first, last = _repeats(states)
    tree = KDTree(states[first])
    found = np.full(len(asked), -1)
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
        found[left[some]] = np.take_along_axis(which, best, 1)[:, 0]
        apart[left[some]] = np.take_along_axis(far[some], best, 1)[:, 0]
        left = left[~some] if count < len(first) else left[:0]
        count *= 4
    return found, apart


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
