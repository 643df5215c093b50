"""Conic programs: linear rows and rows in second-order, exponential and semidefinite cones."""

from __future__ import annotations

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

    ``row_lower <= matrix @ x <= row_upper`` holds as in a
    :class:`~crosstrack.models.programs.QuadraticProgram`, and ``cone_matrix @ x + cone_offset``
    lies in the product of the cones. Its multipliers are one vector: those of the rows first, then
    those of the cone rows, which lie in the dual cones.

    Parameters
    ----------
    cost : ndarray, shape (n,)
        Linear objective coefficients.
    cone_matrix : sparse array, shape (k, n)
        Coefficients of the cone rows.
    cone_offset : ndarray, shape (k,)
        Constants of the cone rows.
    cones : tuple of ConeBlock
        Which cones the cone rows lie in; they cover all of them in order.
    hessian : sparse array, shape (n, n), optional
        As in a quadratic program; none makes the objective linear.
    matrix : sparse array, shape (m, n), optional
        Row coefficients; no rows by default.
    row_lower, row_upper : ndarray, shape (m,), optional
        Row bounds; infinite where there is none. With rows, one of them is needed.
    column_lower, column_upper : ndarray, shape (n,), optional
        Column bounds; infinite where there is none, which is the default.
    offset : float
        Constant of the objective.
    columns, rows : tuple of Block
        Names and equations; empty, or covering all.
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
        # What these two are is what the others have by default.
        given = {"cost": Array(("n",)).coerce("cost", self.cost, {})}
        for name, sign in (("row_lower", -1), ("row_upper", 1)):
            if getattr(self, name) is not None:
                given[name] = Array(("m",), infinity=sign).coerce(name, getattr(self, name), {})
        size = given.pop("cost").size
        rows = next((bound.size for bound in given.values()), 0)
        for name, nothing in (
            ("hessian", sp.csr_array((size, size))),
            ("matrix", sp.csr_array((0, size))),
            ("row_lower", np.full(rows, -np.inf)),
            ("row_upper", np.full(rows, np.inf)),
            ("column_lower", np.full(size, -np.inf)),
            ("column_upper", np.full(size, np.inf)),
        ):
            if getattr(self, name) is None:
                object.__setattr__(self, name, nothing)
        super().__post_init__()

    def check(self) -> None:
        """Refuse blocks that do not cover the program, and a Hessian that cannot be convex."""
        super().check()
        covered = sum(block.size for block in self.cones)
        if covered != self.cone_offset.size:
            raise InvalidData(
                f"cones: the blocks cover {covered} of {self.cone_offset.size}", field="cones"
            )
        _ = self.quadratic

    def describe(self) -> str:
        """Return the size in a few words."""
        kinds: dict[str, int] = {}
        for block in self.cones:
            kinds[block.kind] = kinds.get(block.kind, 0) + block.count
        cones = ", ".join(f"{count} {kind}" for kind, count in kinds.items()) or "no"
        return f"{self.row_count} rows, {self.size} columns, {cones} cones"

    @cached_property
    def quadratic(self) -> QuadraticProgram:
        """The program without its cones."""
        fields = (name for name, _ in QuadraticProgram._specs())
        return QuadraticProgram(**{name: getattr(self, name) for name in fields})

    @property
    def conditions(self) -> tuple[Block, ...]:
        """The blocks of rows and of cones."""
        return (*self.rows, *self.cones)

    def without_rows(self, names: Iterable[str]) -> Self:
        """Return the program without the blocks of rows and of cones called `names`."""
        drop = block_names(names)
        fewer = super().without_rows(drop)
        take, cones = without(self.cones, drop)
        return replace(
            fewer,
            cone_matrix=self.cone_matrix[take],
            cone_offset=self.cone_offset[take],
            cones=cones,
        )

    def objective(self, point: Vector) -> float:
        """Return the objective at `point`."""
        return self.quadratic.objective(point)

    def cone_rows(self, point: Vector) -> Vector:
        """Return ``cone_matrix @ point + cone_offset``."""
        rows: Vector = self.cone_matrix @ point + self.cone_offset
        return rows

    @np.errstate(all="ignore")  # what overflows is no number, and so is violated
    def verify(self, plan: Vector, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the objective and the worst violation of every block of rows, columns and cones.

        How far a vector is outside of a cone is what
        :func:`~crosstrack.models.programs.cones.missing` measures. The tolerance of a cone is
        relative to the largest of the terms and constants of its rows.
        """
        found = super().verify(plan, tolerance=tolerance)
        point = self._point(plan)
        values = self.cone_rows(point)
        terms = row_sizes(self.cone_matrix, point, self._column_sizes)
        terms = np.maximum(terms, np.abs(self.cone_offset))
        checks = []
        for block in self.cones:
            off = missing(block.kind, block.of(values))
            scale = block.of(terms).max(axis=1)
            at = int((off / scale).argmax())
            checks.append(
                Check.scaled(
                    block.name, block.equation, off[at], block.unit, block.place(at), tolerance,
                    scale[at],
                )
            )  # fmt: skip
        return Verification(found.objective, (*found.checks, *checks))

    def split(self, duals: Vector) -> tuple[Vector, Vector]:
        """Return the multipliers of the rows, and those of the cone rows: 0 where only rows have some."""
        y = np.asarray(duals, float)
        if y.shape == (self.row_count,):
            y = np.concatenate([y, np.zeros(self.cone_offset.size)])
        if y.shape != (self.row_count + self.cone_offset.size,):
            raise InvalidData(
                f"duals must have shape ({self.row_count + self.cone_offset.size},): the rows, "
                f"then the cone rows; got {y.shape}",
                field="duals",
            )
        return y[: self.row_count], y[self.row_count :]

    def signed(self, duals: Vector) -> Vector:
        """Return `duals` with those of the cone rows moved into the dual cones.

        In place of a row's that points at a bound which does not exist stands 0.
        """
        rows, cones = self.split(duals)
        moved = [inside_dual(block.kind, block.of(cones)).ravel() for block in self.cones]
        return np.concatenate([self.quadratic.signed(rows), *moved])

    def relaxed(self, duals: Vector) -> QuadraticProgram:
        """Return the program with its cones as part of the objective, weighted with `duals`.

        With multipliers in the dual cones, its optimum is a lower bound on this program's.
        """
        weights = self.split(duals)[1]
        return replace(
            self.quadratic,
            cost=self.cost - self.cone_matrix.T @ weights,
            offset=self.offset - float(weights @ self.cone_offset),
        )

    def dual_residual(self, point: Vector, duals: Vector) -> float:
        """Return the largest reduced cost that no bound of its column explains."""
        y = self.signed(duals)
        return self.relaxed(y).dual_residual(point, y[: self.row_count])

    def dual_bound(self, duals: Vector, point: Vector) -> float:
        """Return the lower bound that multipliers prove: that of :meth:`relaxed` at `point`.

        Multipliers are first moved into the dual cones, so that the bound is as rigorous as
        :meth:`.QuadraticProgram.dual_bound` is.
        """
        y = self.signed(duals)
        return self.relaxed(y).dual_bound(y[: self.row_count], point)

    def to_cvxpy(self) -> tuple[cvxpy.Problem, cvxpy.Variable]:
        """Return a ``cvxpy.Problem`` and its variable, the column vector in this order.

        The constraints are those of the rows and columns, as of a quadratic program, and then one
        for every block of second-order or exponential cones, and for every semidefinite cone.
        """
        from .export_conic import cvxpy_cones

        problem, x = self.quadratic.to_cvxpy()
        return cvxpy_cones(problem, x, self.cone_matrix, self.cone_offset, self.cones), x
