"""Merging of free knots: equivalent time allocations with fewer segments.

Splitting a segment at any point turns a path into one with more segments. Therefore a solution with
fewer free knots is a start for more, and additional free knots never increase the objective.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.minimum_snap.time_allocation import TimeAllocation

__all__ = ["coarser", "runs_of", "subdivided"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Largest number of free knots that are added one by one. With more, the number doubles.
SINGLY = 20


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
        free &= [one == other for one, other in pairwise(sets)]
    ends = np.concatenate([[0], np.flatnonzero(~free) + 1, [model.segments]])
    return np.diff(ends).astype(np.int64)


def coarser(model: TimeAllocation) -> Iterator[tuple[Ints, TimeAllocation]]:
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


def subdivided(durations: Floats, runs: Ints, counts: Ints) -> Floats:
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
