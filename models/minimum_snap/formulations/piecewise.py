"""Common parts of the quadratic programs of a piecewise polynomial: knots, bounds, refinement.

Corridor and limits apply at every instant, which a finite number of rows cannot express. The
program imposes them at some instants of each segment and is therefore a relaxation: its optimum is
a lower bound, and its infeasibility proves that the model is infeasible.
:meth:`PiecewiseFormulation.refined` adds the instants of the largest violations (the exchange
method for semi-infinite programs) until the solution satisfies the bounds.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, NamedTuple, Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ....errors import InvalidData, UnsupportedFormulation, UnsupportedOption, show
from ...formulation import Formulation
from ...programs.blocks import Block
from ...programs.linear import QuadraticProgram
from ..bounds import derivative_name, derivative_unit
from ..model import MinimumDerivative
from ..polynomials import horner
from ..trajectory import Trajectory
from .instants import NOWHERE, Instants, Limits, first_instants, outside

__all__ = ["Group", "PiecewiseFormulation", "Rows", "power_rows"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Largest number of refinement rounds. The verification reports any remaining violation.
ROUNDS = 25
#: Largest violation between the instants, as a share of the tolerance. It is below rounding.
SETTLED = 5e-4


class Rows(NamedTuple):
    """Rows under construction: entries in local coordinates, bounds, and places for reports."""

    matrix: sp.csr_array
    lower: Floats
    upper: Floats
    places: Ints


class Group(NamedTuple):
    """Rows of the same kind with their labels."""

    name: str
    equation: str
    template: str
    unit: str
    rows: Rows


def power_rows(s: Floats, derivative: int, degree: int) -> Floats:
    """Return the derivatives of 1, s, s², … at `s`, shape (len(s), degree + 1)."""
    rows = np.zeros((s.size, degree + 1))
    for power in range(derivative, degree + 1):
        factor = np.prod(np.arange(power - derivative + 1, power + 1, dtype=float))
        rows[:, power] = factor * s ** (power - derivative)
    return rows


@dataclass(frozen=True, eq=False)
class PiecewiseFormulation(Formulation[MinimumDerivative, Trajectory]):
    """Base of the formulations with one vector of coefficients per segment and axis.

    Parameters
    ----------
    model : MinimumDerivative
        Problem at given times.
    samples : int
        Initial instants per segment at which corridor and limits are imposed, 2 to 1000; 5 by
        default. Refinement adds more as needed. Prefer few: if a limit is active along a whole
        segment, more rows than the polynomial has coefficients are linearly dependent.

    Raises
    ------
    UnsupportedOption
        `samples` is not an integer in [2, 1000].
    """

    samples: int = 5
    instants: Instants = field(default=NOWHERE, init=False, repr=False)
    rounds: int = field(default=0, init=False, repr=False)

    program_type = QuadraticProgram
    # The terms of a row may be several times larger than their sum.
    precision = 0.25
    #: Equation of the paper for the rows of continuity.
    continuity_equation: ClassVar[str] = "25"

    def __post_init__(self) -> None:
        if self.model.vehicle is not None:
            raise UnsupportedFormulation("the limits of a vehicle need formulation 'cones'")
        if self.model.gates:
            raise UnsupportedFormulation("gates need formulation 'cones'")
        if isinstance(self.samples, bool) or not isinstance(self.samples, int | np.integer):
            raise UnsupportedOption(f"samples must be a whole number, got {show(self.samples)}")
        if not 2 <= self.samples <= 1000:
            raise UnsupportedOption(f"samples must be in [2, 1000], got {show(self.samples)}")

    # -- the basis -------------------------------------------------------------------------------

    @abstractmethod
    def basis_rows(self, segments: Ints, s: Floats, derivative: int) -> Floats:
        """Return the derivatives of the basis functions in time, one row per instant.

        Parameters
        ----------
        segments : ndarray of int, shape (instants,)
            Segment of each instant.
        s : ndarray, shape (instants,)
            Scaled time of each instant, in [0, 1].
        derivative : int
            Order of the derivative.

        Returns
        -------
        ndarray, shape (instants, degree + 1)
            Derivatives, 1/s^derivative.
        """

    @abstractmethod
    def gram(self) -> Floats:
        """Return the symmetric blocks Q_k of J = Σ p'Q_k p, shape (segments, n, n)."""

    @abstractmethod
    def to_powers(self, local: Floats) -> Floats:
        """Convert coefficients, shape (segments, dimensions, n), to ascending powers of s."""

    @abstractmethod
    def from_powers(self, powers: Floats) -> Floats:
        """Convert ascending powers of s to coefficients: the inverse of :meth:`to_powers`."""

    # -- the program -----------------------------------------------------------------------------

    def build(self) -> QuadraticProgram:
        """Return the quadratic program."""
        model = self.model
        shape = model.segments, model.dimensions, model.degree + 1
        places = np.indices(shape).reshape(3, -1).T
        size, template = len(places), "{2} of segment {0}, axis {1}"
        columns = Block("coefficient", "5", 0, size, template, places)
        groups = [*self._knot_rows(), *self._bound_rows()]
        return self._assembled(groups, self._hessian(), np.zeros(size), columns)

    def _assembled(
        self,
        groups: list[Group],
        hessian: sp.csr_array,
        cost: Floats,
        columns: Block,
        offset: float = 0.0,
    ) -> QuadraticProgram:
        """Return the program with these rows and unbounded columns."""
        blocks, parts, at, size = [], [], 0, cost.size
        for name, equation, template, unit, rows in groups:
            count = rows.lower.size
            if count:
                blocks.append(Block(name, equation, at, count, template, rows.places, unit))
                parts.append(rows)
                at += count
        matrix = sp.vstack([p.matrix for p in parts]) if parts else sp.csr_array((0, size))
        return QuadraticProgram(
            hessian=hessian,
            cost=cost,
            matrix=sp.csr_array(matrix),
            row_lower=np.concatenate([p.lower for p in parts] or [np.empty(0)]),
            row_upper=np.concatenate([p.upper for p in parts] or [np.empty(0)]),
            column_lower=np.full(size, -np.inf),
            column_upper=np.full(size, np.inf),
            offset=offset,
            columns=(columns,) if size else (),
            rows=tuple(blocks),
            name=f"{self.model.name or self.model.kind}, {self.name}",
        )

    def _hessian(self) -> sp.csr_array:
        model = self.model
        blocks = np.repeat(2.0 * self.gram(), model.dimensions, axis=0)
        count, size = blocks.shape[0], blocks.shape[1]
        start = np.arange(count)[:, None, None] * size
        rows = np.broadcast_to(start + np.arange(size)[None, :, None], blocks.shape)
        columns = np.broadcast_to(start + np.arange(size)[None, None, :], blocks.shape)
        entries = (blocks.ravel(), (rows.ravel(), columns.ravel()))
        return sp.csr_array(sp.coo_array(entries, shape=(count * size,) * 2))

    def _knot_rows(self) -> Iterator[Group]:
        model, conditions = self.model, self.model.conditions
        knot_place = "at knot {0}, axis {1}"
        for order in range(min(conditions.shape[1], self.highest_fixed + 1)):
            fixed = np.isfinite(conditions[:, order])
            name, unit = derivative_name(order), derivative_unit(order)
            ends = np.zeros_like(fixed)
            ends[[0, -1]] = order > 0
            inner = (f"{name} at knots", "") if order else ("waypoints", "24")
            for take, labels in (
                (fixed & ends, (f"{name} at the ends", "23")),
                (fixed & ~ends, inner),
            ):
                yield Group(*labels, knot_place, unit, self._fixed(order, take))
        for order in range(self.continuity + 1):
            title = f"continuity of {derivative_name(order)}"
            yield Group(title, self.continuity_equation, knot_place, "", self._continuous(order))
        yield from self._joint_rows(range(model.joint_order + 1))

    def _joint_rows(self, orders: Iterable[int]) -> Iterator[Group]:
        """Yield the rows that make derivatives equal at both ends of a lap."""
        for order in orders:
            title = f"joint of {derivative_name(order)}"
            yield Group(title, "", "at knot {0}, axis {1}", "", self._continuous(order, joint=True))

    def _bound_rows(self) -> Iterator[Group]:
        model, place = self.model, "on segment {0}, axis {1}"
        for number, bound in enumerate(model.bounds):
            unit = derivative_unit(bound.derivative)
            yield Group(bound.name, "", place, unit, self._bounded(number))
        if model.halfspaces is not None:
            rows = self._bounded(len(model.bounds))
            yield Group("polytope", "", "on segment {0}, half-space {1}", "m", rows)

    @property
    def continuity(self) -> int:
        """Highest order of a derivative that the rows keep continuous."""
        return self.model.continuity

    @property
    def highest_fixed(self) -> int:
        """Highest order of a derivative that the rows fix at knots."""
        return self.model.highest_fixed

    def columns(self, segment: Ints, axis: Ints | int) -> Ints:
        """Return the indices of the coefficients of segments on an axis, shape (N, degree + 1)."""
        size = self.model.degree + 1
        first = (segment * self.model.dimensions + axis) * size
        columns: Ints = first[:, None] + np.arange(size)
        return columns

    def _sparse(self, *parts: tuple[Ints, Floats]) -> sp.csr_array:
        """Return sparse rows from adjacent blocks of column indices and values."""
        columns = np.concatenate([c for c, _ in parts], axis=1)
        values = np.concatenate([v for _, v in parts], axis=1)
        size = self.model.segments * self.model.dimensions * (self.model.degree + 1)
        start = np.arange(columns.shape[0] + 1) * columns.shape[1]
        return sp.csr_array(
            (values.ravel(), columns.ravel(), start), shape=(columns.shape[0], size)
        )

    def _scaled(self, matrix: sp.csr_array, lower: Floats, upper: Floats, index: Ints) -> Rows:
        """Scale rows to a largest entry of 1. Derivatives of short segments are huge."""
        size = abs(matrix).max(axis=1).toarray().ravel() if matrix.shape[0] else np.empty(0)
        share = 1.0 / np.where(size > 0, size, 1.0)
        return Rows(sp.csr_array(matrix * share[:, None]), lower * share, upper * share, index)

    def _fixed(self, order: int, take: NDArray[np.bool_]) -> Rows:
        """Return the rows that fix a derivative at the adjacent segment ends of knots."""
        model = self.model
        knots, axes = (a.astype(np.int64) for a in np.nonzero(take))
        value = model.conditions[knots, order, axes]
        parts = []
        # If other rows make the derivative continuous, one side is enough.
        twice = order > self.continuity
        for side in (0, 1):
            segment = knots - side
            exists = (segment >= 0) & (segment < model.segments)
            if side and not twice:
                exists &= knots == model.segments
            rows = self.basis_rows(segment[exists], np.full(int(exists.sum()), float(side)), order)
            matrix = self._sparse((self.columns(segment[exists], axes[exists]), rows))
            index = np.column_stack([knots[exists], axes[exists]])
            parts.append(self._scaled(matrix, value[exists], value[exists], index))
        matrices, *columns = zip(*parts, strict=True)
        return Rows(sp.csr_array(sp.vstack(matrices)), *map(np.concatenate, columns))

    def _continuous(self, order: int, joint: bool = False) -> Rows:
        """Return the rows that make a derivative continuous at inner knots, or at the joint of a lap."""
        model = self.model
        count = 1 if joint else model.segments - 1
        knots, axes = np.indices((count, model.dimensions)).reshape(2, -1)
        knots = knots + (model.segments if joint else 1)
        if joint and order < model.conditions.shape[1]:
            # Values that are fixed at both ends need no row.
            fixed = np.isfinite(model.conditions[[0, -1], order])
            free = np.asarray(~fixed.all(axis=0))
            knots, axes = knots[free[axes]], axes[free[axes]]
        next_segment = knots % model.segments
        before = self.basis_rows(knots - 1, np.ones(knots.size), order)
        after = self.basis_rows(next_segment, np.zeros(knots.size), order)
        matrix = self._sparse(
            (self.columns(knots - 1, axes), before), (self.columns(next_segment, axes), -after)
        )
        zero = np.zeros(knots.size)
        return self._scaled(matrix, zero, zero, np.column_stack([knots, axes]))

    # -- corridor and limits ---------------------------------------------------------------------

    @cached_property
    def limits(self) -> Limits:
        """Bounds of the model."""
        return Limits.of(self.model)

    def held(self) -> Instants:
        """Return all instants: the initial ones of every bounded segment and the added ones."""
        first = first_instants(self.model, self.limits, self.samples, self.continuity)
        return first.joined(self.instants).sorted()[0]

    def held_of(self, number: int) -> tuple[Limits, Floats]:
        """Return the bounds with index `number` at each of their instants, and the scaled times."""
        held = self.held()
        take = np.flatnonzero(self.limits.bound[held.row] == number)
        return self.limits.taken(held.row[take]), held.s[take]

    def _bounded(self, number: int) -> Rows:
        """Return the rows of a bound, or of the half-spaces."""
        entries, s = self.held_of(number)
        derivative = int(entries.derivative.max(initial=0))
        values = self.basis_rows(entries.segment, s, derivative)
        if number < len(self.model.bounds):
            matrix = self._sparse((self.columns(entries.segment, entries.axis), values))
        else:
            parts = [
                (self.columns(entries.segment, axis), values * entries.direction[:, axis, None])
                for axis in range(self.model.dimensions)
            ]
            matrix = self._sparse(*parts)
        places = np.column_stack([entries.segment, entries.axis])
        return self._scaled(matrix, entries.lower, entries.upper, places)

    def refined(
        self, point: NDArray[np.float64], tolerance: float, duals: NDArray[np.float64] | None = None
    ) -> Self | None:
        """Return the formulation with the instants at which `point` violates bounds; None at the end.

        The parameters are those of the base; `duals` are not used.
        """
        if not self.model.bounded or self.rounds >= ROUNDS:
            return None
        plan, limits, held = self.decode(point), self.limits, self.held()
        polynomials = limits.polynomials(plan.coefficients, plan.durations)
        value = horner(polynomials[held.row][:, :, None], held.s[:, None])[:, 0]
        # The violation at the instants measures the inaccuracy of the solver, which additional rows
        # cannot reduce.
        worst = np.zeros(len(self.model.bounds) + 1)
        np.maximum.at(worst, limits.bound[held.row], limits.taken(held.row).violation(value))
        threshold = np.maximum(SETTLED * tolerance, 2.0 * worst)[limits.bound]
        added = held.fresh(outside(polynomials, limits, threshold)[0])
        if not added.s.size:
            return None
        return self._changed(instants=self.instants.joined(added), rounds=self.rounds + 1)

    # -- plans -----------------------------------------------------------------------------------

    def encode(self, plan: Trajectory) -> NDArray[np.float64]:
        """Return the coefficients of `plan` in this basis."""
        model = self.model
        model.require_shape(plan)
        if plan.degree > model.degree:
            raise InvalidData(
                f"plan has degree {plan.degree}, the model allows {model.degree}", field="plan"
            )
        powers = np.zeros((model.segments, model.dimensions, model.degree + 1))
        powers[:, :, : plan.degree + 1] = np.moveaxis(plan.coefficients, 1, 2)
        return self.from_powers(powers).ravel()

    def decode(self, point: NDArray[np.float64]) -> Trajectory:
        """Return the trajectory with these coefficients."""
        model = self.model
        local = np.asarray(point, float).reshape(model.segments, model.dimensions, -1)
        return model.with_yaw(Trajectory(model.times, np.moveaxis(self.to_powers(local), 1, 2)))
