"""Groups of axes coupled by corridor and limits: imposed instants and iterates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.minimum_snap.formulations.hermite import hermite_basis
from ...models.minimum_snap.formulations.instants import Instants
from ...models.minimum_snap.formulations.piecewise import power_rows
from ...models.minimum_snap.time_allocation import TimeAllocation
from .chain import Chain, chains, unit_cost
from .time_inner import jets_of

__all__ = ["Forms", "Group", "Iterate", "Rows", "forms_of", "groups_of"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

#: Initial instants per segment at which bounds are imposed.
SAMPLES = 8
#: Initial slack of an added bound, relative to its scale.
FRESH = 1e-3


class Rows(NamedTuple):
    """Bounded values, ``T^-derivative Σ_axis mix[axis] unit'y[axis]``, sorted by segment.

    Parameters
    ----------
    unit : ndarray, shape (Q, degree + 1)
        Coefficients in the Hermite coordinates of a segment of 1 s.
    mix : ndarray, shape (Q, axes)
        Weights of the axes in the sum.
    derivative : ndarray of int, shape (Q,)
        Order of the derivative in time.
    start : ndarray of int, shape (M + 1,)
        Index of the first row of each segment.
    lower, upper : ndarray, shape (Q,)
        Bounds of each row.
    low_scale, high_scale : ndarray, shape (Q,)
        Scales of violations from below and from above.
    """

    unit: Floats
    mix: Floats
    derivative: Ints
    start: Ints
    lower: Floats
    upper: Floats
    low_scale: Floats
    high_scale: Floats


class Iterate(NamedTuple):
    """Coordinates, slacks and multipliers, all in the model's units.

    Parameters
    ----------
    knots : ndarray, shape (M + 1, n)
        Derivatives at the knots, multiplied by the time of the knot to the power of their order.
    inner : ndarray, shape (M, interior)
        Inner coefficients of a degree above 2r-1.
    below, above, z_below, z_above : ndarray, shape (Q,)
        Slacks and multipliers; 1 and 0 for infinite bounds.
    """

    knots: Floats
    inner: Floats
    below: Floats
    above: Floats
    z_below: Floats
    z_above: Floats

    def copied(self) -> Iterate:
        """Return a writable copy."""
        return Iterate(*(part.copy() for part in self))


class Forms(NamedTuple):
    """Data shared by all groups.

    Parameters
    ----------
    model : TimeAllocation
        Problem with free times.
    basis : ndarray, shape (degree + 1, degree + 1)
        Coefficients of the Hermite functions in powers of s.
    unit_cost, cost_orders : ndarray, shapes (C, degree + 1), (C,)
        Rows with J = Σ T^(1-2j) |row y|² for one axis, and their orders j.
    origin : ndarray, shape (dimensions,)
        Origin of the positions, m.
    """

    model: TimeAllocation
    basis: Floats
    unit_cost: Floats
    cost_orders: Ints
    origin: Floats


@dataclass
class Group:
    """Axes coupled by half-spaces, or a single axis.

    Parameters
    ----------
    axes : tuple of int
        Indices of the axes.
    fixed, values : ndarray, shape (knots, n)
        Mask of the fixed derivatives, and their values.
    held : Instants
        Instants at which the bounds are imposed.
    rows : Rows
        Bounded values at these instants.
    owners : Instants
        One entry for every bound of a segment.
    spans : Rows
        Bounded values of these entries.
    iterate : Iterate
        Last iterate of the barrier problem.
    warm : bool
        Whether the iterate solves the barrier problem.
    """

    axes: tuple[int, ...]
    fixed: Flags
    values: Floats
    held: Instants
    rows: Rows
    owners: Instants
    spans: Rows
    iterate: Iterate
    warm: bool = False

    @property
    def pairs(self) -> int:
        """Number of slacks."""
        return int(np.isfinite(self.rows.lower).sum() + np.isfinite(self.rows.upper).sum())

    def hold(self, forms: Forms, fresh: Instants, mu: float) -> int:
        """Impose the bounds at more instants, with slack times multiplier equal to `mu`.

        Return the number of new instants.
        """
        fresh = self.held.fresh(fresh)
        if not fresh.s.size:
            return 0
        size = self.held.s.size
        self.held, order = self.held.joined(fresh).sorted()
        self.rows = _rows(forms, self.axes, self.held)
        rows = self.rows
        has_low, has_high = np.isfinite(rows.lower), np.isfinite(rows.upper)
        slack = FRESH * np.maximum(rows.low_scale, rows.high_scale)
        more = np.zeros(fresh.s.size)

        def joined(part: Floats, added: Floats) -> Floats:
            merged: Floats = np.where(order >= size, added, np.concatenate([part, more])[order])
            return merged

        now = self.iterate
        self.iterate = Iterate(
            now.knots,
            now.inner,
            joined(now.below, np.where(has_low, slack, 1.0)),
            joined(now.above, np.where(has_high, slack, 1.0)),
            joined(now.z_below, np.where(has_low, mu / slack, 0.0)),
            joined(now.z_above, np.where(has_high, mu / slack, 0.0)),
        )
        return int(fresh.s.size)


def forms_of(model: TimeAllocation) -> Forms:
    """Return the data shared by all groups of `model`."""
    parts, orders = [], []
    for order, weight in enumerate(model.order_weights, start=1):
        if weight:
            own = np.sqrt(weight) * unit_cost(model.order, model.degree, order)
            parts.append(own)
            orders += [order] * len(own)
    return Forms(
        model,
        np.ascontiguousarray(hermite_basis(model.order, model.degree)),
        np.ascontiguousarray(np.concatenate(parts)),
        np.array(orders, np.int64),
        jets_of(model)[2],
    )


def groups_of(forms: Forms) -> list[Group]:
    """Return the groups of axes of a model, without solved iterates."""
    model = forms.model
    values, fixed, _ = jets_of(model)
    groups = []
    for chain in chains(model.unit):
        # Coordinates of a knot are ordered by axis, then by order of the derivative.
        take = list(chain.axes)
        shape = (len(model.waypoints), chain.jets)
        own_fixed = np.ascontiguousarray(np.moveaxis(fixed[take], 0, 1).reshape(shape))
        own_values = np.ascontiguousarray(np.moveaxis(values[take], 0, 1).reshape(shape))
        held, owners = chain.first_instants(SAMPLES), _owners(chain)
        size = held.s.size
        iterate = Iterate(
            own_values.copy(), np.zeros((model.segments, chain.interior)),
            np.ones(size), np.ones(size), np.zeros(size), np.zeros(size),
        )  # fmt: skip
        groups.append(
            Group(
                chain.axes, own_fixed, own_values, held, _rows(forms, chain.axes, held),
                owners, _rows(forms, chain.axes, owners), iterate,
            )
        )  # fmt: skip
    return groups


def _rows(forms: Forms, axes: tuple[int, ...], held: Instants) -> Rows:
    """Return the rows of the bounded values at the instants `held`."""
    model, basis, origin = forms.model, forms.basis, forms.origin
    size = held.s.size
    unit, mix = np.zeros((size, model.degree + 1)), np.zeros((size, len(axes)))
    derivative = np.zeros(size, np.int64)
    lower, upper = np.full(size, -np.inf), np.full(size, np.inf)
    low_scale, high_scale = np.ones(size), np.ones(size)
    for number, bound in enumerate(model.bounds):
        low_sizes, high_sizes = model.unit.bound_scale(bound)
        for at, axis in enumerate(axes):
            take = np.flatnonzero((held.bound == number) & (held.axis == axis))
            segment = held.segment[take]
            unit[take] = power_rows(held.s[take], bound.derivative, model.degree) @ basis
            mix[take, at] = 1.0
            derivative[take] = bound.derivative
            shift = origin[axis] if bound.derivative == 0 else 0.0
            lower[take] = bound.lower[segment, axis] - shift
            upper[take] = bound.upper[segment, axis] - shift
            low_scale[take] = low_sizes[segment, axis]
            high_scale[take] = high_sizes[segment, axis]
    spaces = model.halfspaces
    if spaces is not None:
        take = np.flatnonzero(held.bound == len(model.bounds))
        which = held.axis[take]
        unit[take] = power_rows(held.s[take], 0, model.degree) @ basis
        mix[take] = spaces.normals[which][:, list(axes)]
        upper[take] = spaces.offsets[which] - spaces.normals[which] @ origin
        high_scale[take] = model.unit.position_scale.max()
    start = np.searchsorted(held.segment, np.arange(model.segments + 1)).astype(np.int64)
    return Rows(unit, mix, derivative, start, lower, upper, low_scale, high_scale)


def _owners(chain: Chain) -> Instants:
    """Return one instant (at s = 0) for every bound of every segment of a chain."""
    model = chain.model
    none = np.empty(0, np.int64)
    columns: list[tuple[Ints, Ints, Ints]] = [(none, none, none)]
    for number, bound in enumerate(model.bounds):
        if bound.derivative > model.degree:
            continue  # the derivative is 0, which satisfies every limit
        finite = np.isfinite(bound.lower) | np.isfinite(bound.upper)
        for axis in chain.axes:
            segment = np.flatnonzero(finite[:, axis])
            columns.append((np.full(segment.size, number), segment, np.full(segment.size, axis)))
    spaces = model.halfspaces
    if spaces is not None:
        which = np.arange(spaces.segments.size)
        columns.append((np.full(which.size, len(model.bounds)), spaces.segments, which))
    number_, segment_, which_ = (
        np.concatenate(column).astype(np.int64) for column in zip(*columns, strict=True)
    )
    return Instants(number_, segment_, which_, np.zeros(number_.size)).sorted()[0]
