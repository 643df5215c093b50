"""Labels of a search in growing columns, with the points already visited as bit masks.

A label is a partial route: where it ends, its length, the error that survives there, the label it
extends, and which of the *critical* points it may not visit any more: those that it has visited, and
those that no way to B below the ceiling leads through. One label dominates another of the same point
when it is no longer, carries no more error and has visited no critical point that the other may
still visit. For take any way from the other to B below the ceiling: it visits only critical points
that the other may still visit, hence none that the one has visited, and it carries no more error and
no more length from the one than from the other. (A shorter label may still visit whatever a longer
one may, so comparing what both may not visit comes to the same.) Without critical points the mask is
empty, and the rule ignores visits altogether, which is exact only where revisits are allowed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["Labels", "add", "close", "dominated", "grown", "link", "make", "visited"]


class Labels(NamedTuple):
    """Columns of labels; only the first ones are in use.

    Attributes
    ----------
    slot, parent, following : ndarray of int64
        Where the label ends, the label it extends (-1 for none), and the next one in the list of
        its slot (-1 at the end).
    length, error : ndarray
        Length (m) and surviving error.
    visited : ndarray of uint64, shape (room, words)
        Critical points that may not be visited (any more), by bit.
    """

    slot: NDArray[np.int64]
    parent: NDArray[np.int64]
    following: NDArray[np.int64]
    length: NDArray[np.float64]
    error: NDArray[np.float64]
    visited: NDArray[np.uint64]


@kernel
def make(room: int, words: int) -> Labels:
    """Return empty columns."""
    return Labels(
        np.empty(room, np.int64),
        np.empty(room, np.int64),
        np.full(room, -1),
        np.empty(room),
        np.empty(room),
        np.zeros((room, words), np.uint64),
    )


@kernel
def grown(labels: Labels, used: int, room: int) -> Labels:
    """Return columns with more room and the same first `used` labels."""
    wider = make(room, labels.visited.shape[1])
    for k in range(used):
        wider.slot[k] = labels.slot[k]
        wider.parent[k] = labels.parent[k]
        wider.following[k] = labels.following[k]
        wider.length[k] = labels.length[k]
        wider.error[k] = labels.error[k]
        for word in range(labels.visited.shape[1]):
            wider.visited[k, word] = labels.visited[k, word]
    return wider


@kernel
def add(
    labels: Labels, at: int, slot: int, parent: int, length: float, error: float, bit: int
) -> None:
    """Write label `at`; `bit` is the number of the slot among the critical points, -1 for none."""
    labels.slot[at] = slot
    labels.parent[at] = parent
    labels.following[at] = -1
    labels.length[at] = length
    labels.error[at] = error
    for word in range(labels.visited.shape[1]):
        labels.visited[at, word] = labels.visited[parent, word] if parent >= 0 else np.uint64(0)
    if bit >= 0:
        close(labels, at, bit)


@kernel
def close(labels: Labels, at: int, bit: int) -> None:
    """Forbid label `at` to visit the critical point with this bit."""
    labels.visited[at, bit >> 6] |= np.uint64(1) << np.uint64(bit & 63)


@kernel
def visited(labels: Labels, label: int, bit: int) -> bool:
    """Whether `label` may not visit the critical point with this bit."""
    if bit < 0:
        return False
    word: np.uint64 = labels.visited[label, bit >> 6]
    return bool((word >> np.uint64(bit & 63)) & np.uint64(1) != 0)


@kernel
def beats(labels: Labels, one: int, other: int) -> bool:
    """Whether label `one` dominates label `other` of the same slot."""
    if labels.length[one] > labels.length[other] or labels.error[one] > labels.error[other]:
        return False
    for word in range(labels.visited.shape[1]):
        if labels.visited[one, word] & ~labels.visited[other, word] != np.uint64(0):
            return False
    return True


@kernel
def dominated(labels: Labels, first: int, at: int) -> bool:
    """Whether a label in the list that begins with `first` dominates label `at`."""
    other = first
    while other >= 0:
        if beats(labels, other, at):
            return True
        other = labels.following[other]
    return False


@kernel
def link(labels: Labels, heads: NDArray[np.int64], at: int) -> int:
    """Put label `at` into the list of its slot and drop what it dominates; return how many went."""
    slot = labels.slot[at]
    dropped = 0
    before = -1
    other = heads[slot]
    while other >= 0:
        following = labels.following[other]
        if beats(labels, at, other):
            dropped += 1
            # A label out of its list is marked by its error, so that a queue can pass it over.
            labels.error[other] = np.inf
            if before < 0:
                heads[slot] = following
            else:
                labels.following[before] = following
        else:
            before = other
        other = following
    labels.following[at] = heads[slot]
    heads[slot] = at
    return dropped
