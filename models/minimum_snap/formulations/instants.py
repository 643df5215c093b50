"""Instants at which a program imposes continuous-time bounds, and the instants to add."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..polynomials import bernstein_matrix, critical_points, horner

if TYPE_CHECKING:
    from ..model import MinimumDerivative

__all__ = [
    "NOWHERE",
    "Instants",
    "Limits",
    "first_instants",
    "sticking_out",
    "violation",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Largest violation between the instants, as a share of the tolerance. It is below rounding.
SETTLED = 5e-4


class Instants(NamedTuple):
    """Instants at which bounds are imposed.

    Parameters
    ----------
    bound : ndarray of int, shape (Q,)
        Index of the bound. The half-spaces share the last index.
    segment : ndarray of int, shape (Q,)
        Index of the segment.
    axis : ndarray of int, shape (Q,)
        Index of the axis or of the half-space.
    s : ndarray, shape (Q,)
        Scaled time in the segment, in [0, 1].
    """

    bound: Ints
    segment: Ints
    axis: Ints
    s: Floats

    def taken(self, index: Ints) -> Instants:
        """Return the instants with the given indices."""
        return Instants(self.bound[index], self.segment[index], self.axis[index], self.s[index])

    def joined(self, other: Instants) -> Instants:
        """Return these instants followed by `other`."""
        return Instants(
            np.concatenate([self.bound, other.bound]),
            np.concatenate([self.segment, other.segment]),
            np.concatenate([self.axis, other.axis]),
            np.concatenate([self.s, other.s]),
        )

    def sorted(self) -> tuple[Instants, Ints]:
        """Return the instants sorted by segment, and the permutation that sorts them."""
        order = np.lexsort((self.s, self.axis, self.bound, self.segment)).astype(np.int64)
        return self.taken(order), order

    def fresh(self, others: Instants) -> Instants:
        """Return the new and distinct instants of `others`, in their order.

        Instants are equal if their scaled times agree to nine decimals.
        """
        both = self.joined(others)
        place = np.round(both.s * 1e9).astype(np.int64)
        keys = np.column_stack([both.bound, both.segment, both.axis, place])
        _, first = np.unique(keys, axis=0, return_index=True)
        new = np.sort(first[first >= self.s.size]) - self.s.size
        return others.taken(new.astype(np.int64))


_NO_INTS: Ints = np.empty(0, np.int64)
NOWHERE = Instants(_NO_INTS, _NO_INTS, _NO_INTS, np.empty(0))


class Limits(NamedTuple):
    """Bounds, and the scales of violations from below and from above."""

    lower: Floats
    upper: Floats
    low_scale: Floats
    high_scale: Floats


def first_instants(
    model: MinimumDerivative, samples: int, continuity: int, axes: Sequence[int] | None = None
) -> Instants:
    """Return the initial instants at which bounds are imposed.

    They are the Chebyshev extreme points of every bounded segment, which are denser near its ends,
    where derivatives peak. Values that are fixed at a knot need no row. Values that are continuous
    at a knot with equal bounds on both sides need one row.

    Parameters
    ----------
    model : MinimumDerivative
        Problem at given times.
    samples : int
        Instants per segment, at least 2.
    continuity : int
        Highest order of a derivative that is equal on both sides of a knot.
    axes : sequence of int, optional
        Axes whose bounds are imposed, all by default. Half-spaces are always included.
    """
    nodes = (1 - np.cos(np.pi * np.arange(samples) / (samples - 1))) / 2
    included = np.zeros(model.dimensions, bool)
    included[list(range(model.dimensions) if axes is None else axes)] = True
    result = NOWHERE
    for number, bound in enumerate(model.bounds):
        derivative = bound.derivative
        if derivative > model.degree:
            continue  # the derivative is 0, which satisfies every limit
        finite = (np.isfinite(bound.lower) | np.isfinite(bound.upper)) & included
        segment, axis = (np.repeat(part, samples) for part in np.nonzero(finite))
        s = np.tile(nodes, segment.size // samples)
        keep = np.ones(s.size, bool)
        if derivative < model.conditions.shape[1]:
            knots = segment + (s == 1.0)
            ends = (s == 0.0) | (s == 1.0)
            keep &= ~(ends & np.isfinite(model.conditions[knots, derivative, axis]))
        if derivative <= continuity:
            after = np.minimum(segment + 1, model.segments - 1)
            alike = (bound.lower[segment, axis] == bound.lower[after, axis]) & (
                bound.upper[segment, axis] == bound.upper[after, axis]
            )
            keep &= ~((s == 1.0) & alike & (segment + 1 < model.segments))
        numbers = np.full(int(keep.sum()), number)
        result = result.joined(Instants(numbers, segment[keep], axis[keep], s[keep]))
    spaces = model.halfspaces
    if spaces is not None:
        which = np.repeat(np.arange(spaces.segments.size), samples)
        numbers = np.full(which.size, len(model.bounds))
        s = np.tile(nodes, spaces.segments.size)
        result = result.joined(Instants(numbers, spaces.segments[which], which, s))
    return result


def violation(value: Floats, limits: Limits) -> Floats:
    """Return the violation relative to the scale that the verification uses."""
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
    """Return the instants of local extremes of the polynomials `rows` that violate their bounds."""
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
    # Rounding merges instants that differ only by rounding errors.
    rounded = np.round(s[row, column], 9)
    keys = np.unique(np.column_stack([at, rounded]), axis=0)
    at = keys[:, 0].astype(np.int64)
    return Instants(
        np.full(at.size, number),
        segment[at].astype(np.int64),
        axis[at].astype(np.int64),
        keys[:, 1],
    )
