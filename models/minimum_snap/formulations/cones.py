"""Second-order cones at instants for the limits of a vehicle, as a conic program."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ....errors import UnsupportedFormulation
from ...formulation import Formulation
from ...programs.blocks import Block
from ...programs.cones import ConeBlock, ConeKind
from ...programs.conic import ConicProgram
from ..model import MinimumDerivative
from ..motion import extended
from ..trajectory import Trajectory
from ..vehicle_checks import yaw_of
from ..vehicles import Measure, Quadrotor
from .bases import LegendreFormulation, UnitBasisFormulation
from .gates import gate_rows
from .hermite import HermiteFormulation
from .instants import initial_times

__all__ = ["PRICE", "RADIUS", "ConeProgramFormulation", "Held"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Step of central differences, relative to the extent of the path. It is 1 for affine functions.
_DIFFERENCE = 1e-6
#: First radius of the trust region, relative to the extent of the path.
RADIUS = 0.5
#: First price of a relative violation, relative to the objective.
PRICE = 10.0


class Held(NamedTuple):
    """Instants at which the limit of one quantity is imposed."""

    segment: Ints
    s: Floats

    def joined(self, segment: Ints, s: Floats) -> Held:
        """Return the instants with further ones, without repetitions to seven decimals.

        Each one has a neighbour on either side, at a quarter of its distance to the next instant. Peaks
        between two active instants then approach the limit by a factor of 16 per round.
        """
        apart = np.abs(self.s[:, None] - s) + 2.0 * (self.segment[:, None] != segment)
        near = 0.25 * apart.min(axis=0, initial=1.0)
        flanked = np.clip(np.concatenate([s, s - near, s + near]), 0.0, 1.0)
        both = np.append(self.segment, np.tile(segment, 3)), np.append(self.s, flanked)
        keys = np.column_stack([both[0], np.round(both[1] * 1e7).astype(np.int64)])
        _, first = np.unique(keys, axis=0, return_index=True)
        first.sort()
        return Held(both[0][first], both[1][first])


class _UnitLegendre(LegendreFormulation):
    """Legendre basis whose coefficients of order r move the path by about their size, in any unit of time."""

    @cached_property
    def unit(self) -> float:
        """Unit of the coefficients of order r: their basis functions have the size 1 / r!."""
        power = (self.model.order - 0.5) * np.log2(self.model.durations.min())
        return float(2.0 ** np.round(power - np.log2(math.factorial(self.model.order))))


@dataclass(frozen=True, eq=False)
class ConeProgramFormulation(Formulation[MinimumDerivative, Trajectory]):
    """Program of a path with the convex limits of a vehicle, and others linearised about a path."""

    samples: int = 5
    base: UnitBasisFormulation = field(default=None, init=False, repr=False)  # type: ignore[assignment]
    held: tuple[Held, ...] = field(default=(), init=False, repr=False)
    #: Path of the linearisation; None in the convex phase.
    centre: Trajectory | None = field(default=None, init=False, repr=False)
    radius: float = field(default=RADIUS, init=False, repr=False)
    price: float = field(default=PRICE, init=False, repr=False)

    program_type = ConicProgram
    # The terms of a row may be several times larger than their sum.
    precision = 0.25

    def __post_init__(self) -> None:
        model = self.model
        if model.vehicle is None and not model.gates:
            raise UnsupportedFormulation(
                "the model has no vehicle or gates: take another formulation"
            )
        plain = replace(model, vehicle=None, yaw=None, gates=())
        local = not (model.fixes_order or model.gates) and model.continuity < model.order
        # Only the columns of hermite keep a standstill, at which the direction of the path is a limit.
        kind = HermiteFormulation if local else _UnitLegendre
        first = kind(plain, samples=self.samples)
        segment = np.repeat(np.arange(model.segments), self.samples)
        s = np.tile(initial_times(self.samples), model.segments)
        # The end of a segment is the start of the next one.
        inner = (s < 1) | (segment == model.segments - 1) | (model.continuity < 3)
        held = tuple(Held(segment[inner], s[inner]) for _ in self.measures)
        self._set(base=first, held=held)

    def _set(self, **fields: Any) -> Self:
        for name, value in fields.items():
            object.__setattr__(self, name, value)
        return self

    @property
    def _follows(self) -> bool:
        vehicle = self.model.vehicle
        return isinstance(self.model.yaw, str) or (vehicle is not None and vehicle.follows_path)

    @property
    def _vehicle(self) -> Any:
        return self.model.vehicle

    @cached_property
    def _is_fixed(self) -> bool:
        """Whether the path has no freedom: a limit at an instant is then a constant cone, which proves a violation."""
        return bool(self._map[0].shape[1] == 0)

    @cached_property
    def measures(self) -> tuple[Measure, ...]:
        """Limited quantities of the vehicle."""
        return () if self.model.vehicle is None else self.model.vehicle.measures

    @cached_property
    def _map(self) -> tuple[sp.csr_array, Floats]:
        """Matrix and constant from the columns of the base to the coefficients of the segments."""
        if isinstance(self.base, HermiteFormulation):
            reduction = self.base.reduction
            return sp.csr_array(reduction.matrix * self.base.unit), reduction.constant
        size = self.model.segments * self.model.dimensions * (self.model.degree + 1)
        return sp.csr_array(sp.eye_array(size)), np.zeros(size)

    @cached_property
    def _effect(self) -> Floats:
        """Coefficient of every local column that moves the path by its extent, as a flat array."""
        unit = np.abs(self.base.powers).max(axis=0) * self.base.scales
        step = self.model.position_scale.max() / unit
        return np.repeat(step, self.model.dimensions, axis=0)

    @cached_property
    def unit(self) -> float:
        """Unit of the columns, a power of two near the extent of the path, m."""
        return float(2.0 ** np.round(np.log2(self.model.position_scale.max())))

    # -- the program -----------------------------------------------------------------------------

    def build(self) -> ConicProgram:
        """Return the program: that of the base, the cones and, about a path, a slack and a trust region."""
        quadratic: Any = self.base.program
        size, matrix = quadratic.size, quadratic.matrix
        around = self.centre is not None
        gates = gate_rows(self.model, self.base, quadratic.matrix.shape[0])
        matrix = sp.vstack([matrix, gates.matrix @ self._map[0]])
        constant = gates.matrix @ self._map[1]
        cone_rows = gates.cone_matrix @ self._map[0]
        slack = sp.csr_array((len(gates.cone_offset), 1))
        parts = [sp.hstack([cone_rows, slack]) if around else cone_rows] if self.model.gates else []
        offsets = [(gates.cone_offset + gates.cone_matrix @ self._map[1]) / self.unit]
        blocks, at = list(gates.cones), len(gates.cone_offset)
        for measure, held in zip(self.measures, self.held, strict=True):
            if not (measure.is_convex or around or self._is_fixed):
                continue
            rows, offset = self._cones(measure, held)
            count, dimension = offset.shape
            if not count:
                continue
            index = self._places(measure, held)
            blocks.append(
                ConeBlock(
                    f"{measure.name} limit", "", at, count * dimension, "on segment {0}, instant {1}",
                    index, kind=ConeKind.SECOND_ORDER, dimension=dimension,
                )
            )  # fmt: skip
            parts.append(rows)
            offsets.append(offset.ravel())
            at += count * dimension
        cones = sp.vstack(parts) if parts else sp.csr_array((0, size + around))
        cost, hessian = quadratic.cost * self.unit, quadratic.hessian * self.unit**2
        upper, columns = self._implied, quadratic.columns
        lower = -upper
        if self.centre is not None:
            point = self.base.encode(self.centre) / self.unit
            reach = self.radius * self._reach / self.unit
            lower = np.append(np.maximum(lower, point - reach), 0.0)
            upper = np.append(np.minimum(upper, point + reach), np.inf)
            cost = np.append(cost, self._penalty)
            matrix = sp.hstack([matrix, sp.csr_array((matrix.shape[0], 1))])
            hessian = sp.block_diag([hessian, sp.csr_array((1, 1))])
            columns = (*columns, Block("relative violation", "", size, 1))
        return ConicProgram(
            cost=cost, cone_matrix=sp.csr_array(cones), cone_offset=np.concatenate([[], *offsets]),
            cones=tuple(blocks), hessian=sp.csr_array(hessian), matrix=sp.csr_array(matrix),
            row_lower=np.append(quadratic.row_lower, gates.lower - constant) / self.unit,
            row_upper=np.append(quadratic.row_upper, gates.upper - constant) / self.unit,
            column_lower=lower, column_upper=upper, offset=quadratic.offset, columns=columns,
            rows=(*quadratic.rows, *gates.rows),
            name=f"{self.model.name or self.model.kind}, {self.name}",
        )  # fmt: skip

    @cached_property
    def _implied(self) -> Floats:
        """Return bounds of the columns that follow from the limits at all times; infinite if unknown.

        By Markov's inequality, a polynomial of degree n that is bounded by B on a segment of duration T has
        a derivative of order k of at most ``B (2 / T)^k`` times that of the Chebyshev polynomial at 1. Bounded
        columns make proofs of infeasibility by approximate multipliers rigorous.
        """
        model, base = self.model, self.base
        result = np.full(base.program.size, np.inf)
        if not (result.size and isinstance(base, HermiteFormulation)):
            return result
        limits = {measure.name: measure.limit for measure in self.measures}
        pace, bend = limits.get("speed", np.inf), limits.get("acceleration", np.inf)
        if isinstance(model.vehicle, Quadrotor) and not model.vehicle.drag:
            bend = min(bend, model.vehicle.thrust[1] / model.vehicle.mass + model.vehicle.gravity)
        reduction, r = base.reduction, model.order
        segment, axis, function = reduction.places.T
        order, inner = function % r, function < 2 * r
        long = model.durations[segment]
        step = np.abs(np.diff(model.waypoints, axis=0))[segment, axis]
        for limit, first in ((pace, 1), (bend, 2)):
            for k in range(first, r):
                n: int = max(model.degree - first, 0)
                grown = math.prod((n * n - i * i) / (2 * i + 1) for i in range(k - first))
                here = np.flatnonzero(inner & (order == k))
                bound = limit * grown * (2.0 / long[here]) ** (k - first)
                result[here] = np.minimum(result[here], bound)
        # A velocity differs from the mean over its segment by the acceleration times the duration.
        here = np.flatnonzero(inner & (order == 1) & np.isfinite(step))
        result[here] = np.minimum(result[here], step[here] / long[here] + bend * long[here])
        scale = reduction.matrix[reduction.source, np.arange(result.size)] * base.unit * self.unit
        return np.asarray((1.0 + 1e-6) * result / np.maximum(scale, 1e-300))

    @cached_property
    def _reach(self) -> Floats:
        """Change of every column of the base that moves the path by its extent."""
        matrix = abs(self._map[0])
        share = matrix.multiply(1.0 / self._effect.ravel()[:, None]).max(axis=0).toarray().ravel()
        return np.asarray(1.0 / np.maximum(share, 1e-300))

    @property
    def _penalty(self) -> float:
        """Price of a relative violation of 1."""
        assert self.centre is not None
        return self.price * max(self.model.objective(self.centre), self.model.objective_scale)

    def _places(self, measure: Measure, held: Held) -> Ints:
        """Return segment and number of the instants of a measure that have a cone."""
        take = self._derived(measure, held)[2]
        return np.column_stack([held.segment, np.arange(held.s.size)])[take].astype(np.int64)

    def _cones(self, measure: Measure, held: Held) -> tuple[sp.csr_array, Floats]:
        """Return the cone rows of a measure at its instants, and their constants."""
        model, (matrix, constant) = self.model, self._map
        local, offset, take = self._derived(measure, held)
        count, dimension, width = local.shape
        if not count:
            return sp.csr_array((0, matrix.shape[1])), offset
        block = model.dimensions * (model.degree + 1)
        columns = (held.segment[take, None] * block + np.arange(block))[:, None, :]
        columns = np.broadcast_to(columns, local.shape)
        start = np.arange(count * dimension + 1) * width
        size = model.segments * block
        rows = sp.csr_array(
            (local.ravel(), columns.ravel(), start), shape=(count * dimension, size)
        )
        offset = offset + (rows @ constant).reshape(offset.shape)
        rows = sp.csr_array(rows @ matrix) * self.unit
        if self.centre is not None:
            slack = np.zeros((count, dimension))
            if not measure.is_convex:
                slack[:, 0] = measure.limit
            rows = sp.csr_array(sp.hstack([rows, sp.csr_array(slack.reshape(-1, 1))]))
        # Constants near 1: the violation of a cone is then relative to the limit, so that proofs of
        # infeasibility are independent of the units.
        largest = np.abs(offset).max(axis=1) if measure.is_convex else np.full(count, measure.limit)
        share = 1.0 / largest
        return sp.csr_array(rows * np.repeat(share, dimension)[:, None]), offset * share[:, None]

    def _derived(self, measure: Measure, held: Held) -> tuple[Floats, Floats, Ints]:
        """Return derivatives of a cone in the local coefficients, constants, and the instants they are of.

        The derivatives have the shape (instants, dimension, columns of a segment). Instants at which the
        fixed derivatives alone determine the quantity have no cone.
        """
        key = measure.name
        if key in self._memory:
            return self._memory[key]
        model, base = self.model, self.base
        shape = model.segments, model.dimensions, model.degree + 1
        matrix, constant = self._map
        free = (np.diff(matrix.indptr) > 0).reshape(shape)
        affine = measure.is_convex or self.centre is None
        if self._is_fixed:
            local, step = constant.reshape(shape), np.zeros(shape)
        elif affine:
            local, step = np.zeros(shape), self._effect.reshape(shape)
        else:
            assert self.centre is not None
            local = (matrix @ base.encode(self.centre) + constant).reshape(shape)
            step = np.where(free, _DIFFERENCE * self._effect.reshape(shape), 0.0)

        def cone(change: Floats) -> Floats:
            powers = np.moveaxis(base.to_powers(local + change), 1, 2)
            plan = Trajectory(model.times, powers)
            series = extended(plan, self._yaw, self._vehicle.follows_path)
            values = measure.cone(series.on(held.segment, held.s, 4))
            return np.column_stack([value.terms[0] for value in values])

        value = cone(np.zeros(shape))
        result = np.zeros((*value.shape, model.dimensions * shape[2]))
        for axis in range(model.dimensions):
            for column in range(shape[2]):
                change = np.zeros(shape)
                change[:, axis, column] = step[:, axis, column]
                if not change.any():
                    continue
                by = 2.0 * change[held.segment, axis, column]
                slope = (cone(change) - cone(-change)) / np.where(by != 0, by, np.inf)[:, None]
                result[:, :, axis * shape[2] + column] = slope
        if affine:
            offset = value
        else:
            flat = local.reshape(model.segments, -1)[held.segment]
            offset = value - np.einsum("qdc,qc->qd", result, flat)
        mobile = np.where(free.reshape(model.segments, -1)[held.segment, None, :], result, 0.0)
        moving = (np.abs(mobile).max(axis=(1, 2)) > 0) | self._is_fixed
        finite = np.isfinite(result).all(axis=(1, 2)) & np.isfinite(offset).all(axis=1)
        take = np.flatnonzero(moving & finite)
        self._memory[key] = result[take], offset[take], take
        return self._memory[key]

    @cached_property
    def _memory(self) -> dict[str, tuple[Floats, Floats, Ints]]:
        return {}

    @cached_property
    def _yaw(self) -> Any:
        """Yaw of all paths of the model."""
        times = self.model.times
        plan = Trajectory(times, np.zeros((self.model.segments, 1, self.model.dimensions)))
        return yaw_of(self.model, self.model.with_yaw(plan))

    # -- plans -----------------------------------------------------------------------------------

    def encode(self, plan: Trajectory) -> Floats:
        """Return the columns of `plan`."""
        point: Floats = self.base.encode(plan) / self.unit
        return point if self.centre is None else np.append(point, 0.0)

    def decode(self, point: Floats) -> Trajectory:
        """Return the trajectory with these columns, and the yaw of the model."""
        return self.model.with_yaw(self.base.decode(self._local(point)))

    def _local(self, point: Floats) -> Floats:
        """Return the columns of the base."""
        point = np.asarray(point, float)
        return point[: point.size - (self.centre is not None)] * self.unit
