"""Nearest states of an embedding, and fewer states that stand for all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["nearest", "states_of", "thin_out"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Neighbours asked for at first, and at the most: beyond that a state counts as one without neighbour.
_FIRST, _MOST = 4, 1024
#: Fractional part of the golden ratio, whose multiples never fall in step with a period.
_GOLDEN = 0.6180339887498949
#: Share of the states' extent that is as good as no distance: rounding.
_SAME = 1e-10


def thin_out(count: int, most: int) -> Ints:
    """Return at most `most` of the numbers 0 … count - 1, ascending: one from each of equally long stretches.

    Where in its stretch it lies follows the multiples of the golden ratio, for an even step would see a
    periodic series at a few phases only.
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
    """Return the nearest other state of each state that is asked for, which is neither near in time nor the same.

    Parameters
    ----------
    states : ndarray, shape (m, d)
    times : ndarray, shape (m,)
        The sample at which each begins, ascending.
    asked : ndarray, shape (k,)
        Which states.
    theiler : int
        States at most as many samples apart are no neighbours.
    norm : float
        Of the distance: infinity or 2.

    Returns
    -------
    found : ndarray, shape (k,)
        Which state it is, -1 where there is none.
    apart : ndarray, shape (k,)
        How far, > 1e-10 of the states' extent; infinite where there is none.
    """
    from scipy.spatial import KDTree

    same = _SAME * float(np.ptp(states))
    # A tree of states that are all alike cannot be split: of those that are the same it holds one. The first and the
    # last of them tell whether any is far enough in time.
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
    """Return the first and the last of the states that are the same, for each state that there is."""
    every = np.arange(len(states))
    if len(np.unique(states[:, 0])) == len(states):
        return every, every
    _, group = np.unique(states, axis=0, return_inverse=True)
    group = group.ravel()
    first, last = np.full((2, int(group.max()) + 1), -1)
    last[group] = every
    first[group[::-1]] = every[::-1]
    return first, last
