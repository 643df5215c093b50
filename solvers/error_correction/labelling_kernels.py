"""The paper's stage 1: a Dijkstra search by length that keeps one label per point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .airspace import END, HORIZONTAL, VERTICAL, Airspace
from .outcomes import FOUND, NOTHING, STOPPED

__all__ = ["arrival", "label_points", "leg"]


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
    """Return the vertical and the horizontal error at the end of a leg.

    Parameters
    ----------
    space : Airspace
        The problem.
    kind : int
        Kind of the point at which the leg begins; it corrects one of the errors.
    vertical, horizontal : float
        Errors on arrival at that point.
    length : float
        Length of the leg (m).
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

    Parameters
    ----------
    space : Airspace
        The problem.
    factor : float
        The paper's λ: share of a correction point's threshold that the vertical error may use.
    flag : ndarray of int8, shape (1,)
        A nonzero entry stops the search.

    Returns
    -------
    status : int
        ``FOUND``, ``NOTHING`` or ``STOPPED``.
    route : ndarray of int64
        Points from A to B, empty if no route was found.
    length : float
        Length of the route (m), inf if no route was found.
    made : int
        Number of temporary labels written.
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
    count, at = 0, space.end
    while at >= 0:
        count, at = count + 1, father[at]
    route, at = np.empty(count, np.int64), space.end
    while at >= 0:
        count -= 1
        route[count], at = at, father[at]
    return FOUND, route, lengths[space.end], made
