"""Proven maxima of functions of a motion on every segment, by bisection with interval bounds."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .jets import Interval, Jet
from .motion import Extended, Motion
from .polynomials import bernstein_matrix, derived
from .trajectory import Trajectory

__all__ = ["GAP", "Peaks", "peaks"]

Floats = NDArray[np.float64]

#: Gap between the proven bound and the largest value, relative to the larger of value and scale.
GAP = 1e-9
#: Allowance for rounding in the bounds, relative to the same.
_ROUNDING = 1e-13
#: Highest derivative of the position: two more than the acceleration of a wheel or a body rate needs.
_ORDER = 5
#: Bisections of a segment. A function that is unbounded on a part of that width has no bound.
_DEPTH = 48
#: Largest number of parts per bisection.
_PARTS = 20_000


class Peaks(NamedTuple):
    """Maxima of a function of the motion on each segment.

    Parameters
    ----------
    bound : ndarray, shape (segments,)
        Proven upper bound of the function on the whole segment; infinite if it is unbounded.
    value : ndarray, shape (segments,)
        Largest value found, at most ``GAP`` below the bound unless `accept` ended the search.
    time : ndarray, shape (segments,)
        Instant of that value, s.
    """

    bound: Floats
    value: Floats
    time: Floats


@cache
def _middle(degree: int) -> Floats:
    """Return the weights of the control points for the value at the middle."""
    return np.array([math.comb(degree, i) for i in range(degree + 1)]) / 2.0**degree


@cache
def _halves(degree: int) -> tuple[Floats, Floats]:
    """Return the matrices from control points to those of the first and the second half."""
    first = np.zeros((degree + 1, degree + 1))
    for row in range(degree + 1):
        first[row, : row + 1] = _middle(row)
    return first, first[::-1, ::-1].copy()


def _derivatives(curve: Trajectory) -> list[Floats]:
    """Return the control points of each derivative in time, shape (segments, points, axes)."""
    result = []
    for order in range(_ORDER + 1):
        inner = derived(curve.coefficients, order) * (curve.durations**-order)[:, None, None]
        result.append(np.einsum("bp,kpd->kbd", bernstein_matrix(inner.shape[1] - 1), inner))
    return result


def _series(control: list[Floats]) -> tuple[list[Jet], list[Jet]]:
    """Return the series over parts of segments, and those at start, middle and end of the parts."""
    ranges: list[tuple[Floats, Floats]] = []
    points: list[Floats] = []
    for order, inner in enumerate(control):
        share = 1.0 / math.factorial(order)
        ranges.append((inner.min(axis=1) * share, inner.max(axis=1) * share))
        middle = np.einsum("b,rbc->rc", _middle(inner.shape[1] - 1), inner)
        points.append(np.stack([inner[:, 0], middle, inner[:, -1]], axis=1) * share)
    axes = range(control[0].shape[2])
    over = [Jet([Interval(low[:, j], high[:, j]) for low, high in ranges]) for j in axes]
    return over, [Jet([point[:, :, j] for point in points]) for j in axes]


def _bounds(over: Jet, at: Jet, half: Floats) -> Floats:
    """Return upper bounds of a function over parts, by its range, its slope and its curvature."""
    value, slope = at.terms[0], at.terms[1][:, 1]
    bend = over.terms[2].high
    vertex = np.where(bend < 0, np.clip(-slope / (2.0 * bend), -half, half), np.sign(slope) * half)
    taylor = value[:, 1] + slope * vertex + np.where(bend < 0, vertex**2, half**2) * bend
    one_sided = (over.terms[1].low >= 0) | (over.terms[1].high <= 0)
    ends = np.where(one_sided, np.maximum(value[:, 0], value[:, 2]), np.inf)
    bound: Floats = np.fmin(np.fmin(over.terms[0].high, taylor), ends)
    return np.where(np.isnan(bound), np.inf, bound)


@np.errstate(all="ignore")  # a division by 0 yields an infinite bound
def peaks(
    series: Extended,
    function: Callable[[Motion], Jet],
    *,
    scale: float = 0.0,
    accept: float = -math.inf,
) -> Peaks:
    """Return the proven maximum of a function of the motion on every segment.

    A part of a segment is bisected until one of three bounds is close to the largest known value: its
    range in interval arithmetic, its ends if the slope has one sign, or its second-order Taylor polynomial
    with the interval of the curvature.

    Parameters
    ----------
    series : Extended
        Motion on all segments.
    function : callable
        Function of a motion.
    scale : float
        Value relative to which the gap may be measured, beside the maximum itself.
    accept : float
        Value below which the maximum needs no further accuracy.

    Returns
    -------
    Peaks
        Bounds, values and instants.
    """
    curve = series.curve
    # Differences of the points of small parts would lose digits: every derivative has its own.
    control, segment = _derivatives(curve), np.arange(curve.segments)
    begin, share = np.zeros(curve.segments), 1.0
    bound = np.full(curve.segments, -np.inf)
    value, time = bound.copy(), curve.times[:-1].copy()
    for depth in range(_DEPTH + 1):
        long = curve.durations[segment] * share
        over, at = (function(series.motion(columns)) for columns in _series(control))
        found = np.where(np.isfinite(at.terms[0]), at.terms[0], -np.inf)
        best = found.argmax(axis=1)
        largest = found[np.arange(len(best)), best]
        order = np.argsort(largest, kind="stable")
        order = order[largest[order] > value[segment[order]]]
        # The last of repeated indices is stored, which is the largest.
        value[segment[order]] = largest[order]
        begin_time = (begin + 0.5 * share * best) * curve.durations[segment]
        time[segment[order]] = (curve.times[:-1][segment] + begin_time)[order]
        upper = _bounds(over, at, 0.5 * long)
        size = np.maximum(np.abs(value[segment]), scale)
        upper += _ROUNDING * size
        ready = upper <= np.maximum(value[segment] + GAP * size, accept)
        if depth == _DEPTH or 2 * int((~ready).sum()) > _PARTS:
            ready[:] = True
        np.maximum.at(bound, segment[ready], upper[ready])
        if ready.all():
            break
        rest = ~ready
        control = [
            np.concatenate([half @ inner[rest] for half in _halves(inner.shape[1] - 1)])
            for inner in control
        ]
        share *= 0.5
        begin = np.concatenate([begin[rest], begin[rest] + share])
        segment = np.tile(segment[rest], 2)
    return Peaks(bound, value, time)
