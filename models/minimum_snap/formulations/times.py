"""Nonlinear program whose columns are the durations and the derivatives at the knots.

Source: Richter, Bry and Roy, "Polynomial trajectory planning for aggressive quadrotor flight in
dense indoor environments", ISRR 2013: unknown derivatives at the knots and a cost of time. The
paper optimises the times in an outer loop around a quadratic program. This program optimises both
simultaneously.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ....errors import UnsupportedFormulation
from ...formulation import Formulation
from ...programs.blocks import Block
from ...programs.compiled import require_casadi
from ...programs.nonlinear import NonlinearProgram
from ..bounds import derivative_unit
from ..time_allocation import TimeAllocation
from ..trajectory import Trajectory
from .bases import UnitBasisFormulation
from .hermite import HermiteFormulation, knot_times
from .instants import NOWHERE, Instants
from .piecewise import power_rows

__all__ = ["TimesFormulation"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Minimum length of a segment in the guess, as a share of the mean length.
LEAST = 1e-2


class _Rows(NamedTuple):
    """Block of rows: labels, arguments of its kind, places, coefficients and bounds."""

    name: str
    unit: str
    place: str
    derivative: int
    segment: Ints
    which: Ints
    entries: Ints
    constants: Floats
    lower: Floats
    upper: Floats


@dataclass(frozen=True, eq=False)
class TimesFormulation(Formulation[TimeAllocation, Trajectory]):
    """Nonlinear program in log durations and free derivatives at the knots.

    Fixed values are substituted. Logarithms keep durations positive without a bound and were
    measured to reduce Ipopt's time by a fifth to two fifths, compared with durations. Corridor and
    limits are imposed at the initial instants of every segment, in its scaled time, and at
    violations of a solution (the exchange method). The program therefore excludes no plan. It is
    not convex, so that a solver returns a local optimum without a lower bound, and the formulation
    is not marked as a relaxation.

    Parameters
    ----------
    model : TimeAllocation
        Problem with free times.
    samples : int
        Initial instants per segment at which corridor and limits are imposed, 2 to 1000.

    Raises
    ------
    UnsupportedFormulation
        The continuity or a fixed derivative is above r - 1, the highest derivative in the columns.
    UnsupportedOption
        `samples` is not an integer in [2, 1000].
    """

    samples: int = 5
    instants: Instants = field(default=NOWHERE, init=False, repr=False)
    rounds: int = field(default=0, init=False, repr=False)
    near: Trajectory | None = field(default=None, init=False, repr=False)

    name = "times"
    summary = "the durations and the free derivatives at the knots, as a nonlinear program"
    program_type = NonlinearProgram
    relaxes = False
    # The terms of a row may be several times larger than their sum.
    precision = 0.25

    def __post_init__(self) -> None:
        if self.model.beyond_times:
            raise UnsupportedFormulation(
                f"formulation {self.name!r} does not cover {self.model.beyond_times}"
            )
        require_casadi(f"formulation {self.name!r}")
        self._at(self.model.unit.times)

    def _at(self, times: Floats) -> HermiteFormulation:
        """Return the quadratic program at given times, with the same instants."""
        at = HermiteFormulation(self.model.at(times), samples=self.samples)
        return at._changed(instants=self.instants, rounds=self.rounds)

    @cached_property
    def _unit(self) -> HermiteFormulation:
        """Quadratic program of segments of 1 s, which defines fixed, shared and free entries."""
        return self._at(self.model.unit.times)

    @cached_property
    def _shift(self) -> Floats:
        """Origin of each local entry: the first waypoint of the axis for positions, else 0.

        Far from the coordinate origin, position differences would lose digits.
        """
        r, model = self.model.order, self.model
        shift = np.zeros((model.segments, model.dimensions, model.degree + 1))
        shift[:, :, 0] = shift[:, :, r] = self._origin
        return shift.ravel()

    @cached_property
    def _origin(self) -> Floats:
        known = np.isfinite(self.model.waypoints)
        first = self.model.waypoints[known.argmax(axis=0), np.arange(self.model.dimensions)]
        return np.where(known.any(axis=0), first, 0.0)

    # -- the program -----------------------------------------------------------------------------

    def build(self) -> NonlinearProgram:
        """Return the nonlinear program with its exact derivatives."""
        from .terms import Terms, assemble, bounded, cost

        model, count, size = self.model, self.model.segments, self.model.degree + 1
        reduction, guess = self._unit.reduction, self.guess
        segment, axis = np.indices((count, model.dimensions)).reshape(2, -1)
        kind = cost(model.order_weights, self._unit.powers, model.order)
        groups = [
            Terms(
                kind, segment, self._unit.columns(segment, axis), np.empty((segment.size, 0)), None
            )
        ]
        lower, upper, blocks, at = [], [], [], 0
        for rows in self._all_rows():
            number = rows.segment.size
            if number:
                axes = rows.entries.shape[1] // size
                kind = bounded(size, model.order, rows.derivative, axes)
                row = at + np.arange(number)
                groups.append(Terms(kind, rows.segment, rows.entries, rows.constants, row))
                index = np.column_stack([rows.segment, rows.which])
                blocks.append(Block(rows.name, "", at, number, rows.place, index, rows.unit))
                lower.append(rows.lower)
                upper.append(rows.upper)
                at += number
        if model.total_time is not None:
            blocks.append(Block("total time", "", at, 1, unit="s"))
            lower.append(np.array([model.total_time]))
            upper.append(lower[-1])
            at += 1
        low, high = (np.concatenate([np.empty(0), *parts]) for parts in (lower, upper))
        size_of = np.where(np.isfinite(high), np.abs(high), np.abs(low))
        # Fixed constants are relative to the same origin as the columns.
        fixed = np.diff(reduction.matrix.indptr) == 0
        constant = reduction.constant - np.where(fixed, self._shift, 0.0)
        made = assemble(
            groups, reduction.matrix, constant, model.time_weight, at,
            total=model.total_time is not None,
        )  # fmt: skip
        point = self.encode(guess)
        free = np.full(point.size, np.inf)
        columns = [Block("log duration", "", 0, count, "of segment {0}", np.arange(count)[:, None])]
        if point.size > count:
            columns.append(
                Block(
                    "free derivatives", "", count, point.size - count,
                    "entry {2} of segment {0}, axis {1}", reduction.places,
                )
            )  # fmt: skip
        return NonlinearProgram(
            function=made.function,
            derivatives=made.derivatives,
            hessian=made.hessian,
            row_lower=low,
            row_upper=high,
            column_lower=-free,
            column_upper=free,
            guess=point,
            column_scale=np.concatenate([np.ones(count), self._sizes(guess.durations)]),
            row_scale=np.where(size_of > 0, size_of, 1.0),
            objective_scale=max(model.objective(guess), 1e-300),
            columns=tuple(columns),
            rows=tuple(blocks),
            name=f"{model.name or model.kind}, {self.name}",
        )

    def _all_rows(self) -> Iterator[_Rows]:
        """Yield the rows of every bound and of the half-spaces at the imposed instants."""
        model, powers = self.model, self._unit.powers
        labels = [
            (bound.name, derivative_unit(bound.derivative), bound.derivative, "axis")
            for bound in model.bounds
        ]
        for number, (name, unit, derivative, kind) in enumerate(
            [*labels, ("polytope", "m", 0, "half-space")]
        ):
            now, s = self._unit.held_of(number)
            values = power_rows(s, derivative, model.degree) @ powers
            if kind == "axis":
                entries = self._unit.columns(now.segment, now.axis)
            else:
                every = [self._unit.columns(now.segment, axis) for axis in range(model.dimensions)]
                entries = np.concatenate(every, axis=1)
                values = now.direction[:, :, None] * values[:, None, :]
            start = now.direction @ self._origin if derivative == 0 else 0.0
            yield _Rows(
                name, unit, f"on segment {{0}}, {kind} {{1}}", derivative, now.segment, now.axis,
                entries, values.reshape(entries.shape), now.lower - start, now.upper - start,
            )  # fmt: skip

    def _sizes(self, durations: Floats) -> Floats:
        """Return typical sizes of the free derivatives: typical length / time^order."""
        model, place = self.model, self._unit.reduction.places
        apart = np.abs(np.diff(model.waypoints, axis=0))
        apart = apart[np.isfinite(apart) & (apart > 0.0)]
        inside = place[:, 2] < 2 * model.order
        knot = place[:, 0] + (inside & (place[:, 2] >= model.order))
        order = np.where(inside, place[:, 2] % model.order, 0)
        length = float(apart.mean()) if apart.size else 1.0
        sizes: Floats = length * knot_times(durations)[knot] ** -order.astype(float)
        return sizes

    # -- a guess ---------------------------------------------------------------------------------

    @cached_property
    def guess(self) -> Trajectory:
        """Last refined solution, or the smoothest path at durations proportional to distances.

        The total is the given one, or the optimum of J + ρ ΣT from rest to rest, stretched until the
        path satisfies the limits of derivatives. It may violate the corridor or polytopes.
        """
        if self.near is not None:
            return self.near
        model = self.model
        known = np.where(np.isfinite(model.waypoints), model.waypoints, self._origin)
        length = np.linalg.norm(np.diff(known, axis=0), axis=1)
        mean = float(length.mean())
        durations = np.maximum(length, LEAST * mean if mean > 0 else 1.0)
        if model.total_time is not None:
            return self._smoothest(durations * (model.total_time / durations.sum()))
        plan = self._smoothest(durations)
        power, price = 2 * model.order, model.time_weight * plan.duration
        share = (power - 1) * (model.objective(plan) - price) / price
        if share > 0.0:
            plan = self._smoothest(durations * share ** (1.0 / power))
        factor = max(1.0, model.stretch(plan))
        return plan if factor == 1.0 else self._smoothest(factor * plan.durations)

    def _smoothest(self, durations: Floats) -> Trajectory:
        """Return the optimum at given durations without corridor and limits."""
        timed = HermiteFormulation(self.model.at(self.model.times(durations)))
        return timed.unbounded_optimum()

    # -- plans -----------------------------------------------------------------------------------

    def encode(self, plan: Trajectory) -> Floats:
        """Return the logarithms of the durations followed by the free derivatives of `plan`."""
        timed = HermiteFormulation(self.model.at(plan.times))
        local = UnitBasisFormulation.encode(timed, plan) - self._shift
        point: Floats = np.concatenate([np.log(plan.durations), local[self._unit.reduction.source]])
        return point

    def decode(self, point: Floats) -> Trajectory:
        """Return the trajectory with these durations and derivatives."""
        count, reduction = self.model.segments, self._unit.reduction
        point = np.asarray(point, float)
        timed = HermiteFormulation(self.model.at(self.model.times(np.exp(point[:count]))))
        free = point[count:] + self._shift[reduction.source]
        return UnitBasisFormulation.decode(timed, reduction.matrix @ free + reduction.constant)

    def refined(self, point: Floats, tolerance: float, duals: Floats | None = None) -> Self | None:
        """Return the formulation with the instants at which `point` violates bounds, else None."""
        plan = self.decode(point)
        at = self._at(plan.times)
        more = at.refined(at.encode(plan), tolerance)
        if more is None:
            return None
        return self._changed(instants=more.instants, rounds=more.rounds, near=plan)
