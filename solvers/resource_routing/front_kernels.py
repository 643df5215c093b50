"""Labels, and the fronts of extended labels that dominate others; see :mod:`.label_kernels`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = [
    "SPENT",
    "Fronts",
    "Labels",
    "dominated",
    "fronts_of",
    "grown",
    "inserted",
    "make",
    "trace",
    "widened",
]


#: Mark of labels on returned routes; they dominate no further label.
SPENT = -2


class Labels(NamedTuple):
    """Columns of labels; only the first ones are in use.

    `parent` is the previous label (-1 for none), `length` that of the partial route without its prizes, `level`,
    shape (room, r), the level of each resource on leaving, and `visited`, shape (room, words), one bit for each
    remembered critical point. `parked` is the last label that waits for a label that dominates it, -1 for none or
    ``SPENT``, and `before` the label parked before this one.
    """

    point: NDArray[np.int64]
    parent: NDArray[np.int64]
    length: NDArray[np.float64]
    level: NDArray[np.float64]
    visited: NDArray[np.uint64]
    parked: NDArray[np.int64]
    before: NDArray[np.int64]


class Fronts(NamedTuple):
    """Extended labels of each point, in the order of their lengths, in shared columns.

    `begin`, `size` and `room`, shape (n,), are the first entry of each point, its number of entries, and the
    entries that fit; `least`, shape (n, r), is the least level in the front, and `top` the number of entries
    given to points. The entries have columns for the label, copies of its length and levels, and, in `below`, the
    least first level of the entries of the point up to each one.
    """

    begin: NDArray[np.int64]
    size: NDArray[np.int64]
    room: NDArray[np.int64]
    least: NDArray[np.float64]
    top: NDArray[np.int64]
    label: NDArray[np.int64]
    length: NDArray[np.float64]
    level: NDArray[np.float64]
    below: NDArray[np.float64]


@kernel
def make(room: int, resources: int, words: int) -> Labels:
    """Return columns for `room` labels."""
    return Labels(
        np.empty(room, np.int64),
        np.empty(room, np.int64),
        np.empty(room),
        np.empty((room, resources)),
        np.zeros((room, words), np.uint64),
        np.full(room, -1),
        np.empty(room, np.int64),
    )


@kernel
def widened(array: NDArray[Any], room: int) -> NDArray[Any]:
    """Return an array of `room` rows that starts with those of `array`."""
    wider = np.empty((room,) + array.shape[1:], array.dtype)  # noqa: RUF005 (Numba)
    # Loops: an assignment of slices takes 4 s longer to compile.
    source, to = array.reshape(-1), wider.reshape(-1)
    for k in range(source.size):
        to[k] = source[k]
    return wider


@kernel
def grown(labels: Labels, room: int) -> Labels:
    """Return columns for `room` labels that start with `labels`."""
    return Labels(
        widened(labels.point, room), widened(labels.parent, room), widened(labels.length, room),
        widened(labels.level, room), widened(labels.visited, room), widened(labels.parked, room),
        widened(labels.before, room),
    )  # fmt: skip


@kernel
def trace(points: NDArray[np.int64], parents: NDArray[np.int64], label: int) -> NDArray[np.int64]:
    """Return the points of the labels from the first to `label`; empty for label -1."""
    count, at = 0, label
    while at >= 0:
        count, at = count + 1, parents[at]
    route, at = np.empty(count, np.int64), label
    while at >= 0:
        count -= 1
        route[count], at = points[at], parents[at]
    return route


@kernel
def fronts_of(count: int, resources: int) -> Fronts:
    """Return empty fronts of `count` points."""
    return Fronts(
        np.zeros(count, np.int64),
        np.zeros(count, np.int64),
        np.zeros(count, np.int64),
        np.full((count, resources), np.inf),
        np.zeros(1, np.int64),
        np.empty(4 * count + 64, np.int64),
        np.empty(4 * count + 64),
        np.empty((4 * count + 64, resources)),
        np.empty(4 * count + 64),
    )


@kernel
def moved(fronts: Fronts, wider: Fronts, begin: int, stop: int, to: int) -> None:
    """Copy the entries from `begin` to `stop` into `wider`."""
    for k in range(begin, stop):
        at = to + k - begin
        wider.label[at], wider.length[at] = fronts.label[k], fronts.length[k]
        wider.below[at] = fronts.below[k]
        for column in range(fronts.level.shape[1]):
            wider.level[at, column] = fronts.level[k, column]


@kernel
def inserted(fronts: Fronts, labels: Labels, at: int) -> Fronts:
    """Return the fronts with label `at`."""
    point, resources = labels.point[at], labels.level.shape[1]
    size = fronts.size[point]
    if size == fronts.room[point]:
        room, top = 4 + 2 * size, fronts.top[0]
        if top + room > len(fronts.label):
            entries = 2 * (top + room)
            wider = Fronts(
                fronts.begin, fronts.size, fronts.room, fronts.least, fronts.top,
                np.empty(entries, np.int64), np.empty(entries), np.empty((entries, resources)), np.empty(entries),
            )  # fmt: skip
            moved(fronts, wider, 0, top, 0)
            fronts = wider
        moved(fronts, fronts, fronts.begin[point], fronts.begin[point] + size, top)
        fronts.begin[point], fronts.room[point] = top, room
        fronts.top[0] = top + room
    begin = fronts.begin[point]
    k, first = begin + size, labels.level[at, 0] if resources > 0 else -np.inf
    while k > begin and fronts.length[k - 1] > labels.length[at]:
        moved(fronts, fronts, k - 1, k, k)
        fronts.below[k] = min(fronts.below[k], first)
        k -= 1
    fronts.label[k], fronts.length[k] = at, labels.length[at]
    fronts.below[k] = min(fronts.below[k - 1], first) if k > begin else first
    for column in range(resources):
        fronts.level[k, column] = labels.level[at, column]
        fronts.least[point, column] = min(fronts.least[point, column], labels.level[at, column])
    fronts.size[point] = size + 1
    return fronts


@kernel
def forgets(
    labels: Labels,
    one: int,
    other: int,
    via: NDArray[np.float64],
    shut: NDArray[np.float64],
    high: float,
    key: float,
) -> bool:
    """Return whether label `one` remembers only points that are closed for label `other`.

    `key` is the part of the bound of `other` without the way to the end.
    """
    for word in range(labels.visited.shape[1]):
        more = labels.visited[one, word] & ~labels.visited[other, word]
        bit = 64 * word
        while more != np.uint64(0):
            if more & np.uint64(1) != np.uint64(0):
                whole = key + via[labels.point[one], bit]
                if whole <= high and whole < np.inf:
                    closed = False
                    for k in range(labels.level.shape[1]):
                        closed = closed or labels.level[other, k] > shut[bit, k]
                    if not closed:
                        return False
            more = more >> np.uint64(1)
            bit += 1
    return True


@kernel
def dominated(
    fronts: Fronts,
    labels: Labels,
    at: int,
    via: NDArray[np.float64],
    shut: NDArray[np.float64],
    high: float,
    key: float,
    full: NDArray[np.float64],
) -> int:
    """Return a label that is not spent and dominates label `at` in the front of its point, -1 without one.

    `full` is the level of each resource above which no lower limit refuses it, -inf without lower limits.
    """
    point, resources = labels.point[at], labels.level.shape[1]
    for k in range(resources):
        if labels.level[at, k] < fronts.least[point, k]:
            return -1
    begin = fronts.begin[point]
    low, stop = begin, begin + fronts.size[point]
    while low < stop:
        middle = (low + stop) // 2
        if fronts.length[middle] <= labels.length[at]:
            low = middle + 1
        else:
            stop = middle
    for entry in range(low - 1, begin - 1, -1):
        if resources > 0 and fronts.below[entry] > labels.level[at, 0]:
            return -1
        rival = fronts.label[entry]
        beaten = labels.parked[rival] != SPENT
        for k in range(resources):
            one, other = fronts.level[entry, k], labels.level[at, k]
            if one > other or (one < other and one < full[k]):
                beaten = False
                break
        if beaten and forgets(labels, rival, at, via, shut, high, key):
            return int(rival)
    return -1
