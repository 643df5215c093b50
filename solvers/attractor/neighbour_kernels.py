"""Loops over neighbouring states, in the order of their first coordinate.

The distance of two states is at least the difference of their first coordinates, in floating point, too.
A search therefore walks from a state in both directions until this difference is too large. It needs no
tree, skips states that are near in time, and gives exactly the result of a search over all pairs.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel, tick

__all__ = ["count_pairs", "mean_partings", "nearest_states", "order_states"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def order_states(states: Floats) -> tuple[Floats, Ints, Ints]:
    """Return states in the order of their first coordinate, their times, and the row of each time."""
    times = np.argsort(states[:, 0], kind="stable")
    rows = np.empty_like(times)
    rows[times] = np.arange(len(times))
    return np.ascontiguousarray(states[times]), times, rows


@kernel(interpretable=True)
def nearest_states(
    states: Floats, times: Ints, places: Ints, theiler: int, count: int, largest: bool
) -> tuple[Ints, Floats, int]:
    """Return the times of the `count` nearest neighbours of some states, their distances, and the visited pairs.

    `states`, shape (m, d), are ordered by the first coordinate, with their `times` in samples; `places` are
    the rows of the r states whose neighbours are searched. States at most `theiler` samples apart are not
    neighbours. Of equal distances the earlier state is first. The distance is the `largest` difference of a
    coordinate, or else the square of the Euclidean distance; then equal states are not neighbours. The
    results have the shape (r, count), the nearest first. If there are too few, times are -1 and distances
    infinite.
    """
    m, d = states.shape
    which, nearest = np.full((len(places), count), -1), np.full((len(places), count), np.inf)
    visits, last = 0, count - 1
    for row in range(len(places)):
        tick()
        place, near, who = places[row], nearest[row], which[row]
        left, right, backward = place - 1, place + 1, True
        while left >= 0 or right < m:
            backward = not backward
            if (backward and left < 0) or (not backward and right >= m):
                continue
            if backward:
                other = left
                left -= 1
            else:
                other = right
                right += 1
            visits += 1
            far = abs(states[other, 0] - states[place, 0])
            if not largest:
                far *= far
            if far > near[last]:
                if backward:
                    left = -1
                else:
                    right = m
                continue
            if abs(times[other] - times[place]) <= theiler:
                continue
            for column in range(1, d):
                apart = abs(states[other, column] - states[place, column])
                far = max(far, apart) if largest else far + apart * apart
                if far > near[last]:
                    break
            time = times[other]
            if far > near[last] or (far == 0.0 and not largest):
                continue
            if far == near[last] and who[last] >= 0 and time > who[last]:
                continue
            k = last
            while k > 0 and (near[k - 1] > far or (near[k - 1] == far and who[k - 1] > time)):
                near[k], who[k] = near[k - 1], who[k - 1]
                k -= 1
            near[k], who[k] = far, time
    return which, nearest, visits


@kernel(interpretable=True)
def mean_partings(
    states: Floats,
    ordered: Floats,
    times: Ints,
    places: Ints,
    theiler: int,
    square_radius: float,
    ahead: int,
) -> tuple[Floats, Ints, int]:
    """Return the sums of the logarithms of the mean distances from all neighbours over time.

    `states` are in the order of time; `ordered`, `times`, `places` and `theiler` are those of
    :func:`nearest_states`. Neighbours are at most the root of `square_radius` apart. The sums have the
    shape (ahead + 1,); the numbers of summed states and the total number of neighbours follow. Distances of
    0 are not summed.
    """
    m, d = ordered.shape
    sums, counts, neighbours = np.zeros(ahead + 1), np.zeros(ahead + 1, np.int64), 0
    total = np.empty(ahead + 1)
    for row in range(len(places)):
        tick()
        place = places[row]
        i = times[place]
        total[:] = 0.0
        result = 0
        for side in range(-1, 2, 2):
            other = place + side
            while 0 <= other < m:
                apart = ordered[other, 0] - ordered[place, 0]
                square = apart * apart
                if square > square_radius:
                    break
                j = times[other]
                other += side
                if abs(j - i) <= theiler:
                    continue
                square = 0.0
                for column in range(d):
                    apart = states[j, column] - states[i, column]
                    square += apart * apart
                    if square > square_radius:
                        break
                if square == 0.0 or square > square_radius:
                    continue
                result += 1
                for k in range(ahead + 1):
                    square = 0.0
                    for column in range(d):
                        apart = states[i + k, column] - states[j + k, column]
                        square += apart * apart
                    total[k] += math.sqrt(square)
        for k in range(ahead + 1):
            if result > 0 and total[k] > 0.0:
                sums[k] += math.log(total[k] / result)
                counts[k] += 1
        neighbours += result
    return sums, counts, neighbours


@kernel(interpretable=True)
def count_pairs(
    states: Floats, times: Ints, places: Ints, theiler: int, radii: Floats
) -> tuple[Ints, int]:
    """Return the numbers of states in the shells between ascending radii around some states, by the ∞-norm.

    The other arguments are those of :func:`nearest_states`, but equal states are counted. The number of
    visited pairs is returned, too.
    """
    m, d = states.shape
    last = len(radii) - 1
    most = radii[last]
    result, visits = np.zeros(last + 1, np.int64), 0
    for row in range(len(places)):
        tick()
        place = places[row]
        for side in range(-1, 2, 2):
            other = place + side
            while 0 <= other < m:
                visits += 1
                far = abs(states[other, 0] - states[place, 0])
                if far > most:
                    break
                for column in range(1, d):
                    apart = abs(states[other, column] - states[place, column])
                    if apart > far:
                        far = apart
                        if far > most:
                            break
                if far <= most and abs(times[other] - times[place]) > theiler:
                    k = last
                    while k > 0 and far <= radii[k - 1]:
                        k -= 1
                    result[k] += 1
                other += side
    return result, visits
