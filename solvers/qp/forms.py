"""A quadratic or conic program in the forms that solvers read, and the way back to its multipliers."""

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

#: Size of a point that no solver was near an optimum with: a proximal term stays away from it.
FAR = 1e8


@dataclass(frozen=True, eq=False)
class Core:
    """What is left of a program for a solver: its free columns, and the rows that say something.

    Many solvers stumble over rows without entries or bounds, and interior points over columns that
    are fixed; the multipliers of such rows are 0, and fixed columns need none. All cones stay.

    Parameters
    ----------
    whole, program : QuadraticProgram or ConicProgram
        The program asked, and what is left of it.
    columns, rows : ndarray of int
        Which of the whole program's are left.
    base : ndarray
        The values of the fixed columns, 0 elsewhere.
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
        said = np.isfinite(whole.row_lower) | np.isfinite(whole.row_upper)
        rows = np.flatnonzero(said & (np.diff(matrix.indptr) > 0))
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

        Solvers that fail on flat objectives find an optimum of this one; it binds much the same rows,
        which is what the polish needs to find that of the program asked.
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
        """Return a column vector of the whole program."""
        if point is None:
            return None
        full = self.base.copy()
        full[self.columns] = point
        return full

    def direction(self, direction: Vector | None) -> Vector | None:
        """Return a direction of the whole program; fixed columns stay."""
        if direction is None:
            return None
        full = np.zeros(self.whole.size)
        full[self.columns] = direction
        return full

    def duals(self, duals: Vector | None) -> Vector | None:
        """Return multipliers of the whole program: of its rows, then of its cone rows."""
        if duals is None:
            return None
        count, rows = self.whole.row_count, self.rows.size
        cones = self.whole.cone_offset.size if isinstance(self.whole, ConicProgram) else 0
        full = np.zeros(count + cones)
        full[self.rows] = duals[:rows]
        # All columns fixed: there is nothing to solve, and nobody gives multipliers to cones.
        full[count : count + duals.size - rows] = duals[rows:]
        return full


@dataclass(frozen=True, eq=False)
class SplitForm:
    """Equal rows ``equal @ x == right`` apart from two-sided ``ranged`` ones.

    Parameters
    ----------
    equal, ranged : sparse array
        The rows.
    right, low, high : ndarray
        Their bounds.
    at_equal, at_ranged : ndarray of int
        Which rows of the program they are.
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
        """Return the rows of `program` so divided."""
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
        """Return the program's row multipliers from those of both kinds, of the program's sign."""
        found = np.zeros(self.at_equal.size + self.at_ranged.size)
        found[self.at_equal] = np.asarray(equal, float)
        found[self.at_ranged] = np.asarray(ranged, float)
        return found


@dataclass(frozen=True, eq=False)
class ConicForm:
    """``matrix @ x + s == right`` with s zero, then nonnegative, then in the cones.

    Parameters
    ----------
    matrix : sparse matrix
        Equal rows, rows from above, rows from below (negated), columns from above and from below,
        cone rows (negated).
    right : ndarray
        The right-hand side.
    zeros, linear : int
        Number of equal rows, and of all rows before the cone rows.
    equal, above, below : ndarray of int
        Which rows of the program the first three kinds are.
    cones : tuple of ConeBlock
        The cones, in the solver's order.
    take : ndarray of int
        Which cone row of the program each of the cone rows is.
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
        """Return `program`'s constraints in this form.

        Parameters
        ----------
        program : QuadraticProgram or ConicProgram
            What is written.
        kinds : sequence of ConeKind
            The order in which the solver wants the cones; by default as they come.
        orders : callable, optional
            The order in which it wants the rows of a cone of a block, where it is not ours.
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
        taken = [np.empty(0, np.intp)]
        if isinstance(program, ConicProgram):
            cones = sorted(program.cones, key=lambda block: kinds.index(block.kind) if kinds else 0)
            for block in cones:
                own = np.arange(block.dimension) if orders is None else orders(block)
                starts = block.start + block.dimension * np.arange(block.count)
                taken.append((starts[:, None] + own).ravel())
            blocks.append(-program.cone_matrix[np.concatenate(taken)])
            sides.append(program.cone_offset[np.concatenate(taken)])
        return cls(
            # A matrix, not an array: solvers written before sparse arrays test for it.
            sp.csc_matrix(sp.vstack(blocks)),
            np.concatenate(sides),
            equal.size,
            linear,
            equal,
            above,
            below,
            tuple(cones),
            np.concatenate(taken),
        )

    def duals(self, conic: Any, rows: int) -> Vector:
        """Return the multipliers of `rows` rows and of the cone rows, from those of this form.

        There, ``H x + c + matrix' z = 0``.
        """
        z = np.asarray(conic, float)
        found = np.zeros(rows + self.take.size)
        first, second = self.equal.size, self.equal.size + self.above.size
        found[self.equal] = -z[:first]
        found[self.above] -= z[first:second]
        found[self.below] += z[second : second + self.below.size]
        found[rows + self.take] = z[self.linear :]
        return found

    def slack(self, x: Vector) -> Vector:
        """Return an s for a start from `x`: as near to solving the equations as is easily had."""
        s: Vector = self.right - self.matrix @ x
        s[: self.zeros] = 0.0
        s[self.zeros : self.linear] = np.maximum(s[self.zeros : self.linear], 0.0)
        at = self.linear
        for block in self.cones:
            # Of a triangle in another order this is no projection, and still a start.
            part = s[at : at + block.size].reshape(block.count, block.dimension)
            s[at : at + block.size] = inside(block.kind, part).ravel()
            at += block.size
        return s


def columnwise(block: ConeBlock) -> Places:
    """Return where each entry of the lower triangle, column by column, stands row by row."""
    if block.kind is not ConeKind.SEMIDEFINITE:
        return np.arange(block.dimension)
    column, row = np.triu_indices(order(block.dimension))
    return row * (row + 1) // 2 + column


def stacked_rows(program: QuadraticProgram) -> tuple[Any, Vector, Vector]:
    """Return rows and bounded columns as one ``low <= matrix @ x <= high``, rows first."""
    bounded = np.flatnonzero(np.isfinite(program.column_lower) | np.isfinite(program.column_upper))
    unit = sp.eye_array(program.size, format="csr")[bounded]
    return (
        sp.csc_matrix(sp.vstack([program.matrix, unit])),
        np.concatenate([program.row_lower, program.column_lower[bounded]]),
        np.concatenate([program.row_upper, program.column_upper[bounded]]),
    )


def independent_rows(program: QuadraticProgram) -> tuple[QuadraticProgram, Places]:
    """Return `program` without equal rows that others span, and which rows are left.

    For solvers that break on them. What is dropped is either implied, with the multiplier 0, or
    contradicts the others, which the verification of the point will show.
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
