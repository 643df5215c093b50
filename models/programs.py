"""Solver-neutral programs in standard form, whose rows and columns know the paper's equations.

A program is a model too: it has data, a digest and an independent verification, and its plan is
the column vector. Any backend for programs therefore solves one that no paper stands behind.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import InvalidData
from .blocks import Block, Blocks, Sparse
from .fields import Array, Real, declared
from .model import Model
from .verification import ROUNDING, TOLERANCE, Check, Verification

if TYPE_CHECKING:
    import cvxpy

__all__ = ["Block", "MixedIntegerProgram", "Program"]

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Program(Model[Vector]):
    """Base of all programs: minimise an objective of a column vector under blocks of rows."""

    def plan_to_data(self, plan: Vector) -> Any:
        """Return the column vector as a list."""
        return np.asarray(plan, float).tolist()

    def plan_from_data(self, data: Any) -> Vector:
        """Return the column vector in `data`."""
        size = self.size
        return Array((size,)).coerce("point", data, {})

    @property
    def size(self) -> int:
        """Number of columns."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False, repr=False)
class MixedIntegerProgram(Program):
    """Minimise ``cost @ x + offset`` with ``row_lower <= matrix @ x <= row_upper`` and bounds.

    Parameters
    ----------
    cost : ndarray, shape (n,)
        Objective coefficients.
    matrix : sparse array, shape (m, n)
        Row coefficients.
    row_lower, row_upper : ndarray, shape (m,)
        Row bounds; infinite where there is none.
    column_lower, column_upper : ndarray, shape (n,)
        Column bounds; infinite where there is none.
    integral : ndarray of bool, shape (n,)
        Which columns must be whole numbers.
    offset : float
        Constant of the objective.
    columns, rows : tuple of Block
        Names and equations; empty, or covering all.
    """

    cost: Vector = declared(Array(("n",)))
    matrix: sp.csr_array = declared(Sparse(("m", "n")))
    row_lower: Vector = declared(Array(("m",), infinity=-1))
    row_upper: Vector = declared(Array(("m",), infinity=1))
    column_lower: Vector = declared(Array(("n",), infinity=-1))
    column_upper: Vector = declared(Array(("n",), infinity=1))
    integral: NDArray[np.bool_] = declared(Array(("n",), bool))
    offset: float = declared(Real(), default=0.0)
    columns: tuple[Block, ...] = declared(Blocks(), default=())
    rows: tuple[Block, ...] = declared(Blocks(), default=())

    kind: ClassVar[str] = "mixed-integer-program"

    def check(self) -> None:
        """Refuse blocks that do not cover the program."""
        for name, blocks, size in (
            ("columns", self.columns, self.size),
            ("rows", self.rows, self.row_count),
        ):
            if blocks and sum(block.size for block in blocks) != size:
                raise InvalidData(
                    f"{name}: the blocks cover {sum(b.size for b in blocks)} of {size}", field=name
                )

    def describe(self) -> str:
        """Return the size in a few words."""
        return f"{self.row_count} rows, {self.size} columns, {int(self.integral.sum())} integral"

    @property
    def size(self) -> int:
        """Number of columns."""
        return int(self.cost.size)

    @property
    def row_count(self) -> int:
        """Number of rows."""
        return int(self.row_lower.size)

    @property
    def continuous(self) -> bool:
        """Whether no column must be whole: a linear program."""
        return not self.integral.any()

    def objective(self, point: Vector) -> float:
        """Return the objective at `point`."""
        return float(self.cost @ point + self.offset)

    def verify(self, plan: Vector, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the objective and the worst violation of every block of rows and columns.

        A row's tolerance is relative to the largest of its terms and bounds, and at least absolute.
        """
        point = np.asarray(plan, float)
        if point.shape != (self.size,):
            raise InvalidData(
                f"point must have shape ({self.size},), got {point.shape}", field="point"
            )
        if not np.isfinite(point).all():
            place = int(np.flatnonzero(~np.isfinite(point))[0])
            raise InvalidData(f"point[{place}] must be finite, got {point[place]}", field="point")
        terms = self.matrix * point[None, :]
        largest = (
            abs(terms).max(axis=1).toarray().ravel()
            if self.row_count and terms.nnz
            else np.zeros(self.row_count)
        )
        checks = [
            *self._checks(
                self.matrix @ point, self.row_lower, self.row_upper, largest, self._rows, tolerance
            ),
            *self._checks(
                point,
                self.column_lower,
                self.column_upper,
                np.zeros(self.size),
                self._columns,
                tolerance,
            ),
        ]
        if self.integral.any():
            off = np.where(self.integral, np.abs(point - np.round(point)), 0.0)
            at = int(off.argmax())
            checks.append(
                Check(
                    "integrality", "", float(off[at]), "", tolerance, self.column_name(at), ROUNDING
                )
            )
        return Verification(self.objective(point), tuple(checks))

    @property
    def _rows(self) -> tuple[Block, ...]:
        return self.rows or ((Block("row", "", 0, self.row_count),) if self.row_count else ())

    @property
    def _columns(self) -> tuple[Block, ...]:
        return self.columns or ((Block("column", "", 0, self.size),) if self.size else ())

    @staticmethod
    def _checks(
        value: Vector,
        lower: Vector,
        upper: Vector,
        largest: Vector,
        blocks: Sequence[Block],
        tolerance: float,
    ) -> list[Check]:
        off = np.maximum(np.maximum(lower - value, value - upper), 0.0)
        near = np.where(value - lower < upper - value, lower, upper)
        scale = np.maximum(np.maximum(largest, np.where(np.isfinite(near), np.abs(near), 0.0)), 1.0)
        found = []
        for block in blocks:
            if block.size:
                entry = int((off[block.slice] / scale[block.slice]).argmax())
                at = block.start + entry
                found.append(
                    Check(
                        block.name,
                        block.equation,
                        float(off[at]),
                        block.unit,
                        float(tolerance * scale[at]),
                        block.place(entry).removeprefix("at ").removeprefix("along "),
                        float(ROUNDING * scale[at]),
                    )
                )
        return found

    def row_name(self, row: int) -> str:
        """Return the row in the paper's words."""
        return _name(self._rows, row)

    def column_name(self, column: int) -> str:
        """Return the column in the paper's words."""
        return _name(self._columns, column)

    def column_block(self, name: str) -> Block:
        """Return the block of columns called `name`."""
        return next(block for block in self.columns if block.name == name)

    def dual_bound(self, duals: Vector) -> float:
        """Return the Lagrangian lower bound that row multipliers prove.

        ``duals[i] >= 0`` counts against the lower bound of row i, ``<= 0`` against the upper one.
        The bound holds for the linear relaxation, and so for the program; it is -inf where a
        multiplier or a reduced cost points at a bound that does not exist.
        """
        y = np.asarray(duals, float)
        reduced = self.cost - self.matrix.T @ y
        # A reduced cost that is rounding noise against the terms it sums must not meet an infinite bound.
        noise = 1e-9 * (1 + np.abs(self.cost) + abs(self.matrix).T @ np.abs(y))
        free = np.where(
            reduced > 0, ~np.isfinite(self.column_lower), ~np.isfinite(self.column_upper)
        )
        reduced = np.where(free & (np.abs(reduced) <= noise), 0.0, reduced)
        loose = np.where(y > 0, ~np.isfinite(self.row_lower), ~np.isfinite(self.row_upper))
        y = np.where(loose & (np.abs(y) <= 1e-9), 0.0, y)
        with np.errstate(invalid="ignore"):
            rows = np.where(y == 0, 0.0, y * np.where(y > 0, self.row_lower, self.row_upper))
            cols = np.where(
                reduced == 0,
                0.0,
                reduced * np.where(reduced > 0, self.column_lower, self.column_upper),
            )
        return float(rows.sum() + cols.sum() + self.offset)

    def without_rows(self, names: Iterable[str]) -> MixedIntegerProgram:
        """Return the program without the row blocks called `names`."""
        drop = set(names)
        kept = [block for block in self.rows if block.name not in drop]
        take = np.concatenate(
            [np.arange(b.start, b.start + b.size) for b in kept] or [np.empty(0, int)]
        )
        blocks, at = [], 0
        for block in kept:
            blocks.append(replace(block, start=at))
            at += block.size
        return replace(
            self,
            matrix=self.matrix[take],
            row_lower=self.row_lower[take],
            row_upper=self.row_upper[take],
            rows=tuple(blocks),
        )

    def relaxed(self) -> MixedIntegerProgram:
        """Return the linear relaxation."""
        return replace(self, integral=np.zeros(self.size, bool))

    def to_mps(self) -> str:
        """Return the program in free MPS; columns are ``x0, x1, …``, rows ``r0, r1, …``."""
        from .export import mps

        return mps(self)

    def to_lp(self) -> str:
        """Return the program in LP format; columns are ``x0, x1, …``, rows ``r0, r1, …``."""
        from .export import lp

        return lp(self)

    def to_cvxpy(self) -> tuple[cvxpy.Problem, cvxpy.Variable]:
        """Return a ``cvxpy.Problem`` and its variable, the column vector in this order."""
        from .export import cvxpy_problem

        return cvxpy_problem(self)


def _name(blocks: Sequence[Block], entry: int) -> str:
    for block in blocks:
        if block.start <= entry < block.start + block.size:
            return block.describe(entry - block.start)
    raise IndexError(entry)
