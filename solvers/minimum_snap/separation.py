"""Where polynomials leave their bounds: the local extremes outside, by safeguarded Newton steps."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.minimum_snap.polynomials import bernstein_matrix, critical_points, horner
from ..jit import kernel

__all__ = ["GRID", "outside", "roots_outside"]

Floats = NDArray[np.float64]

#: Intervals of [0, 1] that are searched for a change of sign of the slope.
GRID = 32


@kernel
def outside(
    powers: Floats,
    lower: Floats,
    upper: Floats,
    low_scale: Floats,
    high_scale: Floats,
    threshold: float,
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Return the local extremes beyond a bound.

    Parameters
    ----------
    powers : ndarray, shape (N, degree + 1)
        Ascending powers of s in [0, 1].
    lower, upper : ndarray, shape (N,)
        Bounds; infinite where there is none.
    low_scale, high_scale : ndarray, shape (N,)
        What violations are held against.
    threshold : float
        Smallest violation reported, relative to those.

    Returns
    -------
    tuple
        Row, argument and relative violation of each.
    """
    count, size = powers.shape
    degree = size - 1
    room = max(count, 16)
    rows = np.empty(room, np.int64)
    places = np.empty(room)
    shares = np.empty(room)
    found = 0
    nodes = np.empty(GRID + 1)  # the violation at each node
    inside = np.zeros(GRID + 1, np.bool_)  # whether the cell before it has an extreme
    spots = np.empty(2)
    for row in range(count):
        before = 0.0
        for node in range(GRID + 1):
            s = node / GRID
            value, slope = 0.0, 0.0
            for j in range(degree, -1, -1):
                slope = slope * s + value
                value = value * s + powers[row, j]
            nodes[node] = _share(value, row, lower, upper, low_scale, high_scale)
            inside[node] = False
            if node > 0 and before * slope < 0.0:
                left = (node - 1) / GRID
                x, bend = _extreme(powers[row], left, s, before)
                count_here = 1
                if bend * before > 0.0:
                    # The wrong kind of extreme lies between two of the right kind.
                    nudge = 1e-7 / GRID
                    spots[0], _ = _extreme(powers[row], left, x - nudge, before)
                    spots[1], _ = _extreme(powers[row], x + nudge, s, before)
                    count_here = 2
                else:
                    spots[0] = x
                for spot in range(count_here):
                    x = spots[spot]
                    v = 0.0
                    for j in range(degree, -1, -1):
                        v = v * x + powers[row, j]
                    share = _share(v, row, lower, upper, low_scale, high_scale)
                    if share > threshold:
                        inside[node] = True
                        if found == room:
                            room *= 2
                            rows = _grown(rows, room)
                            places = _grown(places, room)
                            shares = _grown(shares, room)
                        rows[found], places[found], shares[found] = row, x, share
                        found += 1
            if slope != 0.0:
                before = slope
        # A node above its neighbours speaks for extremes that no change of sign has shown: the
        # ends, a slope of exactly 0, several extremes in one cell.
        for node in range(GRID + 1):
            if nodes[node] <= threshold or inside[node] or (node < GRID and inside[node + 1]):
                continue
            if (node > 0 and nodes[node - 1] > nodes[node]) or (
                node < GRID and nodes[node + 1] > nodes[node]
            ):
                continue
            if found == room:
                room *= 2
                rows = _grown(rows, room)
                places = _grown(places, room)
                shares = _grown(shares, room)
            rows[found], places[found], shares[found] = row, node / GRID, nodes[node]
            found += 1
    return rows[:found], places[:found], shares[:found]


@kernel
def _extreme(powers: Floats, left: float, right: float, before: float) -> tuple[float, float]:
    """Return a root of the slope, whose sign at `left` is that of `before`, and the curvature."""
    x, bend = 0.5 * (left + right), 0.0
    for _ in range(60):
        v, d, c = 0.0, 0.0, 0.0
        for j in range(powers.size - 1, -1, -1):
            c = c * x + d
            d = d * x + v
            v = v * x + powers[j]
        bend = c
        if d * before > 0:
            left = x
        else:
            right = x
        after = x - d / (2.0 * c) if c != 0.0 else 0.5 * (left + right)
        if not left < after < right:
            after = 0.5 * (left + right)
        if abs(after - x) <= 1e-15:
            break
        x = after
    return x, bend


@kernel
def _share(
    value: float, row: int, lower: Floats, upper: Floats, low_scale: Floats, high_scale: Floats
) -> float:
    """Return by how much a value lies outside, relatively; negative inside."""
    below: float = (lower[row] - value) / low_scale[row]
    above: float = (value - upper[row]) / high_scale[row]
    return max(below, above)


@kernel
def _grown(array: Any, room: int) -> Any:
    larger = np.empty(room, array.dtype)
    larger[: array.size] = array
    return larger


def roots_outside(
    powers: Floats,
    lower: Floats,
    upper: Floats,
    low_scale: Floats,
    high_scale: Floats,
    threshold: float,
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Return what :func:`outside` does, from the roots of the slopes: it misses none, and is slower."""
    control = powers @ bernstein_matrix(powers.shape[1] - 1).T
    # The control polygon encloses the curve: only where it sticks out can there be any.
    near = np.flatnonzero((control.min(axis=1) < lower) | (control.max(axis=1) > upper))
    places = critical_points(powers[near])
    value = horner(powers[near][:, :, None], places)
    share = np.maximum(
        (lower[near, None] - value) / low_scale[near, None],
        (value - upper[near, None]) / high_scale[near, None],
    )
    row, column = np.nonzero(share > threshold)
    return near[row].astype(np.int64), places[row, column], share[row, column]
