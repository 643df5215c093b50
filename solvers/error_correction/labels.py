"""Labels of a search in growing columns, with the points already visited as bit masks.

A label is a partial route: its last point, length, surviving error, parent label, and the *closed*
critical points. These are the critical points that it has visited and those that are on no path to B
below the ceiling. A label dominates another of the same point if it is no longer, has no more error and
its closed points are a subset of the other's. Proof: any path from the other label to B below the
ceiling uses only critical points that are open for both labels, and the dominating label follows it
with no more error and length. Without critical points the mask is empty and the rule ignores visits,
which is exact only if revisits are allowed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ..resource_routing.front_kernels import widened

__all__ = ["Labels", "add", "close", "dominated", "grown", "link", "make", "visited"]


class Labels(NamedTuple):
    """Columns of labels; only the first ones are in use.

    A label has the slot of its last point, its parent (-1 for none), the next label in the list of the
    slot (-1 at the end), its length (m) and surviving error, and the closed critical points, one bit
    each, shape (room, words).
    """

    slot: NDArray[np.int64]
    parent: NDArray[np.int64]
    following: NDArray[np.int64]
    length: NDArray[np.float64]
    error: NDArray[np.float64]
    visited: NDArray[np.uint64]


@kernel
def make(room: int, words: int) -> Labels:
    """Return columns for `room` labels."""
    return Labels(
        np.empty(room, np.int64),
        np.empty(room, np.int64),
        np.full(room, -1),
        np.empty(room),
        np.empty(room),
        np.zeros((room, words), np.uint64),
    )


@kernel
def grown(labels: Labels, room: int) -> Labels:
    """Return columns for `room` labels that start with `labels`."""
    return Labels(
        widened(labels.slot, room), widened(labels.parent, room), widened(labels.following, room),
        widened(labels.length, room), widened(labels.error, room), widened(labels.visited, room),
    )  # fmt: skip


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
    """Close the critical point with number `bit` for label `at`."""
    labels.visited[at, bit >> 6] |= np.uint64(1) << np.uint64(bit & 63)


@kernel
def visited(labels: Labels, label: int, bit: int) -> bool:
    """Return whether the critical point with number `bit` is closed for `label`."""
    if bit < 0:
        return False
    word: np.uint64 = labels.visited[label, bit >> 6]
    return bool((word >> np.uint64(bit & 63)) & np.uint64(1) != 0)


@kernel
def beats(labels: Labels, one: int, other: int) -> bool:
    """Return whether label `one` dominates label `other` of the same slot."""
    if labels.length[one] > labels.length[other] or labels.error[one] > labels.error[other]:
        return False
    for word in range(labels.visited.shape[1]):
        if labels.visited[one, word] & ~labels.visited[other, word] != np.uint64(0):
            return False
    return True


@kernel
def dominated(labels: Labels, first: int, at: int) -> bool:
    """Return whether a label in the list that starts with `first` dominates label `at`."""
    other = first
    while other >= 0:
        if beats(labels, other, at):
            return True
        other = labels.following[other]
    return False


@kernel
def link(labels: Labels, heads: NDArray[np.int64], at: int) -> int:
    """Insert label `at` into the list of its slot, drop dominated labels and return their number."""
    slot = labels.slot[at]
    dropped = 0
    before = -1
    other = heads[slot]
    while other >= 0:
        following = labels.following[other]
        if beats(labels, at, other):
            dropped += 1
            # An infinite error marks a dropped label, so that a queue can skip it.
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
