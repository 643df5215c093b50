"""Durations by rule of thumb, and what turns any durations into some that the bounds allow.

Source of the trapezoid: Richter, Bry and Roy 2013 and common practice: from rest to rest along each
segment at a limited acceleration and velocity.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...models.minimum_snap.time_allocation import TimeAllocation
from .time_barrier import Barrier, Inner
from .time_descent import SLOWER, allocate
from .time_inner import Spline

__all__ = ["distance", "fitted", "hurried", "resumed", "scaled", "started", "trapezoid", "typical"]

Floats = NDArray[np.float64]

#: Share of the mean length below which a segment's length counts as that.
LEAST = 1e-2
#: Relative complementarity at which a barrier problem shows whether there is a way inside.
ROUGH = 1e-1
#: Prices of a second that make a path hurry, relative to what it costs.
DEAR = (1e2, 1e4, 1e6)
#: Largest violation, relative, that a start may have between the instants.
BETWEEN = 1e-4


def _lengths(model: TimeAllocation) -> Floats:
    """Return how far each axis goes on each segment, shape (M, dimensions); gaps interpolated."""
    points = np.array(model.waypoints)
    index = np.arange(len(points))
    for axis in range(points.shape[1]):
        known = np.isfinite(points[:, axis])
        if known.any():
            points[:, axis] = np.interp(index, index[known], points[known, axis])
        else:
            points[:, axis] = 0.0
    return np.abs(np.diff(points, axis=0))


def _floored(lengths: Floats) -> Floats:
    mean = float(lengths.mean())
    return np.maximum(lengths, LEAST * mean if mean > 0 else 1.0)


def distance(model: TimeAllocation) -> Floats:
    """Return durations (s) proportional to the distance between waypoints, at 1 m/s."""
    return _floored(np.linalg.norm(_lengths(model), axis=1))


def trapezoid(model: TimeAllocation) -> Floats:
    """Return durations (s) of a trapezoidal velocity profile on each segment, from rest to rest.

    Each axis accelerates to its limits; the slowest axis counts. Without limits, the cruising
    velocity is the mean length of a segment a second, reached within half a second.
    """
    along = _floored(np.linalg.norm(_lengths(model), axis=1))[:, None]
    lengths = np.concatenate([_lengths(model), along], axis=1)
    limits = {b.derivative: b.upper for b in model.bounds if b.derivative in (1, 2)}
    cruise = np.full(lengths.shape, np.inf)
    pull = np.full(lengths.shape, np.inf)
    for derivative, table in ((1, cruise), (2, pull)):
        if derivative in limits:
            table[:, :-1] = np.where(limits[derivative] > 0, limits[derivative], np.inf)
            # Along the path, the least of the axes: a segment that hardly moves has a length too.
            table[:, -1] = table[:, :-1].min(axis=1) * np.sqrt(lengths.shape[1] - 1.0)
    typical = float(along.mean())
    nothing = ~np.isfinite(cruise) & ~np.isfinite(pull)
    cruise = np.where(nothing, typical, cruise)
    pull = np.where(np.isfinite(pull), pull, 2.0 * np.where(np.isfinite(cruise), cruise, typical))
    with np.errstate(invalid="ignore", over="ignore"):
        reaches = lengths >= cruise**2 / pull
        long = np.where(reaches, lengths / cruise + cruise / pull, 2.0 * np.sqrt(lengths / pull))
    durations: Floats = long.max(axis=1)
    return durations


def scaled(model: TimeAllocation, inner: Inner, durations: Floats) -> Floats:
    """Return `durations` times the factor that is best for J + ρ ΣT, bounds left aside.

    From rest to rest J falls as ``s^(1-2r)``, so that ``s^2r = (2r - 1) J / (ρ ΣT)``; for a sum of
    orders, or with an end in motion, a search along s finds a local optimum.
    """
    if model.total_time is not None:
        given: Floats = durations * (model.total_time / durations.sum())
        return given
    weights = model.order_weights
    if model.from_rest_to_rest and not weights[:-1].any():
        cost = inner.value(durations).objective
        power = 2 * model.order
        if cost > 0.0 and np.isfinite(cost):
            share = (power - 1) * cost / (model.time_weight * durations.sum())
            best: Floats = durations * share ** (1.0 / power)
            return best
        return durations
    return allocate(
        model, inner, durations, tolerance=1e-8, most=60, between=BETWEEN, proportional=True
    ).durations


def _peaks(model: TimeAllocation, spline: Spline, durations: Floats) -> float:
    """Return the factor by which the unbounded path must be stretched to keep the limits."""
    plan = spline.plan(durations)
    if plan is None:
        return 1.0
    factor = 0.0
    for bound in model.bounds:
        if bound.derivative:
            found = plan.extremes(bound.derivative)
            size = np.maximum(np.abs(found.least), np.abs(found.largest))
            share = float((size / np.where(bound.upper > 0, bound.upper, np.inf)).max())
            factor = max(factor, share ** (1.0 / bound.derivative))
    return factor


def _factors(model: TimeAllocation) -> Iterator[float]:
    """Yield stretches to try: only longer ones where a slower motion keeps all limits."""
    yield 1.0
    if model.total_time is not None:
        return
    for k in range(1, 25):
        yield 2.0 ** (k / 4)
        if not model.from_rest_to_rest:
            yield 2.0 ** (-k / 4)


def fitted(model: TimeAllocation, inner: Barrier, durations: Floats) -> Floats | None:
    """Return `durations` stretched so that there is a path within the bounds, None if none is found.

    From rest to rest, a slower motion keeps all limits; with an end in motion it may not, as there
    a longer path may have to leave the corridor, and shorter durations are tried as well.
    """
    spline = Spline(model)
    if model.from_rest_to_rest and model.total_time is None:
        durations = durations * max(1.0, 1.02 * _peaks(model, spline, durations))
    for factor in _factors(model):
        now = durations * factor
        typical(model, inner, spline, now)
        if np.isfinite(inner.settle(now, BETWEEN).value):
            return now
        if inner.flag[0]:
            break
    return None


def resumed(model: TimeAllocation, inner: Barrier, durations: Floats) -> Floats | None:
    """Return `durations` that are known to have a path, or a little slower ones, as :func:`fitted`."""
    slower = SLOWER if model.from_rest_to_rest and model.total_time is None else ()
    spline = Spline(model)
    for share in (0.0, *slower):
        now: Floats = durations * np.exp(share)
        typical(model, inner, spline, now)
        if np.isfinite(inner.settle(now, BETWEEN).value):
            return now
        if inner.flag[0]:
            return None
    return fitted(model, inner, durations)


def typical(model: TimeAllocation, inner: Barrier, spline: Spline, durations: Floats) -> None:
    """Set the barrier by what the path costs without bounds."""
    cost = spline.value(durations).objective
    price = model.time_weight * float(durations.sum())
    if not np.isfinite(cost) or cost <= 0.0:
        cost = price if price > 0 else 1.0
    inner.unit = max(cost, 1e-6 * price)
    inner.mu = ROUGH * (inner.unit + price) / inner.pairs


def started(model: TimeAllocation, inner: Inner, durations: Floats) -> Floats | None:
    """Return `durations` scaled for J + ρ ΣT and, where there are bounds, stretched to fit them."""
    if isinstance(inner, Spline):
        return scaled(model, inner, durations)
    return fitted(model, inner, scaled(model, Spline(model), durations))


def hurried(model: TimeAllocation, inner: Barrier, durations: Floats) -> Floats | None:
    """Return durations of the given total that leave a path within the bounds, None if none is found.

    From rest to rest whatever takes less time may be slowed down: so the total is left free and made
    dear, until it is short enough.
    """
    total = model.total_time
    if total is None or not model.from_rest_to_rest:
        return None
    spline = Spline(model)
    free = replace(model, total_time=None, time_weight=1.0)
    begin = fitted(free, inner, durations)
    if begin is None:
        return None
    cost = spline.value(begin).objective
    price = cost / float(begin.sum()) if np.isfinite(cost) and cost > 0 else 1.0
    found: list[Floats] = []

    def heard(now: Floats, value: float) -> None:
        if float(now.sum()) <= total:
            found.append(now)

    for dear in DEAR:
        begin = allocate(
            replace(free, time_weight=dear * price), inner, begin, tolerance=1e-4, most=300,
            between=1e-6, heard=heard, stopped=lambda: bool(found) or bool(inner.flag[0]),
        ).durations  # fmt: skip
        if found or inner.flag[0]:
            break
    if not found:
        return None
    now = found[-1] * (total / float(found[-1].sum()))
    typical(model, inner, spline, now)
    return now if np.isfinite(inner.settle(now, BETWEEN).value) else None
