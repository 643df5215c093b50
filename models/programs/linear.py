"""Mixed-integer and quadratic programs, whose rows and columns carry the paper's equations.

A program is a model, with data, a digest and an independent verification. Its plan is the column
vector. Backends for programs therefore also solve programs without a paper.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Optional, Real, declared
from .base import BlockProgram, Program, RowProgram, row_maxima
from .blocks import Block, Blocks, Sparse
from .curvature import CURVATURE, LARGEST_DENSE, least_curvature
from .nonlinear import NonlinearProgram

if TYPE_CHECKING:
    import qpsolvers

__all__ = [
    "Block",
    "BlockProgram",
    "MixedIntegerProgram",
    "NonlinearProgram",
    "Program",
    "QuadraticProgram",
    "RowProgram",
]

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class MixedIntegerProgram(RowProgram):
    """Minimise ``cost @ x + offset`` with ``row_lower <= matrix @ x <= row_upper`` and bounds.

    Parameters
    ----------
    cost : ndarray, shape (n,)
        Objective coefficients.
    matrix : sparse array, shape (m, n)
        Row coefficients.
    row_lower, row_upper : ndarray, shape (m,)
        Row bounds; infinite for none.
    column_lower, column_upper : ndarray, shape (n,)
        Column bounds; infinite for none.
    integral : ndarray of bool, shape (n,)
        Columns that must be integers.
    offset : float
        Constant of the objective.
    columns, rows : tuple of Block
        Names and equations; either empty or a complete cover.
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

    def outline(self) -> str:
        """Return the size in a few words."""
        return f"{self.row_count} rows, {self.size} columns, {int(self.integral.sum())} integral"

    def objective(self, point: Vector) -> float:
        """Return the objective at `point`."""
        return float(self.cost @ point + self.offset)

    @property
    def preferred_backend(self) -> str:
        """Backend for linear and mixed-integer programs: HiGHS."""
        return "highs"

    def lower(self) -> QuadraticProgram | None:
        """Return a linear program as a quadratic one, for solvers of those; None if a column is integral."""
        return self._quadratic if self.continuous else None

    @cached_property
    def _quadratic(self) -> QuadraticProgram:
        return QuadraticProgram(hessian=sp.csr_array((self.size, self.size)), **self.shared())

    def dual_bound(self, duals: Vector, point: Vector | None = None) -> float:
        """Return the Lagrangian lower bound that row multipliers prove, see :meth:`.Program.dual_bound`.

        The bound holds for the linear relaxation, so it holds for the program, and does not depend on the point.
        It is -inf if a multiplier or a reduced cost belongs to a bound that does not exist.

        Parameters
        ----------
        duals : ndarray, shape (m,)
            Row multipliers.
        point : ndarray, optional
            Unused.
        """
        y = np.asarray(duals, float)
        reduced = self.cost - self.matrix.T @ y
        # A reduced cost within the rounding noise of its terms must not meet an infinite bound.
        noise = 1e-9 * (1 + np.abs(self.cost) + abs(self.matrix).T @ np.abs(y))
        free = np.where(
            reduced > 0, ~np.isfinite(self.column_lower), ~np.isfinite(self.column_upper)
        )
        reduced = np.where(free & (np.abs(reduced) <= noise), 0.0, reduced)
        loose = np.where(y > 0, ~np.isfinite(self.row_lower), ~np.isfinite(self.row_upper))
        y = np.where(loose & (np.abs(y) <= 1e-9), 0.0, y)
        with np.errstate(invalid="ignore"):
            bounds = np.where(reduced > 0, self.column_lower, self.column_upper)
            columns = np.where(reduced == 0, 0.0, reduced * bounds)
        return float(self.row_terms(y).sum() + columns.sum() + self.offset)

    def relaxed(self) -> MixedIntegerProgram:
        """Return the linear relaxation."""
        return replace(self, integral=np.zeros(self.size, bool))

    def to_mps(self) -> str:
        """Return the program in free MPS; columns are ``x0, x1, …``, rows ``r0, r1, …``."""
        from .export import mps_lines

        return "\n".join(mps_lines(self)) + "\n"

    def to_lp(self) -> str:
        """Return the program in LP format; columns are ``x0, x1, …``, rows ``r0, r1, …``."""
        from .export import lp_lines

        return "\n".join(lp_lines(self)) + "\n"


@dataclass(frozen=True, eq=False, repr=False)
class QuadraticProgram(RowProgram):
    """Minimise ``x @ hessian @ x / 2 + cost @ x + offset`` under linear rows and bounds.

    Parameters
    ----------
    hessian : sparse array, shape (n, n)
        Symmetric positive semidefinite matrix with both triangles. Symmetry and the 2 x 2 minors
        are checked; the caller guarantees full definiteness.
    cost : ndarray, shape (n,)
        Linear objective coefficients.
    matrix : sparse array, shape (m, n)
        Row coefficients.
    row_lower, row_upper : ndarray, shape (m,)
        Row bounds; infinite for none.
    column_lower, column_upper : ndarray, shape (n,)
        Column bounds; infinite for none.
    offset : float
        Constant of the objective.
    columns, rows : tuple of Block
        Names and equations; either empty or a complete cover.
    integral : ndarray of bool, shape (n,), optional
        Columns that must be integers; none by default.
    """

    hessian: sp.csr_array = declared(Sparse(("n", "n")))
    cost: Vector = declared(Array(("n",)))
    matrix: sp.csr_array = declared(Sparse(("m", "n")))
    row_lower: Vector = declared(Array(("m",), infinity=-1))
    row_upper: Vector = declared(Array(("m",), infinity=1))
    column_lower: Vector = declared(Array(("n",), infinity=-1))
    column_upper: Vector = declared(Array(("n",), infinity=1))
    offset: float = declared(Real(), default=0.0)
    columns: tuple[Block, ...] = declared(Blocks(), default=())
    rows: tuple[Block, ...] = declared(Blocks(), default=())
    integral: NDArray[np.bool_] | None = declared(
        Optional(Array(("n",), bool)), default=None, added=True
    )

    kind: ClassVar[str] = "quadratic-program"

    def check(self) -> None:
        """Raise if the blocks do not cover the program, or the Hessian cannot be convex."""
        super().check()
        if self.integral is not None and not self.integral.any():
            object.__setattr__(self, "integral", None)
        largest = float(abs(self.hessian).max()) if self.hessian.nnz else 0.0
        skew = abs(self.hessian - self.hessian.T)
        if skew.nnz and skew.max() > 1e-12 * largest:
            row, column = (int(k) for k in np.unravel_index(skew.argmax(), skew.shape))
            raise InvalidData(
                f"hessian[{row}, {column}] is {self.hessian[row, column]:g}, but "
                f"hessian[{column}, {row}] is {self.hessian[column, row]:g}: it must be symmetric",
                field="hessian",
            )
        diagonal = self.hessian.diagonal()
        # 2 x 2 minors with a zero: a negative diagonal entry, or a zero in a nonzero row.
        reach = row_maxima(self.hessian)
        for k in np.flatnonzero((diagonal < 0) | ((diagonal == 0) & (reach > 0))):
            raise InvalidData(
                f"hessian[{k}, {k}] is {diagonal[k]:g}, which no positive semidefinite matrix with that row has",
                field="hessian",
            )

    def outline(self) -> str:
        """Return the size in a few words."""
        return f"{super().outline()}, {self.hessian.nnz} Hessian entries"

    def require_convex(self) -> None:
        """Raise ``InvalidData`` if the Hessian has a negative eigenvalue beyond rounding.

        The smallest eigenvalue may be ``-1e-9`` times the largest entry. The signs of the pivots of a
        symmetric factorisation of the Hessian, shifted by that amount, count the negative eigenvalues
        (Sylvester's law of inertia).
        """
        from scipy.sparse.linalg import splu

        if not self.hessian.nnz:
            return
        shift = CURVATURE * float(abs(self.hessian).max())
        shifted = sp.csc_array(self.hessian + shift * sp.eye_array(self.size))
        options = {"SymmetricMode": True}
        try:
            factors = splu(shifted, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
            symmetric = bool((factors.perm_r == factors.perm_c).all())
            negative = bool((factors.U.diagonal() < 0).any())
        except RuntimeError:  # exactly singular
            symmetric = negative = False
        if symmetric and not negative:
            return
        if not symmetric and self.size > LARGEST_DENSE:
            raise InvalidData("hessian: whether it is convex could not be decided", field="hessian")
        smallest = ""
        if self.size <= LARGEST_DENSE:
            value = float(np.linalg.eigvalsh(self.hessian.toarray())[0])
            if value >= -shift:
                return
            smallest = f", but its smallest eigenvalue is {value:.3g}"
        raise InvalidData(
            f"hessian must be positive semidefinite{smallest or ', but it is not'}: pose a nonconvex program as "
            "a nonlinear one, such as a mapping of CasADi expressions",
            field="hessian",
        )

    @cached_property
    def _least_curvature(self) -> Vector:
        """Proven lower bounds on the curvature; see :func:`.least_curvature`."""
        return least_curvature(self.hessian)

    def relaxed(self) -> QuadraticProgram:
        """Return the program without the condition of integers."""
        return replace(self, integral=None)

    def objective(self, point: Vector) -> float:
        """Return the objective at `point`."""
        return float(0.5 * (point @ (self.hessian @ point)) + self.cost @ point + self.offset)

    def reduced_costs(self, point: Vector, duals: Vector) -> Vector:
        """Return ``hessian @ point + cost - matrix.T @ duals``, the multipliers of the columns.

        At an optimum they are 0 for every column strictly between its bounds.
        """
        reduced: Vector = self.hessian @ point + self.cost - self.matrix.T @ duals
        return reduced

    def dual_residual(self, point: Vector, duals: Vector) -> float:
        """Return the largest absolute reduced cost of a column without a bound on that side."""
        reduced = self.reduced_costs(point, self.signed(duals))
        loose = np.where(
            reduced > 0, ~np.isfinite(self.column_lower), ~np.isfinite(self.column_upper)
        )
        return float(np.abs(reduced[loose]).max(initial=0.0))

    def dual_bound(self, duals: Vector, point: Vector) -> float:
        """Return the lower bound of Dorn's dual at `point`, see :meth:`.Program.dual_bound`.

        Solvers never make the reduced cost of an unbounded column exactly zero. On its unbounded side, such a
        column is therefore limited to a distance of ``max(1, |point|)`` from `point`. The bound is rigorous for
        every x in that box. Points outside cannot be much better either: the objective is convex, so a gain far
        away implies a proportional gain within the box.

        Parameters
        ----------
        duals : ndarray, shape (m,)
            Row multipliers.
        point : ndarray, shape (n,)
            Point of the multipliers.
        """
        p = np.asarray(point, float)
        y = self.signed(duals)
        reduced = self.reduced_costs(p, y)
        reach = np.maximum(1.0, np.abs(p))
        low = np.where(np.isfinite(self.column_lower), self.column_lower, p - reach)
        high = np.where(np.isfinite(self.column_upper), self.column_upper, p + reach)
        # Add the gap to the primal objective, because both terms of the dual are large at small gaps.
        slack = self.row_terms(y) - y * (self.matrix @ p)
        away = reduced * (np.where(reduced > 0, low, high) - p)
        return self.objective(p) + float(slack.sum() + away.sum())

    def to_qpsolvers(self) -> qpsolvers.Problem:
        """Return a ``qpsolvers.Problem`` without the constant of the objective.

        Equality rows come first, then upper and negated lower row bounds as ``G x <= h``.
        """
        from .export import qpsolvers_problem

        return qpsolvers_problem(self)
