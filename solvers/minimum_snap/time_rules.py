"""Heuristic durations, methods that modify durations until the bounds allow a path, and free knots.

Source of the trapezoid: Richter, Bry and Roy 2013 and common practice. Each segment is a motion from
rest to rest with limited acceleration and velocity.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.minimum_snap.time_allocation import TimeAllocation
from .minco_backend import first_points
from .time_barrier import Barrier, Inner, Spline
from .time_descent import SLOWER, allocate

__all__ = [
    "distance",
    "prepare_start",
    "restore_path",
    "scale_durations",
    "set_barrier",
    "shorten_total",
    "stretch_durations",
    "trapezoid",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Largest number of free knots that are added one by one. With more, the number doubles.
SINGLY = 20
#: Minimum length of a segment, as a share of the mean length.
LEAST = 1e-2
#: Relative complementarity of the barrier problem that tests for a feasible path.
ROUGH = 1e-1
#: Costs per second that shorten the total time, relative to the cost of the path.
DEAR = (1e2, 1e4, 1e6)
#: Largest relative violation of a start between the instants.
BETWEEN = 1e-4


def _lengths(model: TimeAllocation) -> Floats:
    """Return the distance per segment and axis, m, shape (M, dimensions), with gaps interpolated."""
    return np.abs(np.diff(first_points(model), axis=0))


def _floored(lengths: Floats) -> Floats:
    mean = float(lengths.mean())
    return np.maximum(lengths, LEAST * mean if mean > 0 else 1.0)


def distance(model: TimeAllocation) -> Floats:
    """Return durations (s) proportional to the distance between waypoints, at 1 m/s."""
    return _floored(np.linalg.norm(_lengths(model), axis=1))


def trapezoid(model: TimeAllocation) -> Floats:
    """Return durations (s) of a trapezoidal velocity profile on each segment, from rest to rest.

    Each axis uses its limits, and the slowest axis determines the duration. Without limits, the
    cruising velocity is the mean length of a segment per second, reached within half a second.
    """
    along = _floored(np.linalg.norm(_lengths(model), axis=1))[:, None]
    lengths = np.concatenate([_lengths(model), along], axis=1)
    limits = {b.derivative: b.upper for b in model.bounds if b.derivative in (1, 2)}
    cruise = np.full(lengths.shape, np.inf)
    pull = np.full(lengths.shape, np.inf)
    for derivative, table in ((1, cruise), (2, pull)):
        if derivative in limits:
            table[:, :-1] = np.where(limits[derivative] > 0, limits[derivative], np.inf)
            # Limit along the path: the minimum of the axes. Segments with little motion need it.
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


def scale_durations(model: TimeAllocation, inner: Inner, durations: Floats) -> Floats:
    """Return `durations` times the optimal factor for J + ρ ΣT without bounds.

    From rest to rest J is proportional to ``s^(1-2r)``, so that ``s^2r = (2r - 1) J / (ρ ΣT)``. For a
    sum of orders or an end in motion, a search along s finds a local optimum.
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


def _factors(model: TimeAllocation) -> Iterator[float]:
    """Yield stretch factors to try, only larger ones if slower motions satisfy all limits."""
    yield 1.0
    if model.total_time is not None:
        return
    for k in range(1, 25):
        yield 2.0 ** (k / 4)
        if not model.from_rest_to_rest:
            yield 2.0 ** (-k / 4)


def stretch_durations(model: TimeAllocation, inner: Barrier, durations: Floats) -> Floats | None:
    """Return `durations` stretched until a path satisfies the bounds, or None without success.

    From rest to rest, slower motions satisfy all limits. With an end in motion, a slower path may
    have to leave the corridor, so that shorter durations are tried as well.
    """
    if model.from_rest_to_rest and model.total_time is None:
        plan = Spline(model).plan(durations)
        if plan is not None:
            durations = durations * max(1.0, 1.02 * model.stretch(plan))
    return _first_feasible(model, inner, (durations * factor for factor in _factors(model)))


def _first_feasible(
    model: TimeAllocation, inner: Barrier, candidates: Iterable[Floats]
) -> Floats | None:
    """Return the first durations with a path within the bounds, or None without success."""
    spline = Spline(model)
    for durations in candidates:
        set_barrier(model, inner, spline, durations)
        if np.isfinite(inner.settle(durations, BETWEEN).value):
            return durations
        if inner.flag[0]:
            break
    return None


def restore_path(model: TimeAllocation, inner: Barrier, durations: Floats) -> Floats | None:
    """Return feasible `durations` or slightly longer ones with a path, like :func:`stretch_durations`."""
    slower = SLOWER if model.from_rest_to_rest and model.total_time is None else ()
    result = _first_feasible(model, inner, (durations * np.exp(share) for share in (0.0, *slower)))
    if result is not None or inner.flag[0]:
        return result
    return stretch_durations(model, inner, durations)


def set_barrier(model: TimeAllocation, inner: Barrier, spline: Spline, durations: Floats) -> None:
    """Set the barrier parameter from the cost of the path without bounds."""
    cost = spline.value(durations).objective
    price = model.time_weight * float(durations.sum())
    if not np.isfinite(cost) or cost <= 0.0:
        cost = price if price > 0 else 1.0
    inner.unit = max(cost, 1e-6 * price)
    inner.mu = ROUGH * (inner.unit + price) / inner.pairs


def prepare_start(model: TimeAllocation, inner: Inner, durations: Floats) -> Floats | None:
    """Return `durations` scaled for J + ρ ΣT and, with bounds, stretched until a path exists."""
    if isinstance(inner, Spline):
        return scale_durations(model, inner, durations)
    return stretch_durations(model, inner, scale_durations(model, Spline(model), durations))


def shorten_total(model: TimeAllocation, inner: Barrier, durations: Floats) -> Floats | None:
    """Return durations of the given total with a path within the bounds, or None without success.

    From rest to rest, a faster path can be slowed down. Therefore the total is free and its cost is
    increased until it is short enough.
    """
    total = model.total_time
    if total is None or not model.from_rest_to_rest:
        return None
    free = replace(model, total_time=None, time_weight=1.0)
    begin = stretch_durations(free, inner, durations)
    if begin is None:
        return None
    cost = Spline(model).value(begin).objective
    price = cost / float(begin.sum()) if np.isfinite(cost) and cost > 0 else 1.0
    result: list[Floats] = []

    def report(now: Floats, value: float) -> None:
        if float(now.sum()) <= total:
            result.append(now)

    for dear in DEAR:
        begin = allocate(
            replace(free, time_weight=dear * price), inner, begin, tolerance=1e-4, most=300,
            between=1e-6, report=report, stopped=lambda: bool(result) or bool(inner.flag[0]),
        ).durations  # fmt: skip
        if result or inner.flag[0]:
            break
    if not result:
        return None
    return _first_feasible(model, inner, [result[-1] * (total / float(result[-1].sum()))])


# -- merging of free knots -------------------------------------------------------------------------
# Splitting a segment at any point turns a path into one with more segments. Therefore a solution with
# fewer free knots is a start for more, and additional free knots never increase the objective.


def runs_of(model: TimeAllocation) -> Ints:
    """Return the number of segments in each run between knots that are not free, shape (runs,).

    A knot is free if it has no fixed entry and its two segments have the same bounds.
    """
    free = np.asarray(~np.isfinite(model.conditions).any(axis=(1, 2)))[1:-1]
    for bound in model.bounds:
        for side in (bound.lower, bound.upper):
            free &= (side[1:] == side[:-1]).all(axis=1)
    spaces = model.halfspaces
    if spaces is not None:
        rows = np.column_stack([spaces.normals, spaces.offsets])
        sets = [{*map(tuple, rows[spaces.segments == k])} for k in range(model.segments)]
        free &= [entry == other for entry, other in pairwise(sets)]
    ends = np.concatenate([[0], np.flatnonzero(~free) + 1, [model.segments]])
    return np.diff(ends).astype(np.int64)


def coarsen(model: TimeAllocation) -> Iterator[tuple[Ints, TimeAllocation]]:
    """Yield segment counts per run and models, from one segment per run up to `model` itself."""
    runs = runs_of(model)
    counts = [runs]
    while counts[-1].max() > 1:
        now = counts[-1].copy()
        if (now - 1).sum() > SINGLY:
            now = np.maximum(now // 2, 1)
        else:
            now[now.argmax()] -= 1
        counts.append(now)
    for now in reversed(counts[1:]):
        try:
            fewer = _merged(model, runs, now)
        except InvalidData:
            continue  # a closed loop of one segment may have no motion
        yield now, fewer
    yield runs, model


def _merged(model: TimeAllocation, runs: Ints, counts: Ints) -> TimeAllocation:
    """Return the model with `counts` segments in its runs."""
    begin = np.cumsum(runs) - runs
    segments = np.concatenate(
        [at + np.arange(count) for at, count in zip(begin, counts, strict=True)]
    )
    knots = np.append(segments, model.segments)
    fields: dict[str, Any] = {"waypoints": model.waypoints[knots]}
    if model.derivatives is not None:
        fields["derivatives"] = model.derivatives[knots]
    for name in (
        "corridor_lower", "corridor_upper", "velocity_limit", "acceleration_limit", "jerk_limit",
    ):  # fmt: skip
        value = getattr(model, name)
        fields[name] = None if value is None else value[segments]
    if model.polytope_segments is not None:
        at = [np.flatnonzero(model.polytope_segments == k) for k in segments]
        fields["polytope_segments"] = np.repeat(np.arange(segments.size), [len(a) for a in at])
        take = np.concatenate(at)
        fields["polytope_normals"] = model.polytope_normals[take]  # type: ignore[index]
        fields["polytope_offsets"] = model.polytope_offsets[take]  # type: ignore[index]
    return replace(model, **fields)


def subdivide(durations: Floats, runs: Ints, counts: Ints) -> Floats:
    """Return the durations after halving the longest segments of each run."""
    parts = []
    for part, count in zip(np.split(durations, np.cumsum(runs)[:-1]), counts, strict=True):
        now = part
        while now.size < count:
            at = int(now.argmax())
            now = np.insert(now, at, 0.5 * now[at])
            now[at + 1] *= 0.5
        parts.append(now)
    return np.concatenate(parts)
