"""Bounds of continuous time, the instants at which a program imposes them, and instants to add."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..model import MinimumDerivative
from ..polynomials import bernstein_matrix, critical_points, factorials, horner

__all__ = ["NOWHERE", "Instants", "Limits", "first_instants", "initial_times", "outside"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Limits(NamedTuple):
    """Table of the bounds: ``lower <= direction @ x^(derivative)(t) <= upper`` on a segment.

    A box has one entry per segment and bounded axis. The entries are sorted by segment.
    """

    #: Index of the segment, shape (N,).
    segment: Ints
    #: Index of the bound in ``model.bounds``, shape (N,). The half-spaces share the next index.
    bound: Ints
    #: Index of the axis or of the half-space, shape (N,).
    axis: Ints
    #: Order of the derivative in time, shape (N,).
    derivative: Ints
    #: Unit vector of the axis, or normal of the half-space, shape (N, dimensions).
    direction: Floats
    #: Bounds, m/s^derivative, shape (N,); infinite for unbounded sides.
    lower: Floats
    upper: Floats
    #: Scales of violations from below and from above, as in the verification, shape (N,).
    low_scale: Floats
    high_scale: Floats

    @classmethod
    def of(cls, model: MinimumDerivative, axes: tuple[int, ...] | None = None) -> Limits:
        """Return the bounds on `axes`, all by default, and all half-spaces.

        Bounds on derivatives above the degree are omitted, because these derivatives are 0.
        """
        size = model.dimensions
        included = np.zeros(size, bool)
        included[list(range(size) if axes is None else axes)] = True
        none = np.empty(0, np.int64)
        parts = [Limits(none, none, none, none, np.empty((0, size)), *[np.empty(0)] * 4)]
        for number, bound in enumerate(model.bounds):
            if bound.derivative > model.degree:
                continue
            finite = (np.isfinite(bound.lower) | np.isfinite(bound.upper)) & included
            segment, axis = (index.astype(np.int64) for index in np.nonzero(finite))
            tables = (bound.lower, bound.upper, *model.bound_scale(bound))
            parts.append(
                Limits(
                    segment, np.full(segment.size, number), axis,
                    np.full(segment.size, bound.derivative), np.eye(size)[axis],
                    *(table[segment, axis] for table in tables),
                )
            )  # fmt: skip
        spaces = model.halfspaces
        if spaces is not None:
            which = np.arange(spaces.segments.size)
            scale = np.full(which.size, model.position_scale.max())
            parts.append(
                Limits(
                    spaces.segments.astype(np.int64), np.full(which.size, len(model.bounds)), which,
                    np.zeros(which.size, np.int64), spaces.normals,
                    np.full(which.size, -np.inf), spaces.offsets, scale, scale,
                )
            )  # fmt: skip
        table = Limits(*(np.concatenate(column) for column in zip(*parts, strict=True)))
        return table.taken(np.argsort(table.segment, kind="stable"))

    def taken(self, index: Ints) -> Limits:
        """Return the entries with the given indices."""
        columns: Any = (column[index] for column in self)
        return Limits(*columns)

    def polynomials(self, powers: Floats, durations: Floats) -> Floats:
        """Return the bounded values as ascending powers of s, shape (N, degree + 1).

        `powers`, shape (segments, degree + 1, dimensions), are the coefficients of a path. Derivatives
        are padded with zeros.
        """
        values: Floats = np.einsum("npd,nd->np", powers[self.segment], self.direction)
        degree = values.shape[1] - 1
        for j in np.unique(self.derivative[self.derivative > 0]).tolist():
            rows = np.flatnonzero(self.derivative == j)
            scale = durations[self.segment[rows]] ** -float(j)
            inner = values[rows, j:] * factorials(degree, j) * scale[:, None]
            values[rows] = np.pad(inner, ((0, 0), (0, j)))
        return values

    def violation(self, value: Floats) -> Floats:
        """Return the violations of the bounds by one value per entry, relative to their scales."""
        low = (self.lower - value) / self.low_scale
        high = (value - self.upper) / self.high_scale
        return np.maximum(np.maximum(low, high), 0.0)


class Instants(NamedTuple):
    """Instants at which bounds are imposed."""

    #: Entry of the bound in the table of :class:`Limits`, shape (Q,).
    row: Ints
    #: Scaled time in the segment, in [0, 1], shape (Q,).
    s: Floats

    def taken(self, index: Ints) -> Instants:
        """Return the instants with the given indices."""
        return Instants(self.row[index], self.s[index])

    def joined(self, other: Instants) -> Instants:
        """Return these instants followed by `other`."""
        return Instants(np.append(self.row, other.row), np.append(self.s, other.s))

    def sorted(self) -> tuple[Instants, Ints]:
        """Return the instants sorted by segment, and the permutation that sorts them."""
        order = np.lexsort((self.s, self.row)).astype(np.int64)
        return self.taken(order), order

    def fresh(self, others: Instants) -> Instants:
        """Return the new and distinct instants of `others`, in their order.

        Instants are equal if their scaled times agree to nine decimals.
        """
        both = self.joined(others)
        keys = np.column_stack([both.row, np.round(both.s * 1e9).astype(np.int64)])
        _, first = np.unique(keys, axis=0, return_index=True)
        new = np.sort(first[first >= self.s.size]) - self.s.size
        return others.taken(new.astype(np.int64))


NOWHERE = Instants(np.empty(0, np.int64), np.empty(0))


def initial_times(samples: int) -> Floats:
    """Return scaled times in [0, 1], the extreme points of a Chebyshev polynomial: denser near the ends."""
    return np.asarray((1 - np.cos(np.pi * np.arange(samples) / (samples - 1))) / 2)


def first_instants(
    model: MinimumDerivative, limits: Limits, samples: int, continuity: int
) -> Instants:
    """Return the initial instants at which bounds are imposed, at least 2 `samples` per segment.

    They are the :func:`initial_times` of every bounded segment, as derivatives peak near its ends.
    Values that are fixed at a knot need no row. Values that are continuous at a knot with equal bounds
    on both sides need one row. Derivatives up to `continuity` are equal on both sides of a knot.
    """
    nodes = initial_times(samples)
    every = Instants(
        np.repeat(np.arange(limits.segment.size), samples), np.tile(nodes, limits.segment.size)
    )
    shape = model.segments, model.dimensions
    needed = np.ones(every.s.size, bool)
    for number, bound in enumerate(model.bounds):
        mine = np.flatnonzero(limits.bound[every.row] == number)
        entries, s = limits.taken(every.row[mine]), every.s[mine]
        segment, axis = entries.segment, entries.axis
        if bound.derivative < model.conditions.shape[1]:
            fixed = np.isfinite(model.conditions[segment + (s == 1.0), bound.derivative, axis])
            needed[mine[fixed & ((s == 0.0) | (s == 1.0))]] = False
        if bound.derivative <= continuity:
            alike = np.zeros(shape, bool)
            alike[:-1] = (bound.lower[1:] == bound.lower[:-1]) & (
                bound.upper[1:] == bound.upper[:-1]
            )
            needed[mine[(s == 1.0) & alike[segment, axis]]] = False
    return every.taken(np.flatnonzero(needed))


def outside(
    polynomials: Floats, limits: Limits, threshold: float | Floats
) -> tuple[Instants, Floats]:
    """Return the local extremes that violate a bound, and their relative violations.

    `polynomials` has one row of ascending powers of s per entry of `limits`. `threshold`, a number or
    one per entry, is the smallest violation reported, relative to its scale.
    """
    control = polynomials @ bernstein_matrix(polynomials.shape[1] - 1).T
    # The control polygon encloses the curve, so only rows whose polygon violates a bound matter.
    beyond = (control.min(axis=1) < limits.lower) | (control.max(axis=1) > limits.upper)
    near = np.flatnonzero(beyond).astype(np.int64)
    places = np.sort(critical_points(polynomials[near]), axis=1)
    value = horner(polynomials[near][:, :, None], places)
    lower, upper, low_scale, high_scale = (column[near, None] for column in limits[-4:])
    share = np.maximum((lower - value) / low_scale, (value - upper) / high_scale)
    # Of adjacent candidates, keep the largest violation. The others are not extremes or repeat it.
    edge = np.full((near.size, 1), -np.inf)
    peak = share >= np.concatenate([edge, share[:, :-1]], axis=1)
    peak &= share > np.concatenate([share[:, 1:], edge], axis=1)
    least = np.broadcast_to(threshold, len(polynomials))[near, None]
    row, column = np.nonzero(peak & (share > least))
    return Instants(near[row], places[row, column]), share[row, column]
