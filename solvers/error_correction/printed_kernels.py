"""The paper's algorithms: stage 1, and the pulse algorithm and dynamic program with dominance.

Stage 1 is a Dijkstra search by length that keeps one label per point. The labels of the others hold the length
and both errors on arrival. A label dominates another label of the same point if its length and both of its errors are at most the
other's. A point keeps its non-dominated labels. The points of the routes are not compared, so a dropped
label may have an extension that is not simple for the dominating label.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import MOST_LABELS, kernel
from ..resource_routing.front_kernels import trace, widened
from ..resource_routing.outcomes import FOUND, FULL, NOTHING, STOPPED
from .airspace import END, HORIZONTAL, VERTICAL, Airspace

__all__ = ["correct_labels", "label_points", "send_pulses"]

Result = tuple[int, NDArray[np.int64], float, float, int, int]


@kernel
def leg(space: Airspace, tail: int, head: int) -> float:
    """Return the straight-line distance between two points, in metres."""
    square = 0.0
    for axis in range(3):
        difference = space.points[tail, axis] - space.points[head, axis]
        square += difference * difference
    return float(np.sqrt(square))


@kernel
def arrival(
    space: Airspace, kind: int, vertical: float, horizontal: float, length: float
) -> tuple[float, float]:
    """Return the vertical and the horizontal error at the end of a leg of `length` m.

    The leg begins at a point of `kind`, which corrects one of the errors on arrival there.
    """
    if kind == VERTICAL:
        vertical = 0.0
    elif kind == HORIZONTAL:
        horizontal = 0.0
    return vertical + space.rates[0] * length, horizontal + space.rates[1] * length


@kernel(interpretable=True)
def label_points(
    space: Airspace, factor: float, flag: NDArray[np.int8]
) -> tuple[int, NDArray[np.int64], float, int]:
    """Return the route of the paper's stage 1, section 3.1, steps 1 to 4.

    `factor` is the paper's λ: the share of a correction point's threshold that the vertical error may
    use. The result is the status, ``FOUND``, ``NOTHING`` or ``STOPPED`` by `flag`; points from A to B
    and length (m), empty and inf without a route; and the number of temporary labels written.
    """
    n = len(space.points)
    lengths, father = np.full(n, np.inf), np.full(n, -1)
    vertical, horizontal = np.zeros(n), np.zeros(n)
    permanent = np.zeros(n, np.bool_)
    nothing = np.empty(0, np.int64)
    lengths[space.start] = 0.0
    made = 1
    while True:
        here = -1
        for i in range(n):
            if not permanent[i] and lengths[i] < (np.inf if here < 0 else lengths[here]):
                here = i
        if here < 0 or flag[0] != 0:
            return NOTHING if here < 0 else STOPPED, nothing, np.inf, made
        permanent[here] = True
        if here == space.end:
            break
        for j in range(n):
            if permanent[j]:
                continue
            d = leg(space, here, j)
            total, kind = lengths[here] + d, space.kinds[j]
            # As printed: an equal length replaces a label, except that of B.
            if total > lengths[j] or (kind == END and total == lengths[j]):
                continue
            v, h = arrival(space, space.kinds[here], vertical[here], horizontal[here], d)
            share = 1.0 if kind == END else factor
            if v <= share * space.limits[kind, 0] and h <= space.limits[kind, 1]:
                lengths[j], vertical[j], horizontal[j], father[j] = total, v, h, here
                made += 1
    return FOUND, trace(np.arange(n), father, space.end), lengths[space.end], made


class Tags(NamedTuple):
    """Labels in columns; only the first ones are in use.

    A label has its point, the label that it extends (-1 at A), the next label of the same point (-1 at
    the end), its length (m) and the errors on arrival.
    """

    point: NDArray[np.int64]
    father: NDArray[np.int64]
    following: NDArray[np.int64]
    length: NDArray[np.float64]
    vertical: NDArray[np.float64]
    horizontal: NDArray[np.float64]


@kernel
def first_tags(start: int, room: int) -> Tags:
    """Return columns for `room` labels that hold the label of A."""
    tags = Tags(
        np.empty(room, np.int64), np.empty(room, np.int64), np.empty(room, np.int64),
        np.empty(room), np.empty(room), np.empty(room),
    )  # fmt: skip
    tags.point[0], tags.father[0], tags.following[0] = start, -1, -1
    tags.length[0] = tags.vertical[0] = tags.horizontal[0] = 0.0
    return tags


@kernel
def is_dominated(tags: Tags, first: int, length: float, vertical: float, horizontal: float) -> bool:
    """Return whether a label of the list that begins with `first` dominates these values."""
    label = first
    while label >= 0:
        if (
            tags.length[label] <= length
            and tags.vertical[label] <= vertical
            and tags.horizontal[label] <= horizontal
        ):
            return True
        label = tags.following[label]
    return False


@kernel
def keep(
    tags: Tags, heads: NDArray[np.int64], used: int, point: int, father: int,
    length: float, vertical: float, horizontal: float,
) -> Tags:  # fmt: skip
    """Write label `used` and unlink the labels of its point that it dominates; return wider columns if full."""
    if used == len(tags.point):
        room = 2 * used
        tags = Tags(
            widened(tags.point, room), widened(tags.father, room), widened(tags.following, room),
            widened(tags.length, room), widened(tags.vertical, room), widened(tags.horizontal, room),
        )  # fmt: skip
    before, label = -1, heads[point]
    while label >= 0:
        following = tags.following[label]
        if (
            length <= tags.length[label]
            and vertical <= tags.vertical[label]
            and horizontal <= tags.horizontal[label]
        ):
            if before < 0:
                heads[point] = following
            else:
                tags.following[before] = following
        else:
            before = label
        label = following
    tags.point[used], tags.father[used], tags.following[used] = point, father, heads[point]
    tags.length[used], tags.vertical[used], tags.horizontal[used] = length, vertical, horizontal
    heads[point] = used
    return tags


@kernel
def mark_route(tags: Tags, label: int, marks: NDArray[np.bool_], value: bool) -> None:
    """Set the marks of the points on the route of `label` to `value`."""
    while label >= 0:
        marks[tags.point[label]] = value
        label = tags.father[label]


@kernel(interpretable=True)
def send_pulses(space: Airspace, bound: float, flag: NDArray[np.int8]) -> Result:
    """Return the best route shorter than `bound` that the paper's pulse algorithm finds.

    Section 3.2: a depth-first search from A, points in the order of the list. A pulse ends at a point of
    its own route, by the feasibility check, by the bound check (its length and the straight line to B
    reach the best length), or by the dominance check.

    `bound` is the paper's primal_bound at the start (m); inf if no route is known. The result is the
    status, ``FOUND``, ``NOTHING``, ``STOPPED`` by `flag` or ``FULL``; points from A to B and length (m),
    empty and inf without a route; the straight line from A to B, a lower bound on it; and the numbers of
    labels made and extended.
    """
    n, best, route = len(space.points), bound, np.empty(0, np.int64)
    tags, heads = first_tags(space.start, 1024), np.full(n, -1)
    used, extended, depth = 1, 1, 0
    # The labels of the current route, and the point to try next at each of them.
    way, turn = np.zeros(n, np.int64), np.zeros(n, np.int64)
    visited = np.zeros(n, np.bool_)
    visited[space.start] = True
    status = FOUND
    while depth >= 0:
        label = way[depth]
        here, j = tags.point[label], turn[depth]
        if j == 0 and (flag[0] != 0 or used > MOST_LABELS):
            status = STOPPED if flag[0] != 0 else FULL
            break
        if j == n:
            visited[here] = False
            depth -= 1
            continue
        turn[depth] += 1
        if visited[j]:
            continue
        d = leg(space, here, j)
        v, h = arrival(space, space.kinds[here], tags.vertical[label], tags.horizontal[label], d)
        if v > space.limits[space.kinds[j], 0] or h > space.limits[space.kinds[j], 1]:
            continue
        total = tags.length[label] + d
        if total + leg(space, j, space.end) >= best:
            continue
        if j == space.end:
            best, route = total, np.append(trace(tags.point, tags.father, label), j)
            continue
        if is_dominated(tags, heads[j], total, v, h):
            continue
        tags = keep(tags, heads, used, j, label, total, v, h)
        depth += 1
        way[depth], turn[depth], visited[j] = used, 0, True
        used, extended = used + 1, extended + 1
    if status == FOUND and route.size == 0:
        status = NOTHING
    length = best if route.size > 0 else np.inf
    return status, route, length, leg(space, space.start, space.end), used, extended


@kernel(interpretable=True)
def correct_labels(space: Airspace, cutoff: float, flag: NDArray[np.int8]) -> Result:
    """Return the route of the paper's dynamic program, DP Algorithm of section 4, as :func:`send_pulses`.

    The set E is a queue. Every label of the selected point is extended to every point that is not on its
    route, and a point enters E if its labels have changed. Labels longer than `cutoff` (m; inf as
    printed) are dropped.
    """
    n = len(space.points)
    tags, heads = first_tags(space.start, 1024), np.full(n, -1)
    heads[space.start] = 0
    queue, waiting = np.empty(n, np.int64), np.zeros(n, np.bool_)
    queue[0], waiting[space.start] = space.start, True
    head, size, used, extended = 0, 1, 1, 0
    visited = np.zeros(n, np.bool_)
    status = FOUND
    while size > 0 and status == FOUND:
        here = queue[head]
        head, size, waiting[here] = (head + 1) % n, size - 1, False
        # The list does not change meanwhile: the point is on the route of each of its labels.
        label = heads[here] if here != space.end else -1
        while label >= 0:
            if flag[0] != 0 or used > MOST_LABELS:
                status = STOPPED if flag[0] != 0 else FULL
                break
            extended += 1
            mark_route(tags, label, visited, True)
            for j in range(n):
                if visited[j]:
                    continue
                d = leg(space, here, j)
                kind, total = space.kinds[here], tags.length[label] + d
                v, h = arrival(space, kind, tags.vertical[label], tags.horizontal[label], d)
                if v > space.limits[space.kinds[j], 0] or h > space.limits[space.kinds[j], 1]:
                    continue
                if total > cutoff or is_dominated(tags, heads[j], total, v, h):
                    continue
                tags = keep(tags, heads, used, j, label, total, v, h)
                used += 1
                if not waiting[j]:
                    queue[(head + size) % n], waiting[j] = j, True
                    size += 1
            mark_route(tags, label, visited, False)
            label = tags.following[label]
    best, label = -1, heads[space.end]
    while label >= 0:
        if best < 0 or tags.length[label] < tags.length[best]:
            best = label
        label = tags.following[label]
    if status == FOUND and best < 0:
        status = NOTHING
    length = tags.length[best] if best >= 0 else np.inf
    route, line = trace(tags.point, tags.father, best), leg(space, space.start, space.end)
    return status, route, length, line, used, extended
