"""Trajectory problem as a chain of segments, for one group of coupled axes.

Without polytopes every axis is a separate chain. Half-spaces couple all axes. The unknowns are the
derivatives at the knots, multiplied by the time of the knot to the power of their order, and the
inner coefficients of a segment if the degree is above ``2 r - 1``. The durations may vary.

At fixed derivatives at the knots and fixed instants s, the cost ``Σ w_j T^(1-2j) |U_j y|²`` and a
bounded derivative ``T^-j u'y`` depend on the durations through T and ``y_i = T^i d_i``. Each row is
therefore a scaled row of a segment of 1 s.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.minimum_snap.formulations.hermite import hermite_basis, knot_times
from ...models.minimum_snap.formulations.instants import Instants, Limits, first_instants
from ...models.minimum_snap.formulations.piecewise import power_rows
from ...models.minimum_snap.model import MinimumDerivative
from ...models.minimum_snap.polynomials import gauss_legendre
from .interior_kernels import Iterate, Posed

__all__ = ["Chain", "Imposed", "chains", "unit_cost"]

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


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


class Imposed(NamedTuple):
    """Bounds at instants, sorted by segment: the bounded value is ``T^-derivative unit'y``."""

    #: Coefficients in the local coordinates of a segment of 1 s, shape (Q, width).
    unit: Floats
    #: Bound of each instant, relative to the origin of the chain.
    limits: Limits
    #: Mask of the finite lower and upper bounds, shape (2, Q).
    bounded: Flags
    #: Scales of violations from below and from above, shape (2, Q).
    scale: Floats


@dataclass(frozen=True, eq=False)
class Chain:
    """Group of coupled axes."""

    #: Problem at given times; for free times, the problem with segments of 1 s.
    model: MinimumDerivative
    #: Indices of the axes in the group.
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
    def limits(self) -> Limits:
        """Bounds of the group, with directions in its axes."""
        limits = Limits.of(self.model, self.axes)
        return limits._replace(direction=limits.direction[:, list(self.axes)])

    @cached_property
    def origin(self) -> Floats:
        """Origin of the positions, in the middle of waypoints and corridor, m.

        The origin affects only the number of accurate digits of a position.
        """
        low, high = (side[list(self.axes)] for side in self.model.reach)
        middle: Floats = np.where(np.isfinite(low), 0.5 * (low + high), 0.0)
        return middle

    @cached_property
    def _conditions(self) -> tuple[Flags, Floats]:
        """Mask of the fixed derivatives at the knots, and their values (0 for free ones)."""
        table = self.model.jets[:, :, list(self.axes)].swapaxes(1, 2).copy()
        table[..., 0] -= self.origin
        values = table.reshape(len(table), self.jets)
        fixed = np.isfinite(values)
        return fixed, np.where(fixed, values, 0.0)

    def _spread(self, rows: Floats, mix: Floats) -> Floats:
        """Embed rows of one axis, shape (N, degree + 1), times `mix`, shape (N, axes), in all axes."""
        r = self.model.order
        wide = mix[:, :, None] * rows[:, None, :]
        parts = wide[..., :r], wide[..., r : 2 * r], wide[..., 2 * r :]
        return np.concatenate(
            [part.reshape(len(rows), part.shape[1] * part.shape[2]) for part in parts], axis=1
        )

    @cached_property
    def _orders(self) -> Floats:
        """Order of the derivative of each coordinate of a knot, shape (n,)."""
        return np.tile(np.arange(float(self.model.order)), len(self.axes))

    @cached_property
    def _cost(self) -> tuple[Floats, Floats]:
        """Rows with J = Σ T^(1-2j) |row y|², shape (c, width), and their orders j."""
        model, axes = self.model, np.eye(len(self.axes))
        parts, orders = [np.empty((0, 2 * self.jets + self.interior))], [np.empty(0)]
        for j, weight in enumerate(model.order_weights, start=1):
            if weight:
                rows = np.sqrt(weight) * unit_cost(model.order, model.degree, j)
                parts += [self._spread(rows, np.tile(axis, (len(rows), 1))) for axis in axes]
                orders.append(np.full(len(rows) * len(axes), float(j)))
        return np.concatenate(parts), np.concatenate(orders)

    def imposed(self, held: Instants, *, slope: bool = False) -> Imposed:
        """Return the bounds at instants; with `slope`, the derivatives in s of the bounded values."""
        limits, degree = self.limits.taken(held.row), self.model.degree
        powers = np.empty((held.s.size, degree + 1))
        for j in np.unique(limits.derivative).tolist():
            rows = limits.derivative == j
            powers[rows] = power_rows(held.s[rows], j + slope, degree)
        unit = powers @ hermite_basis(self.model.order, degree)
        shift = np.where(limits.derivative == 0, limits.direction @ self.origin, 0.0)
        limits = limits._replace(lower=limits.lower - shift, upper=limits.upper - shift)
        bounded = np.isfinite(np.stack([limits.lower, limits.upper]))
        scale = np.stack([limits.low_scale, limits.high_scale])
        return Imposed(self._spread(unit, limits.direction), limits, bounded, scale)

    # -- at given durations ----------------------------------------------------------------------

    def units(self, durations: Floats) -> Floats:
        """Return the factors from derivatives at the knots to coordinates, shape (knots, n)."""
        factors: Floats = knot_times(durations)[:, None] ** self._orders
        return factors

    def start(self, durations: Floats) -> tuple[Flags, Floats]:
        """Return the mask of fixed knot coordinates, and their values (0 for free coordinates)."""
        fixed, values = self._conditions
        return fixed, values * self.units(durations)

    def _columns(self, durations: Floats) -> Floats:
        """Return the factors from local coordinates to y, shape (segments, width)."""
        knots = knot_times(durations)
        ends = [(durations / at)[:, None] ** self._orders for at in (knots[:-1], knots[1:])]
        return np.concatenate([*ends, np.ones((durations.size, self.interior))], axis=1)

    def cost(self, durations: Floats) -> Floats:
        """Return rows C with J = Σ |C local|², shape (segments, c, width)."""
        unit, orders = self._cost
        rows: Floats = (durations[:, None] ** (0.5 - orders))[:, :, None] * unit
        rows *= self._columns(durations)[:, None]
        return rows

    def rows(self, durations: Floats, imposed: Imposed) -> tuple[Floats, Floats]:
        """Return the bound rows, normalised to a largest entry of 1, and their factors."""
        segment, derivative = imposed.limits.segment, imposed.limits.derivative
        rows = imposed.unit * self._columns(durations)[segment]
        rows *= (durations[segment] ** -derivative.astype(float))[:, None]
        largest = np.abs(rows).max(axis=1, initial=0.0)
        share = 1.0 / np.where(largest > 0, largest, 1.0)
        return rows * share[:, None], share

    def posed(self, durations: Floats, imposed: Imposed) -> Posed:
        """Return the program with the bounds `imposed`. The objective J is twice its cost."""
        rows, share = self.rows(durations, imposed)
        limits = imposed.limits
        start = np.searchsorted(limits.segment, np.arange(durations.size + 1)).astype(np.int64)
        edge = np.stack([limits.lower, -limits.upper]) * share
        return Posed(self.cost(durations), rows, start, edge, self._conditions[0], share)

    def _local(self, durations: Floats, knots: Floats, inner: Floats) -> Floats:
        """Return y, shape (segments, width)."""
        local = np.concatenate([knots[:-1], knots[1:], inner], axis=1)
        local *= self._columns(durations)
        return local

    def powers(self, durations: Floats, knots: Floats, inner: Floats) -> Floats:
        """Return ascending powers of s, shape (segments, degree + 1, axes of the group)."""
        n, r, shape = self.jets, self.model.order, (durations.size, len(self.axes), -1)
        local = self._local(durations, knots, inner)
        before, after = local[:, :n].reshape(shape), local[:, n : 2 * n].reshape(shape)
        # Positions are relative to the segment's start. Far from the origin, the Hermite functions
        # would otherwise subtract large numbers.
        start = before[:, :, 0].copy()
        after[:, :, 0] -= start
        before[:, :, 0] = 0.0
        wide = np.concatenate([before, after, local[:, 2 * n :].reshape(shape)], axis=2)
        powers = np.moveaxis(wide @ hermite_basis(r, self.model.degree).T, 1, 2)
        powers[:, 0] += start + self.origin
        return powers

    def slope(
        self, durations: Floats, imposed: Imposed, now: Iterate, pull: Floats
    ) -> tuple[float, Floats]:
        """Return J and the derivatives of the Lagrangian by the durations at fixed derivatives.

        At optimal derivatives, they are the slope of the optimal value (envelope theorem). `pull` is
        the multiplier of the upper bound less that of the lower one, in units of J per unit.
        """
        unit, orders = self._cost
        y = self._local(durations, now.knots, now.inner)
        # T dy_i/dT = i y_i at a fixed derivative, and 0 for inner coordinates.
        moved = y * np.concatenate([self._orders, self._orders, np.zeros(self.interior)])
        value, rate = y @ unit.T, moved @ unit.T
        power = 1.0 - 2.0 * orders
        weighted = durations[:, None] ** power * value
        slope = (weighted * (power * value + 2.0 * rate)).sum(axis=1)
        segment, derivative = imposed.limits.segment, imposed.limits.derivative.astype(float)
        change = (imposed.unit * (moved[segment] - derivative[:, None] * y[segment])).sum(axis=1)
        force = pull * durations[segment] ** -derivative * change
        slope += np.bincount(segment, force, minlength=durations.size)
        return float((weighted * value).sum()), slope / durations

    # -- bounds ----------------------------------------------------------------------------------

    def first_instants(self, samples: int) -> Instants:
        """Return the initial instants at which bounds are imposed, sorted by segment."""
        return first_instants(self.model, self.limits, samples, self.model.order - 1)


def chains(model: MinimumDerivative) -> tuple[Chain, ...]:
    """Return the groups of axes of `model`: one per axis, or a single one with half-spaces."""
    if model.halfspaces is not None:
        return (Chain(model, tuple(range(model.dimensions))),)
    return tuple(Chain(model, (axis,)) for axis in range(model.dimensions))
