"""Where polynomials leave their bounds: the local extremes outside, by safeguarded Newton steps."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..error_correction.jit import kernel

__all__ = ["GRID", "outside"]

Floats = NDArray[np.float64]

#: Intervals of [0, 1] that are searched for a change of sign of the slope.
GRID = 32


@kernel
def outside(
    powers: Floats, lower: Floats, upper: Floats, threshold: float
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Return the local extremes beyond a bound.

    Parameters
    ----------
    powers : ndarray, shape (N, degree + 1)
        Ascending powers of s in [0, 1].
    lower, upper : ndarray, shape (N,)
        Bounds; infinite where there is none.
    threshold : float
        Smallest violation reported, relative to ``max(1, |bound|)``.

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
    for row in range(count):
        low_scale = max(1.0, abs(lower[row])) if lower[row] > -np.inf else 1.0
        high_scale = max(1.0, abs(upper[row])) if upper[row] < np.inf else 1.0
        before = 0.0
        for node in range(GRID + 1):
            s = node / GRID
            value, slope = 0.0, 0.0
            for j in range(degree, -1, -1):
                slope = slope * s + value
                value = value * s + powers[row, j]
            candidate = s
            use = node == 0 or node == GRID
            if node > 0 and before * slope < 0.0:
                left, right, sign = (node - 1) / GRID, s, before
                x = 0.5 * (left + right)
                for _ in range(60):
                    v, d, c = 0.0, 0.0, 0.0
                    for j in range(degree, -1, -1):
                        c = c * x + d
                        d = d * x + v
                        v = v * x + powers[row, j]
                    if d * sign > 0:
                        left = x
                    else:
                        right = x
                    after = x - d / (2.0 * c) if c != 0.0 else 0.5 * (left + right)
                    if not left < after < right:
                        after = 0.5 * (left + right)
                    if abs(after - x) <= 1e-15:
                        break
                    x = after
                for end in range(2):
                    if end == 1 and not use:
                        break
                    place = x if end == 0 else candidate
                    v = 0.0
                    for j in range(degree, -1, -1):
                        v = v * place + powers[row, j]
                    share = max((lower[row] - v) / low_scale, (v - upper[row]) / high_scale)
                    if share > threshold:
                        if found == room:
                            room *= 2
                            rows = _grown(rows, room)
                            places = _grown(places, room)
                            shares = _grown(shares, room)
                        rows[found], places[found], shares[found] = row, place, share
                        found += 1
            elif use:
                share = max((lower[row] - value) / low_scale, (value - upper[row]) / high_scale)
                if share > threshold:
                    if found == room:
                        room *= 2
                        rows = _grown(rows, room)
                        places = _grown(places, room)
                        shares = _grown(shares, room)
                    rows[found], places[found], shares[found] = row, s, share
                    found += 1
            before = slope
    return rows[:found], places[:found], shares[:found]


@kernel
def _grown(array: Any, room: int) -> Any:
    larger = np.empty(room, array.dtype)
    larger[: array.size] = array
    return larger
