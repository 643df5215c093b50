"""Reduced program whose only unknowns are the free derivatives at the knots."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from ....errors import UnsupportedFormulation
from ...programs.blocks import Block
from ...programs.linear import QuadraticProgram
from ..trajectory import Trajectory
from .bases import UnitBasisFormulation, legendre_basis
from .piecewise import Rows, power_rows

__all__ = ["HermiteFormulation", "hermite_basis", "knot_times"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Square root of the curvature of each column of an unbounded program, relative to the median of the
#: program in metres. With smaller values, OSQP and SCS reach their absolute tolerances before the
#: slow modes converge (measured with 1 to 1000).
UNIT = 1e3


@cache
def hermite_basis(order: int, degree: int) -> Floats:
    """Return the coefficients of the Hermite functions on [0, 1] in powers of s, one per column.

    The functions belong to the derivatives 0 … order-1 at 0 and to the same derivatives at 1. For a
    degree above ``2 order - 1``, functions follow that vanish at both ends with these derivatives.
    """
    ends = np.concatenate(
        [power_rows(np.array([s]), j, 2 * order - 1) for s in (0.0, 1.0) for j in range(order)]
    )
    basis = np.zeros((degree + 1, degree + 1))
    basis[: 2 * order, : 2 * order] = np.linalg.inv(ends)
    basis[:, 2 * order :] = legendre_basis(order, degree)[:, 2 * order :]
    return basis


def knot_times(durations: Floats) -> Floats:
    """Return the time that scales the derivatives at each knot, s, shape (segments + 1,).

    It is the geometric mean of the durations of the adjacent segments.
    """
    times: Floats = np.sqrt(
        np.concatenate([durations[:1], durations]) * np.concatenate([durations, durations[-1:]])
    )
    return times


class _Reduction(NamedTuple):
    """Map ``local = matrix @ columns + constant``, and the source entry of each column."""

    matrix: sp.csr_array
    constant: Floats
    source: Ints
    places: Ints


@dataclass(frozen=True, eq=False)
class HermiteFormulation(UnitBasisFormulation):
    """Unconstrained program of Richter, Bry and Roy, without fixed and shared derivatives.

    The columns are the free derivatives at the knots, multiplied by the local time to the power of
    their order, so that they have the size of positions. The objective includes the constant cost
    of the fixed values. Without corridor and limits, the program has no rows and its columns are
    scaled by powers of two to similar curvatures. With them, its Hessian is nearly singular for the
    slow modes of a long path.
    """

    name = "hermite"
    summary = "the free derivatives at the knots, everything else substituted"

    def __post_init__(self) -> None:
        super().__post_init__()
        model = self.model
        if model.continuity > model.order - 1:
            raise UnsupportedFormulation(
                f"the derivatives at the knots that the program shares end with {model.order - 1}; "
                f"continuity {model.continuity} needs another formulation"
            )
        if model.fixes_order:
            raise UnsupportedFormulation(
                f"derivative {model.highest_fixed} is fixed, but the program's columns are the "
                f"derivatives up to {model.order - 1}"
            )

    @cached_property
    def powers(self) -> Floats:
        """Powers of the basis functions, a column each."""
        return hermite_basis(self.model.order, self.model.degree)

    @cached_property
    def scales(self) -> Floats:
        """Powers of the duration, so that the coefficients are derivatives in time."""
        model = self.model
        scales = np.ones((model.segments, model.degree + 1))
        orders = np.tile(np.arange(model.order), 2)
        scales[:, : 2 * model.order] = model.durations[:, None] ** orders
        return scales

    @cached_property
    def reduction(self) -> _Reduction:
        model, r = self.model, self.model.order
        inner = model.segments, model.degree + 1 - 2 * r, model.dimensions
        # Number of the column of each derivative at a knot; -1 for fixed ones.
        jets, times = model.jets, knot_times(model.durations)
        if model.periodic:
            # The ends of a lap are one knot.
            jets = jets.copy()
            jets[[0, -1]] = np.where(np.isfinite(jets[0]), jets[0], jets[-1])
            times[[0, -1]] = np.sqrt(times[0] * times[-1])
        free = ~np.isfinite(jets)
        end = np.where(free, np.arange(free.size).reshape(free.shape), -1)
        if model.periodic:
            end[-1] = end[0]
        begin = end[:-1].copy()
        # Without continuity, the start of every later segment is an unknown of its own.
        apart = begin[1:, model.continuity + 1 :]
        apart[apart >= 0] += free.size
        bubbles = 2 * free.size + np.arange(np.prod(inner)).reshape(inner)
        number = self._flatten(begin, end[1:], bubbles)
        values = np.where(free, 0.0, jets)
        units = np.stack([times**-order for order in range(r)], axis=1)[:, :, None] + 0.0 * values
        scale = self._flatten(units[:-1], units[1:], np.ones(inner))
        # Columns in the order of their first local entries keep the Hessian's band narrow.
        entries = np.flatnonzero(number >= 0)
        _, first, column = np.unique(number[entries], return_index=True, return_inverse=True)
        order, place = np.argsort(first), np.empty_like(first)
        place[order] = np.arange(order.size)
        source = entries[first[order]]
        shape = number.size, source.size
        matrix = sp.csr_array((scale[entries], (entries, place[column])), shape=shape)
        local = model.segments, model.dimensions, model.degree + 1
        constant = self._flatten(values[:-1], values[1:], np.zeros(inner))
        return _Reduction(
            matrix, constant, source, np.column_stack(np.unravel_index(source, local))
        )

    @staticmethod
    def _flatten(begin: NDArray[Any], end: NDArray[Any], inner: NDArray[Any]) -> NDArray[Any]:
        """Return all local entries from tables of shape (segments, functions, dimensions)."""
        return np.concatenate([begin, end, inner], axis=1).swapaxes(1, 2).ravel()

    @cached_property
    def parabola(self) -> tuple[sp.csr_array, Floats]:
        """Hessian and linear cost of the objective in the free derivatives, without bounds."""
        matrix, local = self.reduction.matrix, self._hessian()
        return matrix.T @ local @ matrix, matrix.T @ (local @ self.reduction.constant)

    @cached_property
    def unit(self) -> Floats:
        """Unit of each column of the program, m; 1 if the model has bounds."""
        hessian = self.parabola[0]
        bend = np.sqrt(hessian.diagonal())
        if self.model.bounded or not (bend > 0).any():
            return np.ones(bend.size)
        # Without rows, the curvature alone determines the size of a column.
        usual = UNIT * float(np.median(bend[bend > 0]))
        ratio = usual / np.where(bend > 0, bend, usual)
        return np.asarray(np.exp2(np.round(np.log2(ratio))), float)

    def unbounded_optimum(self) -> Trajectory:
        """Return the trajectory with the least objective without corridor and limits."""
        hessian, slope = self.parabola
        free = np.atleast_1d(spsolve(hessian.tocsc(), -slope)) if slope.size else slope
        return self.decode(free / self.unit)

    def build(self) -> QuadraticProgram:
        """Return the reduced program, including the constant of its objective."""
        reduction, model = self.reduction, self.model
        matrix, constant = reduction.matrix, reduction.constant
        hessian, cost = self.parabola
        columns = sp.diags_array(self.unit)
        hessian, cost = columns @ hessian @ columns, columns @ cost
        groups = []
        joints = range(model.order, model.joint_order + 1)
        for group in (*self._joint_rows(joints), *self._bound_rows()):
            rows = group.rows
            shift = rows.matrix @ constant
            reduced = sp.csr_array(rows.matrix @ matrix @ columns)
            reduced.eliminate_zeros()
            # Rows without a free column constrain only the data, which the model has checked.
            active = np.flatnonzero(np.diff(reduced.indptr))
            sides = (rows.lower - shift)[active], (rows.upper - shift)[active]
            places = rows.places[active]
            if model.bounded:
                rows = Rows(reduced[active], *sides, places)
            else:  # rows of a joint, in units of the columns
                rows = self._scaled(reduced[active], *sides, places)
            groups.append(group._replace(rows=rows))
        template = "entry {2} of segment {0}, axis {1}"
        return self._assembled(
            groups, (hessian + hessian.T) / 2, cost,
            Block("free derivatives", "", 0, cost.size, template, reduction.places, "m"),
            offset=float(constant @ self._hessian() @ constant) / 2,
        )  # fmt: skip

    def encode(self, plan: Trajectory) -> NDArray[np.float64]:
        """Return the free derivatives of `plan` in units of the columns."""
        local = super().encode(plan)
        reduction = self.reduction
        scale = np.asarray(reduction.matrix[reduction.source].sum(axis=1)).ravel()
        free: NDArray[np.float64] = local[reduction.source] / scale / self.unit
        return free

    def decode(self, point: NDArray[np.float64]) -> Trajectory:
        """Return the trajectory with these derivatives."""
        reduction = self.reduction
        free = np.asarray(point, float) * self.unit
        return super().decode(reduction.matrix @ free + reduction.constant)
