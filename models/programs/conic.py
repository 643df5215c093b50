"""Conic programs: linear rows and rows in second-order, exponential and semidefinite cones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Real, declared
from ..verification import TOLERANCE, Check, Verification
from .base import RowProgram, row_sizes
from .blocks import Block, Blocks, Sparse, block_names, without
from .cones import ConeBlock, Cones, inside_dual, missing
from .linear import QuadraticProgram

if TYPE_CHECKING:
    import cvxpy

__all__ = ["ConicProgram"]

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class ConicProgram(RowProgram):
    """Minimise ``x @ hessian @ x / 2 + cost @ x + offset`` under rows, bounds and cones.

    The rows satisfy ``row_lower <= matrix @ x <= row_upper`` as in a
    :class:`~crosstrack.models.programs.QuadraticProgram`. The vector ``cone_matrix @ x +
    cone_offset`` is in the product of the cones. The multipliers are one vector: first those of the
    rows, then those of the cone rows, which are in the dual cones.

    Parameters
    ----------
    cost : ndarray, shape (n,)
        Linear objective coefficients.
    cone_matrix : sparse array, shape (k, n)
        Coefficients of the cone rows.
    cone_offset : ndarray, shape (k,)
        Constants of the cone rows.
    cones : tuple of ConeBlock
        Cones of the cone rows, which they cover in order.
    hessian : sparse array, shape (n, n), optional
        Hessian as in a quadratic program; None for a linear objective.
    matrix : sparse array, shape (m, n), optional
        Row coefficients; None for no rows.
    row_lower, row_upper : ndarray, shape (m,), optional
        Row bounds, infinite for none. A program with rows needs at least one of the two.
    column_lower, column_upper : ndarray, shape (n,), optional
        Column bounds; infinite by default.
    offset : float
        Constant of the objective.
    columns, rows : tuple of Block
        Names and equations; either empty or a complete cover.
    """

    cost: Vector = declared(Array(("n",)))
    cone_matrix: sp.csr_array = declared(Sparse(("k", "n")))
    cone_offset: Vector = declared(Array(("k",)))
    cones: tuple[ConeBlock, ...] = declared(Cones())
    hessian: sp.csr_array = declared(Sparse(("n", "n")), default=None)
    matrix: sp.csr_array = declared(Sparse(("m", "n")), default=None)
    row_lower: Vector = declared(Array(("m",), infinity=-1), default=None)
    row_upper: Vector = declared(Array(("m",), infinity=1), default=None)
    column_lower: Vector = declared(Array(("n",), infinity=-1), default=None)
    column_upper: Vector = declared(Array(("n",), infinity=1), default=None)
    offset: float = declared(Real(), default=0.0)
    columns: tuple[Block, ...] = declared(Blocks(), default=())
    rows: tuple[Block, ...] = declared(Blocks(), default=())

    kind: ClassVar[str] = "conic-program"

    def __post_init__(self) -> None:
        # The sizes of the defaults follow from these fields.
        known = {"cost": Array(("n",)).coerce("cost", self.cost, {})}
        for name, sign in (("row_lower", -1), ("row_upper", 1)):
            if getattr(self, name) is not None:
                known[name] = Array(("m",), infinity=sign).coerce(name, getattr(self, name), {})
        size = known.pop("cost").size
        rows = next((bound.size for bound in known.values()), 0)
        for name, default in (
            ("hessian", sp.csr_array((size, size))),
            ("matrix", sp.csr_array((0, size))),
            ("row_lower", np.full(rows, -np.inf)),
            ("row_upper", np.full(rows, np.inf)),
            ("column_lower", np.full(size, -np.inf)),
            ("column_upper", np.full(size, np.inf)),
        ):
            if getattr(self, name) is None:
                object.__setattr__(self, name, default)
        super().__post_init__()

    def check(self) -> None:
        """Raise if the blocks do not cover the program, or the Hessian cannot be convex."""
        super().check()
        covered = sum(block.size for block in self.cones)
        if covered != self.cone_offset.size:
            raise InvalidData(
                f"cones: the blocks cover {covered} of {self.cone_offset.size}", field="cones"
            )
        _ = self.quadratic

    def outline(self) -> str:
        """Return the size in a few words."""
        kinds: Counter[str] = Counter()
        for block in self.cones:
            kinds[block.kind] += block.count
        cones = ", ".join(f"{count} {kind}" for kind, count in kinds.items()) or "no"
        return f"{self.row_count} rows, {self.size} columns, {cones} cones"

    @cached_property
    def quadratic(self) -> QuadraticProgram:
        """The program without its cones."""
        return QuadraticProgram(hessian=self.hessian, **self.shared())

    @property
    def conditions(self) -> tuple[Block, ...]:
        """Blocks that :meth:`without_rows` can remove: those of rows and of cones."""
        return (*self.rows, *self.cones)

    def without_rows(self, names: Iterable[str]) -> Self:
        """Return the program without the blocks of rows and of cones called `names`."""
        drop = block_names(names)
        reduced = super().without_rows(drop)
        take, cones = without(self.cones, drop)
        matrix, offset = self.cone_matrix[take], self.cone_offset[take]
        return replace(reduced, cone_matrix=matrix, cone_offset=offset, cones=cones)

    def objective(self, point: Vector) -> float:
        """Return the objective at `point`."""
        return self.quadratic.objective(point)

    def cone_rows(self, point: Vector) -> Vector:
        """Return ``cone_matrix @ point + cone_offset``."""
        rows: Vector = self.cone_matrix @ point + self.cone_offset
        return rows

    @np.errstate(all="ignore")  # overflow gives inf or NaN, which is a violation
    def verify(self, plan: Vector, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the objective and the worst violation of every block of rows, columns and cones.

        The violation of a second-order cone is ``|y| - t``, that of a semidefinite cone the negated smallest
        eigenvalue, and that of an exponential cone the change of an entry that reaches the cone. Its tolerance
        is relative to the largest of the terms and constants of its rows.
        """
        linear = super().verify(plan, tolerance=tolerance)
        point = self._point(plan)
        values = self.cone_rows(point)
        terms = row_sizes(self.cone_matrix, point, self._column_sizes)
        terms = np.maximum(terms, np.abs(self.cone_offset))
        checks = [
            Check.largest(
                block.name, missing(block.kind, block.of(values)), block.of(terms).max(axis=1),
                block.unit, block.place, tolerance, equation=block.equation,
            )
            for block in self.cones
        ]  # fmt: skip
        return replace(linear, checks=(*linear.checks, *checks))

    def split(self, duals: Vector) -> tuple[Vector, Vector]:
        """Return the multipliers of the rows and of the cone rows; the latter are 0 if `duals` omits them."""
        y = np.asarray(duals, float)
        if y.shape == (self.row_count,):
            y = np.concatenate([y, np.zeros(self.cone_offset.size)])
        shape = (self.row_count + self.cone_offset.size,)
        if y.shape != shape:
            raise InvalidData(
                f"duals must have shape {shape}: the rows, then the cone rows; got {y.shape}",
                field="duals",
            )
        return y[: self.row_count], y[self.row_count :]

    def joined(self, duals: Vector) -> Vector:
        """Return the multipliers of the rows and of the cone rows as one vector; see :meth:`split`."""
        return np.concatenate(self.split(duals))

    def signed(self, duals: Vector) -> Vector:
        """Return `duals` with the multipliers of cone rows moved into the dual cones.

        A multiplier of a row bound that does not exist becomes 0.
        """
        rows, cones = self.split(duals)
        moved = [inside_dual(block.kind, block.of(cones)).ravel() for block in self.cones]
        return np.concatenate([self.quadratic.signed(rows), *moved])

    def relaxed(self, duals: Vector) -> QuadraticProgram:
        """Return the program with its cone constraints in the objective, weighted with `duals`.

        If the multipliers are in the dual cones, its optimum is a lower bound for this program.
        """
        weights = self.split(duals)[1]
        return replace(
            self.quadratic,
            cost=self.cost - self.cone_matrix.T @ weights,
            offset=self.offset - float(weights @ self.cone_offset),
        )

    def dual_residual(self, point: Vector, duals: Vector) -> float:
        """Return the largest absolute reduced cost of a column without a bound on that side."""
        y = self.signed(duals)
        return self.relaxed(y).dual_residual(point, y[: self.row_count])

    def dual_bound(self, duals: Vector, point: Vector) -> float:
        """Return the lower bound that multipliers prove: that of :meth:`relaxed` at `point`.

        The multipliers are first moved into the dual cones, so that the bound is as rigorous as
        :meth:`.QuadraticProgram.dual_bound`.

        Parameters
        ----------
        duals : ndarray, shape (m,) or (m + k,)
            Multipliers of the rows, optionally followed by those of the cone rows.
        point : ndarray, shape (n,)
            Point of the multipliers.
        """
        y = self.signed(duals)
        return self.relaxed(y).dual_bound(y[: self.row_count], point)

    def to_cvxpy(self) -> tuple[cvxpy.Problem, cvxpy.Variable]:
        """Return a ``cvxpy.Problem`` and its variable, the column vector in the same order.

        The constraints of the rows and columns come first, as for a quadratic program. They are
        followed by one constraint per block of second-order or exponential cones and one per
        semidefinite cone.
        """
        from .export_conic import cvxpy_cones

        problem, x = self.quadratic.to_cvxpy()
        return cvxpy_cones(problem, x, self.cone_matrix, self.cone_offset, self.cones), x
