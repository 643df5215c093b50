"""Instants at which a program holds what must hold at every one, and those that it lacks."""

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

#: Share of the tolerance that a violation between the instants may keep: less than rounding.
SETTLED = 5e-4


class Instants(NamedTuple):
    """Where bounds are held.

    Parameters
    ----------
    bound, segment, axis : ndarray of int, shape (Q,)
        The bound (the half-spaces count as the last), the segment, the axis or half-space.
    s : ndarray, shape (Q,)
        The instant, in the segment's scaled time.
    """

    bound: Ints
    segment: Ints
    axis: Ints
    s: Floats

    def taken(self, index: Ints) -> Instants:
        """Return the instants at `index`."""
        return Instants(self.bound[index], self.segment[index], self.axis[index], self.s[index])

    def joined(self, other: Instants) -> Instants:
        """Return these instants and then the others."""
        return Instants(
            np.concatenate([self.bound, other.bound]),
            np.concatenate([self.segment, other.segment]),
            np.concatenate([self.axis, other.axis]),
            np.concatenate([self.s, other.s]),
        )

    def sorted(self) -> tuple[Instants, Ints]:
        """Return the instants by segment, and the permutation that sorts them."""
        order = np.lexsort((self.s, self.axis, self.bound, self.segment)).astype(np.int64)
        return self.taken(order), order

    def fresh(self, others: Instants) -> Instants:
        """Return those of `others` that are not held yet, each once, in their order.

        Instants closer than a billionth count as one.
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
    """Bounds, and what a violation of each is held against."""

    lower: Floats
    upper: Floats
    low_scale: Floats
    high_scale: Floats


def first_instants(
    model: MinimumDerivative, samples: int, continuity: int, axes: Sequence[int] | None = None
) -> Instants:
    """Return the instants at which bounds are held from the start.

    Chebyshev's extreme points of every bounded segment, denser where derivatives peak. What is
    fixed at a knot cannot be moved by a row, and what is continuous there and bounded alike on both
    sides needs one row only.

    Parameters
    ----------
    model : MinimumDerivative
        The model.
    samples : int
        Instants of each segment, 2 or more.
    continuity : int
        The highest derivative that is the same on both sides of a knot.
    axes : sequence of int, optional
        Leave out the bounds of other axes; half-spaces are of all.
    """
    nodes = (1 - np.cos(np.pi * np.arange(samples) / (samples - 1))) / 2
    own = np.zeros(model.dimensions, bool)
    own[list(range(model.dimensions) if axes is None else axes)] = True
    found = NOWHERE
    for number, bound in enumerate(model.bounds):
        derivative = bound.derivative
        if derivative > model.degree:
            continue  # it vanishes, which every limit allows
        finite = (np.isfinite(bound.lower) | np.isfinite(bound.upper)) & own
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
        found = found.joined(Instants(numbers, segment[keep], axis[keep], s[keep]))
    spaces = model.halfspaces
    if spaces is not None:
        which = np.repeat(np.arange(spaces.segments.size), samples)
        numbers = np.full(which.size, len(model.bounds))
        s = np.tile(nodes, spaces.segments.size)
        found = found.joined(Instants(numbers, spaces.segments[which], which, s))
    return found


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
