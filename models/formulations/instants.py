"""Instants at which a program holds what must hold at every one, and those that it lacks."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..polynomials import bernstein_matrix, critical_points, horner

__all__ = ["NOWHERE", "Instants", "Limits", "moved", "sticking_out", "violation"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Share of the tolerance that a violation between the instants may keep: less than rounding.
SETTLED = 5e-4
#: Distance in s within which a new instant takes the place of an old one.
BESIDE = 1e-2


class Instants(NamedTuple):
    """Where one bound is held: its index, and a segment, an axis (or half-space), an s each."""

    bound: Ints
    segment: Ints
    axis: Ints
    s: Floats


_NO_INTS: Ints = np.empty(0, np.int64)
NOWHERE = Instants(_NO_INTS, _NO_INTS, _NO_INTS, np.empty(0))


class Limits(NamedTuple):
    """Bounds, and what a violation of each is held against."""

    lower: Floats
    upper: Floats
    low_scale: Floats
    high_scale: Floats


def moved(held: Instants, added: Instants) -> Instants:
    """Return the instants with `added`, which take the place of those right beside them.

    As the extremes settle, instants follow one another ever closer, and rows that are almost equal
    are what interior points fail on. The last place is the best.
    """
    keys = [np.column_stack([part.bound, part.segment, part.axis]) for part in (held, added)]
    _, own = np.unique(np.concatenate(keys), axis=0, return_inverse=True)
    own = own.ravel()
    owner = np.concatenate([own[: held.s.size], own[held.s.size :]]) * 2.0
    place = owner + np.concatenate([held.s, added.s])
    fresh = np.sort(place[held.s.size :])
    old = place[: held.s.size]
    after = np.searchsorted(fresh, old)
    right = np.where(after < fresh.size, fresh[np.minimum(after, fresh.size - 1)] - old, np.inf)
    left = np.where(after > 0, old - fresh[np.maximum(after - 1, 0)], np.inf)
    kept = np.minimum(left, right) > BESIDE
    return Instants(
        np.concatenate([held.bound[kept], added.bound]),
        np.concatenate([held.segment[kept], added.segment]),
        np.concatenate([held.axis[kept], added.axis]),
        np.concatenate([held.s[kept], added.s]),
    )


def violation(value: Floats, limits: Limits) -> Floats:
    """Return the violation relative to what the verification holds it against."""
    with np.errstate(invalid="ignore"):
        low = (limits.lower - value) / limits.low_scale
        high = (value - limits.upper) / limits.high_scale
    worst: Floats = np.maximum(
        np.where(np.isfinite(limits.lower), low, 0.0),
        np.where(np.isfinite(limits.upper), high, 0.0),
    )
    return np.maximum(worst, 0.0)


def sticking_out(
    rows: Floats, limits: Limits, tolerance: float, number: int, segment: Ints, axis: Ints,
    reached: float,
) -> Instants:  # fmt: skip
    """Return the local extremes of the polynomials in `rows` that lie outside their bounds."""
    control = rows @ bernstein_matrix(rows.shape[1] - 1).T
    out = (control.min(axis=1) < limits.lower) | (control.max(axis=1) > limits.upper)
    near = np.flatnonzero(out)
    if not near.size:
        return NOWHERE
    s = critical_points(rows[near])
    value = horner(rows[near][:, :, None], s)
    share = violation(value, Limits(*(part[near][:, None] for part in limits)))
    threshold = max(SETTLED * tolerance, 2.0 * reached)
    row, column = np.nonzero(share > threshold)
    at: Any = near[row]
    # One instant stands for all that rounding tells apart.
    found = np.round(s[row, column], 9)
    keys = np.unique(np.column_stack([at, found]), axis=0)
    at = keys[:, 0].astype(np.int64)
    return Instants(
        np.full(at.size, number),
        segment[at].astype(np.int64),
        axis[at].astype(np.int64),
        keys[:, 1],
    )
