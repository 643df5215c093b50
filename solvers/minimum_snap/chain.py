"""Trajectory problem as a chain of segments, for one group of coupled axes.

Without polytopes every axis is a separate chain. Half-spaces couple all axes. The unknowns are the
derivatives at the knots, multiplied by the time of the knot to the power of their order, and the
inner coefficients of a segment if the degree is above ``2 r - 1``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from ...models.minimum_snap.formulations.hermite import hermite_basis, knot_times
from ...models.minimum_snap.formulations.instants import Instants, first_instants
from ...models.minimum_snap.formulations.piecewise import power_rows
from ...models.minimum_snap.model import MinimumDerivative
from ...models.minimum_snap.polynomials import factorials, gauss_legendre

__all__ = ["Chain", "chains", "unit_cost"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
#: Lower and upper bounds, followed by the scales of violations from below and from above.
Limits = tuple[Floats, Floats, Floats, Floats]


@cache
def unit_cost(order: int, degree: int, derivative: int) -> Floats:
    """Return rows whose squares sum to ∫ (d^j x / ds^j)² ds, for Hermite coordinates on [0, 1].

    The rows are the values at the Gauss-Legendre nodes times the square roots of the weights. The
    quadrature is exact and forms no products of coordinates.
    """
    nodes, weights = gauss_legendre(degree - derivative + 1)
    rows = power_rows(nodes, derivative, degree) @ hermite_basis(order, degree)
    unit: Floats = rows * np.sqrt(weights)[:, None]
    return unit


@dataclass(frozen=True, eq=False)
class Chain:
    """Group of coupled axes.

    Parameters
    ----------
    model : MinimumDerivative
        Problem at given times.
    axes : tuple of int
        Indices of the axes in the group.
    """

    model: MinimumDerivative
    axes: tuple[int, ...]

    @property
    def jets(self) -> int:
        """Number of coordinates of a knot: order times axes."""
        return self.model.order * len(self.axes)

    @property
    def interior(self) -> int:
        """Number of inner coordinates of a segment."""
        return (self.model.degree + 1 - 2 * self.model.order) * len(self.axes)

    @cached_property
    def origin(self) -> Floats:
        """Origin of the positions, in the middle of waypoints and corridor, m.

        The origin affects only the number of accurate digits of a position.
        """
        model = self.model
        tables = [model.waypoints]
        tables += [t for t in (model.corridor_lower, model.corridor_upper) if t is not None]
        table = np.concatenate(tables)[:, list(self.axes)]
        low = np.where(np.isfinite(table), table, np.inf).min(axis=0)
        high = np.where(np.isfinite(table), table, -np.inf).max(axis=0)
        middle: Floats = np.where(np.isfinite(low) & np.isfinite(high), 0.5 * (low + high), 0.0)
        return middle

    @property
    def knot_times(self) -> Floats:
        """Time that scales the derivatives at each knot, shape (knots,)."""
        return knot_times(self.model.durations)

    def start(self) -> tuple[NDArray[np.bool_], Floats]:
        """Return the mask of fixed knot coordinates, and their values (0 for free coordinates)."""
        model, r = self.model, self.model.order
        fixed = np.full((model.times.size, r, model.dimensions), np.inf)
        rows = min(r, model.conditions.shape[1])
        fixed[:, :rows] = model.conditions[:, :rows]
        fixed = fixed[:, :, list(self.axes)]
        value = np.where(np.isfinite(fixed), fixed, 0.0)
        value[:, 0] -= np.where(np.isfinite(fixed[:, 0]), self.origin, 0.0)
        value *= (self.knot_times[:, None] ** np.arange(r))[:, :, None]
        shape = (model.times.size, self.jets)
        known = np.moveaxis(np.isfinite(fixed), 1, 2).reshape(shape)
        return np.ascontiguousarray(known), np.ascontiguousarray(
            np.moveaxis(value, 1, 2).reshape(shape)
        )

    def _column_scales(self) -> Floats:
        """Return the factors from coordinates to unit derivatives, shape (segments, degree + 1)."""
        model, r = self.model, self.model.order
        orders = np.arange(r)
        scales = np.ones((model.segments, model.degree + 1))
        ratio = model.durations / self.knot_times[:-1]
        scales[:, :r] = ratio[:, None] ** orders
        scales[:, r : 2 * r] = (model.durations / self.knot_times[1:])[:, None] ** orders
        return scales

    def _spread(self, rows: Floats, axis: int) -> Floats:
        """Embed rows of one axis, (…, degree + 1), in the local coordinates of the group."""
        r = self.model.order
        n, extra = self.jets, self.model.degree + 1 - 2 * r
        wide = np.zeros((*rows.shape[:-1], 2 * n + self.interior))
        wide[..., axis * r : (axis + 1) * r] = rows[..., :r]
        wide[..., n + axis * r : n + (axis + 1) * r] = rows[..., r : 2 * r]
        if extra:
            wide[..., 2 * n + axis * extra : 2 * n + (axis + 1) * extra] = rows[..., 2 * r :]
        return wide

    def cost(self) -> Floats:
        """Return rows C with J = Σ |C local|², shape (segments, c, width)."""
        model = self.model
        scales = self._column_scales()
        parts = []
        for order, weight in enumerate(model.order_weights, start=1):
            if weight:
                unit = unit_cost(model.order, model.degree, order)
                size = np.sqrt(weight * model.durations ** (1.0 - 2 * order))
                rows = size[:, None, None] * unit * scales[:, None, :]
                parts += [self._spread(rows, axis) for axis in range(len(self.axes))]
        return np.ascontiguousarray(np.concatenate(parts, axis=1))

    def rows(self, held: Instants, *, slope: bool = False) -> tuple[Floats, Floats, Floats, Floats]:
        """Return normalised rows of the bounds at `held`, with lower and upper bounds and factors.

                The largest entry of a row is 1. The last result is the factor of each row. With `slope`, the
        rows are the derivatives in s of the bounded values.
        """
        model = self.model
        scales = self._column_scales()
        rows = np.zeros((held.s.size, 2 * self.jets + self.interior))
        lower, upper = np.full(held.s.size, -np.inf), np.full(held.s.size, np.inf)
        basis = hermite_basis(model.order, model.degree)
        position = {axis: at for at, axis in enumerate(self.axes)}
        for number, bound in enumerate(model.bounds):
            for axis in self.axes:
                take = np.flatnonzero((held.bound == number) & (held.axis == axis))
                segment = held.segment[take]
                unit = power_rows(held.s[take], bound.derivative + slope, model.degree) @ basis
                unit *= (
                    scales[segment]
                    * (model.durations[segment] ** -float(bound.derivative))[:, None]
                )
                rows[take] = self._spread(unit, position[axis])
                shift = self.origin[position[axis]] if bound.derivative == 0 else 0.0
                lower[take] = bound.lower[segment, axis] - shift
                upper[take] = bound.upper[segment, axis] - shift
        spaces = model.halfspaces
        if spaces is not None:
            take = np.flatnonzero(held.bound == len(model.bounds))
            unit = power_rows(held.s[take], int(slope), model.degree) @ basis
            unit *= scales[held.segment[take]]
            for at, axis in enumerate(self.axes):
                normal = spaces.normals[held.axis[take], axis]
                rows[take] += self._spread(unit * normal[:, None], at)
            normals = spaces.normals[held.axis[take]][:, list(self.axes)]
            upper[take] = spaces.offsets[held.axis[take]] - normals @ self.origin
        largest = np.abs(rows).max(axis=1, initial=0.0)
        share = 1.0 / np.where(largest > 0, largest, 1.0)
        return rows * share[:, None], lower * share, upper * share, share

    def powers(self, knots: Floats, inner: Floats) -> Floats:
        """Return ascending powers of s, shape (segments, degree + 1, axes of the group)."""
        model, r = self.model, self.model.order
        basis = hermite_basis(r, model.degree)
        scales = self._column_scales()
        group = len(self.axes)
        extra = model.degree + 1 - 2 * r
        jets = knots.reshape(-1, group, r)
        # Positions are relative to the segment's start. Far from the origin, the Hermite functions
        # would otherwise subtract large numbers.
        start = jets[:-1, :, 0].copy()
        before, after = jets[:-1].copy(), jets[1:].copy()
        before[:, :, 0] = 0.0
        after[:, :, 0] -= start
        local = np.concatenate([before, after, inner.reshape(len(start), group, extra)], axis=2)
        powers = np.moveaxis((local * scales[:, None, :]) @ basis.T, 1, 2)
        powers[:, 0] += start + self.origin
        return powers

    def first_instants(self, samples: int) -> Instants:
        """Return the initial instants at which bounds are imposed, sorted by segment."""
        model = self.model
        return first_instants(model, samples, model.order - 1, self.axes).sorted()[0]

    def polynomials(self, powers: Floats) -> tuple[Floats, Limits, Instants]:
        """Return the bounded values as polynomials in s, with bounds, scales and owners.

        Derivatives have a lower degree and are padded with zeros to a common width.
        """
        model = self.model
        position = {axis: at for at, axis in enumerate(self.axes)}
        none = np.empty(0, np.int64)
        rows: list[Floats] = [np.empty((0, model.degree + 1))]
        limits: list[tuple[Floats, ...]] = [(np.empty(0),) * 4]
        parts: list[tuple[Ints, ...]] = [(none, none, none)]
        for number, bound in enumerate(model.bounds):
            j = bound.derivative
            if j > model.degree:
                continue
            factors = factorials(model.degree, j)
            low_scale, high_scale = model.bound_scale(bound)
            for axis in self.axes:
                finite = np.isfinite(bound.lower[:, axis]) | np.isfinite(bound.upper[:, axis])
                segment = np.flatnonzero(finite)
                padded = np.zeros((segment.size, model.degree + 1))
                inner = powers[segment, j:, position[axis]] * factors
                scale = (model.durations[segment] ** -float(j))[:, None]
                padded[:, : model.degree + 1 - j] = inner * scale
                rows.append(padded)
                tables = (bound.lower, bound.upper, low_scale, high_scale)
                limits.append(tuple(table[segment, axis] for table in tables))
                parts.append((np.full(segment.size, number), segment, np.full(segment.size, axis)))
        spaces = model.halfspaces
        if spaces is not None:
            rows.append(np.einsum("hpd,hd->hp", powers[spaces.segments], spaces.normals))
            size = np.full(spaces.segments.size, model.position_scale.max())
            limits.append((np.full(size.size, -np.inf), spaces.offsets, size, size))
            which = np.arange(spaces.segments.size)
            parts.append((np.full(which.size, len(model.bounds)), spaces.segments, which))
        owners = [np.concatenate(c).astype(np.int64) for c in zip(*parts, strict=True)]
        held = Instants(owners[0], owners[1], owners[2], np.zeros(owners[0].size))
        low, high, low_size, high_size = (np.concatenate(c) for c in zip(*limits, strict=True))
        return (
            np.ascontiguousarray(np.concatenate(rows)),
            (low, high, low_size, high_size),
            held,
        )


def chains(model: MinimumDerivative) -> tuple[Chain, ...]:
    """Return the groups of axes of `model`: one per axis, or a single one with half-spaces."""
    if model.halfspaces is not None:
        return (Chain(model, tuple(range(model.dimensions))),)
    return tuple(Chain(model, (axis,)) for axis in range(model.dimensions))
