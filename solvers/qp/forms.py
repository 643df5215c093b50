"""Forms of quadratic and conic programs that solvers read, and the way back to the multipliers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.cones import ConeBlock, ConeKind, inside, order
from ...models.programs.conic import ConicProgram
from ...models.programs.linear import QuadraticProgram

__all__ = [
    "ConicForm",
    "Convex",
    "Core",
    "SplitForm",
    "columnwise",
    "independent_rows",
    "stacked_rows",
]

Vector = NDArray[np.float64]
Places = NDArray[np.intp]
Convex = QuadraticProgram | ConicProgram

#: Largest size of a point at which a proximal term is centred; larger points have diverged.
FAR = 1e8


@dataclass(frozen=True, eq=False)
class Core:
    """Part of a program that a solver receives: its free `columns` and its effective `rows`, as indices of `whole`.

    Many solvers fail on rows without entries or bounds, and interior-point methods on fixed columns. Multipliers of
    such rows are 0. All cones are kept. `base` contains the values of the fixed columns, and 0 elsewhere.
    """

    whole: Any
    program: Any
    columns: Places
    rows: Places
    base: Vector

    @classmethod
    def of(cls, whole: Convex) -> Core:
        """Return the core of `whole`."""
        fixed = whole.column_lower == whole.column_upper
        base = np.where(fixed, whole.column_lower, 0.0)
        columns = np.flatnonzero(~fixed)
        matrix = sp.csr_array(whole.matrix[:, columns]) if fixed.any() else whole.matrix
        matrix = sp.csr_array(matrix, copy=True)
        matrix.eliminate_zeros()
        bounded = np.isfinite(whole.row_lower) | np.isfinite(whole.row_upper)
        rows = np.flatnonzero(bounded & (np.diff(matrix.indptr) > 0))
        if columns.size == whole.size and rows.size == whole.row_count:
            return cls(whole, whole, columns, rows, base)
        shift = whole.matrix @ base
        cones: dict[str, Any] = {}
        if isinstance(whole, ConicProgram):
            cones = {
                "cone_matrix": whole.cone_matrix[:, columns],
                "cone_offset": whole.cone_rows(base),
            }
        program = replace(
            whole,
            hessian=sp.csr_array(whole.hessian[columns][:, columns]),
            cost=(whole.cost + whole.hessian @ base)[columns],
            matrix=matrix[rows],
            row_lower=(whole.row_lower - shift)[rows],
            row_upper=(whole.row_upper - shift)[rows],
            column_lower=whole.column_lower[columns],
            column_upper=whole.column_upper[columns],
            offset=whole.objective(base),
            columns=(),
            rows=(),
            **cones,
        )
        return cls(whole, program, columns, rows, base)

    def proximal(self, center: Vector | None, weight: float) -> Core:
        """Return the core with a strictly convex objective, which has the same value at `center`.

        Solvers that fail on flat objectives can solve this program. Mostly the same rows bind at its optimum, from
        which polishing finds that of the given program. `center`, 0 by default, has the columns of the given program,
        and `weight` is relative to the largest curvature.
        """
        program = self.program
        around = np.zeros(program.size)
        if center is not None and np.abs(center).max(initial=0.0) <= FAR:
            around = center[self.columns]
        curvature = float(program.hessian.diagonal().max(initial=0.0))
        slope = float(np.abs(program.cost).max(initial=0.0))
        weight *= curvature or slope or 1.0
        posed = replace(
            program,
            hessian=sp.csr_array(program.hessian + weight * sp.eye_array(program.size)),
            cost=program.cost - weight * around,
            offset=program.offset + weight * float(around @ around) / 2,
        )
        return replace(self, program=posed)

    def point(self, point: Vector | None) -> Vector | None:
        """Return a column vector of the given program; None for None."""
        if point is None:
            return None
        full = self.base.copy()
        full[self.columns] = point
        return full

    def direction(self, direction: Vector | None) -> Vector | None:
        """Return a direction of the given program, 0 for fixed columns; None for None."""
        if direction is None:
            return None
        full = np.zeros(self.whole.size)
        full[self.columns] = direction
        return full

    def duals(self, duals: Vector | None) -> Vector | None:
        """Return multipliers of the given program: of its rows, then of its cone rows; None for None."""
        if duals is None:
            return None
        count, rows = self.whole.row_count, self.rows.size
        cones = self.whole.cone_offset.size if isinstance(self.whole, ConicProgram) else 0
        full = np.zeros(count + cones)
        full[self.rows] = duals[:rows]
        # With all columns fixed, there are no multipliers of cones.
        full[count : count + duals.size - rows] = duals[rows:]
        return full


@dataclass(frozen=True, eq=False)
class SplitForm:
    """Equality rows ``equal @ x == right``, separated from two-sided ``ranged`` rows.

    `at_equal` and `at_ranged` are the indices of the rows in the program.
    """

    equal: sp.csc_array
    right: Vector
    ranged: sp.csc_array
    low: Vector
    high: Vector
    at_equal: Places
    at_ranged: Places

    @classmethod
    def of(cls, program: QuadraticProgram) -> SplitForm:
        """Return the rows of `program` in this form."""
        same = program.row_lower == program.row_upper
        at_equal, at_ranged = np.flatnonzero(same), np.flatnonzero(~same)
        return cls(
            sp.csc_array(program.matrix[at_equal]),
            program.row_lower[at_equal],
            sp.csc_array(program.matrix[at_ranged]),
            program.row_lower[at_ranged],
            program.row_upper[at_ranged],
            at_equal,
            at_ranged,
        )

    def duals(self, equal: Any, ranged: Any) -> Vector:
        """Return the program's row multipliers from those of both kinds, with the program's signs."""
        multipliers = np.zeros(self.at_equal.size + self.at_ranged.size)
        multipliers[self.at_equal] = np.asarray(equal, float)
        multipliers[self.at_ranged] = np.asarray(ranged, float)
        return multipliers


@dataclass(frozen=True, eq=False)
class ConicForm:
    """Conic form ``matrix @ x + s == right`` with s zero, then nonnegative, then in the cones.

    The rows are the equality rows, the rows with upper bounds, those with lower bounds (negated), the columns with
    upper and with lower bounds (negated), and the cone rows (negated). `zeros` counts the equality rows, and `linear`
    all rows before the cone rows. `equal`, `above` and `below` are the indices in the program of the first three kinds,
    and `take` those of the cone rows. `cones` has the order of the solver.
    """

    matrix: Any
    right: Vector
    zeros: int
    linear: int
    equal: Places
    above: Places
    below: Places
    cones: tuple[ConeBlock, ...]
    take: Places

    @classmethod
    def of(
        cls,
        program: Convex,
        kinds: Sequence[ConeKind] = (),
        orders: Callable[[ConeBlock], Places] | None = None,
    ) -> ConicForm:
        """Return the constraints of `program` in this form.

        `kinds` is the order of the cones for the solver, and `orders` returns its order of the rows of one cone of a
        block. The default is the order of the program and of crosstrack.
        """
        low, high = program.row_lower, program.row_upper
        left, right = program.column_lower, program.column_upper
        same = low == high
        equal = np.flatnonzero(same)
        above = np.flatnonzero(~same & np.isfinite(high))
        below = np.flatnonzero(~same & np.isfinite(low))
        capped, floored = np.flatnonzero(np.isfinite(right)), np.flatnonzero(np.isfinite(left))
        unit = sp.eye_array(program.size, format="csr")
        blocks = [
            program.matrix[equal],
            program.matrix[above],
            -program.matrix[below],
            unit[capped],
            -unit[floored],
        ]
        sides = [low[equal], high[above], -low[below], right[capped], -left[floored]]
        linear = sum(side.size for side in sides)
        cones: list[ConeBlock] = []
        indices = [np.empty(0, np.intp)]
        if isinstance(program, ConicProgram):
            cones = sorted(program.cones, key=lambda block: kinds.index(block.kind) if kinds else 0)
            for block in cones:
                row_order = np.arange(block.dimension) if orders is None else orders(block)
                starts = block.start + block.dimension * np.arange(block.count)
                indices.append((starts[:, None] + row_order).ravel())
            blocks.append(-program.cone_matrix[np.concatenate(indices)])
            sides.append(program.cone_offset[np.concatenate(indices)])
        return cls(
            # A sparse matrix instead of an array, which older solvers require.
            sp.csc_matrix(sp.vstack(blocks)),
            np.concatenate(sides),
            equal.size,
            linear,
            equal,
            above,
            below,
            tuple(cones),
            np.concatenate(indices),
        )

    def duals(self, conic: Any, rows: int) -> Vector:
        """Return the multipliers of `rows` rows and of the cone rows, from those of this form.

        In this form, ``H x + c + matrix' z = 0``.
        """
        z = np.asarray(conic, float)
        multipliers = np.zeros(rows + self.take.size)
        first, second = self.equal.size, self.equal.size + self.above.size
        multipliers[self.equal] = -z[:first]
        multipliers[self.above] -= z[first:second]
        multipliers[self.below] += z[second : second + self.below.size]
        multipliers[rows + self.take] = z[self.linear :]
        return multipliers

    def slack(self, x: Vector) -> Vector:
        """Return a slack s for a warm start from `x`, feasible for its cones and nearly for the rows."""
        s: Vector = self.right - self.matrix @ x
        s[: self.zeros] = 0.0
        s[self.zeros : self.linear] = np.maximum(s[self.zeros : self.linear], 0.0)
        start = self.linear
        for block in self.cones:
            # For a triangle in another order this is not a projection, but an adequate start.
            part = s[start : start + block.size].reshape(block.count, block.dimension)
            s[start : start + block.size] = inside(block.kind, part).ravel()
            start += block.size
        return s


def columnwise(block: ConeBlock) -> Places:
    """Return the index, in row order, of each entry of the lower triangle in column order.

    Cones that are not semidefinite keep their order.
    """
    if block.kind is not ConeKind.SEMIDEFINITE:
        return np.arange(block.dimension)
    column, row = np.triu_indices(order(block.dimension))
    return row * (row + 1) // 2 + column


def stacked_rows(program: QuadraticProgram) -> tuple[Any, Vector, Vector]:
    """Return rows and bounded columns as ``low <= matrix @ x <= high``, rows first."""
    bounded = np.flatnonzero(np.isfinite(program.column_lower) | np.isfinite(program.column_upper))
    unit = sp.eye_array(program.size, format="csr")[bounded]
    return (
        sp.csc_matrix(sp.vstack([program.matrix, unit])),
        np.concatenate([program.row_lower, program.column_lower[bounded]]),
        np.concatenate([program.row_upper, program.column_upper[bounded]]),
    )


def independent_rows(program: QuadraticProgram) -> tuple[QuadraticProgram, Places]:
    """Return `program` without linearly dependent equality rows, and the indices of the other rows.

    For solvers that fail on such rows. A removed row is either implied, with the multiplier 0, or
    contradicts the others, which the verification of the point detects.
    """
    from scipy.linalg import qr

    split = SplitForm.of(program)
    everything = np.arange(program.row_count)
    if split.right.size < 2:
        return program, everything
    dense = split.equal.toarray()
    dense /= np.maximum(np.abs(dense).max(axis=1, keepdims=True), 1e-300)
    triangle, order = qr(dense.T, mode="r", pivoting=True, check_finite=False)
    diagonal = np.abs(np.diag(triangle))
    rank = int((diagonal > 1e-11 * diagonal[0]).sum())
    if rank == split.right.size:
        return program, everything
    rows = np.sort(np.concatenate([split.at_ranged, split.at_equal[order[:rank]]]))
    return program.only_rows(rows), rows
