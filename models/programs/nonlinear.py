"""Nonlinear programs in standard form, on a ``casadi.Function``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Optional, Real, declared, frozen
from ..verification import TOLERANCE, Verification
from .base import BlockProgram
from .blocks import Block, Blocks
from .compiled import Compiled

if TYPE_CHECKING:
    import casadi
    import scipy.sparse as sp

__all__ = ["NonlinearProgram"]

Vector = NDArray[np.float64]

#: Perturbations of a guess with non-finite derivatives, relative to the columns' sizes.
STEPS = (1e-4, 1e-2)


@dataclass(frozen=True, eq=False, repr=False)
class NonlinearProgram(BlockProgram):
    """Minimise ``f(x)`` with ``row_lower <= g(x) <= row_upper`` and column bounds, from a guess.

    Parameters
    ----------
    function : casadi.Function
        ``(x) -> (f, g)``, with x of shape (n,), f a number, g of shape (m,).
    row_lower, row_upper : ndarray, shape (m,)
        Row bounds; infinite for none.
    column_lower, column_upper : ndarray, shape (n,)
        Column bounds; infinite for none.
    guess : ndarray, shape (n,)
        Start of a search.
    column_scale : ndarray, shape (n,), optional
        Typical size of each column, positive; default 1. Solvers work on ``x / column_scale``.
    row_scale : ndarray, shape (m,), optional
        Typical size of each row, positive; default 1.
    objective_scale : float
        Typical size of the objective, positive.
    derivatives : casadi.Function, optional
        ``(x) -> (grad_f, jac_g)``: gradient (n,) and sparse Jacobian (m, n). Useful if their
        structure is known better than to automatic differentiation. Excluded from the digest.
    hessian : casadi.Function, optional
        ``(x, lam_f, lam_g) -> (hess)``: the upper triangle of the Hessian of ``lam_f f + lam_g·g``,
        sparse (n, n). Excluded from the digest.
    columns, rows : tuple of Block
        Names and equations; either empty or a complete cover.
    integral : ndarray of bool, shape (n,), optional
        Columns that must be integers; none by default.
    """

    function: casadi.Function = declared(Compiled(("x",), ("f", "g")))
    row_lower: Vector = declared(Array(("m",), infinity=-1))
    row_upper: Vector = declared(Array(("m",), infinity=1))
    column_lower: Vector = declared(Array(("n",), infinity=-1))
    column_upper: Vector = declared(Array(("n",), infinity=1))
    guess: Vector = declared(Array(("n",)))
    column_scale: Vector = declared(Optional(Array(("n",))), default=None)
    row_scale: Vector = declared(Optional(Array(("m",))), default=None)
    objective_scale: float = declared(Real(0.0, strict=True), default=1.0)
    derivatives: casadi.Function | None = declared(
        Optional(Compiled(("x",), ("grad_f", "jac_g"), content=False)), default=None
    )
    hessian: casadi.Function | None = declared(
        Optional(Compiled(("x", "lam_f", "lam_g"), ("hess",), content=False)), default=None
    )
    columns: tuple[Block, ...] = declared(Blocks(), default=())
    rows: tuple[Block, ...] = declared(Blocks(), default=())
    integral: NDArray[np.bool_] | None = declared(
        Optional(Array(("n",), bool)), default=None, added=True
    )

    kind: ClassVar[str] = "nonlinear-program"

    def check(self) -> None:
        """Fill in the scales, and raise if shapes or bounds contradict one another."""
        n, m = self.size, self.row_count
        for name, actual, expected in (
            ("x", self.function.size_in(0), (n, 1)),
            ("f", self.function.size_out(0), (1, 1)),
            ("g", self.function.size_out(1), (m, 1)),
        ):
            # CasADi writes empty vectors in several shapes.
            if tuple(actual) != expected and not (0 in actual and 0 in expected):
                raise InvalidData(
                    f"function: {name} must have shape {expected}, got {tuple(actual)}",
                    field="function",
                )
        for name, size in (("column_scale", n), ("row_scale", m)):
            if getattr(self, name) is None:
                object.__setattr__(self, name, frozen(np.ones(size)))
            scale = getattr(self, name)
            for k in np.flatnonzero(scale <= 0):
                raise InvalidData(f"{name}[{k}] must be > 0, got {scale[k]}", field=name)
        for what in ("column", "row"):
            lower, upper = getattr(self, f"{what}_lower"), getattr(self, f"{what}_upper")
            for k in np.flatnonzero(lower > upper):
                raise InvalidData(
                    f"{what}_lower[{k}] = {lower[k]:g} exceeds {what}_upper[{k}] = {upper[k]:g}",
                    field=f"{what}_lower",
                )
        super().check()
        if self.integral is not None and not self.integral.any():
            object.__setattr__(self, "integral", None)

    def outline(self) -> str:
        """Return the size in a few words."""
        return f"{super().outline()}, nonlinear"

    # -- values ----------------------------------------------------------------------------------

    def values(self, point: Vector) -> tuple[float, Vector]:
        """Return the objective and the rows at `point`."""
        f, g = self.function(np.asarray(point, float))
        return float(f), np.array(g, float).reshape(-1)

    def objective(self, point: Vector) -> float:
        """Return the objective at `point`."""
        return self.values(point)[0]

    @np.errstate(all="ignore")  # overflow gives inf or NaN, which is a violation
    def verify(self, plan: Vector, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the objective and the worst violation of every block and of integrality.

        A tolerance is relative to the bound, or to the typical size of the row or column if that is
        larger. The size of a column is capped at 1.
        """
        point = self._point(plan)
        objective, rows = self.values(point)
        rows = np.where(np.isfinite(rows), rows, np.inf)
        columns = np.minimum(self.column_scale, 1.0)
        checks = self._checks(point, rows, self.row_scale, columns, tolerance)
        value = objective if np.isfinite(objective) else None
        scale = min(self.objective_scale, 1.0)
        return Verification(value, checks, scale=scale, maximise=self.maximise)

    def violations(self, point: Vector) -> Vector:
        """Return the violation of each row at `point` relative to its typical size, shape (m,)."""
        rows = self.values(point)[1]
        amount = np.maximum(np.maximum(self.row_lower - rows, rows - self.row_upper), 0.0)
        return np.where(np.isfinite(rows), amount, np.inf) / self.row_scale

    # -- derivatives -----------------------------------------------------------------------------

    @cached_property
    def first_order(self) -> casadi.Function:
        """``(x) -> (grad_f, jac_g)``: `derivatives`, or by automatic differentiation."""
        if self.derivatives is not None:
            return self.derivatives
        import casadi

        x = casadi.MX.sym("x", self.size)
        f, g = self.function(x)
        parts = [casadi.gradient(f, x), casadi.jacobian(g, x)]
        return casadi.Function("first_order", [x], parts, ["x"], ["grad_f", "jac_g"])

    @cached_property
    def second_order(self) -> casadi.Function:
        """``(x, lam_f, lam_g) -> (hess)``: `hessian`, or by automatic differentiation."""
        if self.hessian is not None:
            return self.hessian
        import casadi

        x, scale = casadi.MX.sym("x", self.size), casadi.MX.sym("lam_f")
        duals = casadi.MX.sym("lam_g", self.row_count)
        f, g = self.function(x)
        lagrangian = scale * f + casadi.dot(duals, g)
        upper = casadi.triu(casadi.hessian(lagrangian, x)[0])
        names = ["x", "lam_f", "lam_g"], ["hess"]
        return casadi.Function("second_order", [x, scale, duals], [upper], *names)

    def linearised(self, point: Vector) -> tuple[Vector, sp.csc_array]:
        """Return the gradient of the objective, shape (n,), and the Jacobian of the rows, shape (m, n)."""
        import scipy.sparse as sp

        gradient, jacobian = self.first_order(np.asarray(point, float))
        return np.array(gradient, float).reshape(-1), sp.csc_array(jacobian.sparse())

    def jacobian(self, point: Vector) -> sp.csc_array:
        """Return the Jacobian of the rows at `point`, sparse, shape (m, n)."""
        return self.linearised(point)[1]

    def gradient(self, point: Vector) -> Vector:
        """Return the gradient of the objective at `point`, shape (n,)."""
        return self.linearised(point)[0]

    def reduced_costs(self, point: Vector, duals: Vector) -> Vector:
        """Return ``∇f - duals·∇g``, the multipliers of the columns, with the signs of linear duals.

        ``duals[i] >= 0`` belongs to the lower bound of row i, ``<= 0`` to the upper bound.
        """
        gradient, jacobian = self.linearised(point)
        reduced: Vector = gradient - jacobian.T @ np.asarray(duals, float)
        return reduced

    def stationarity(self, point: Vector, duals: Vector, reduced: Vector | None = None) -> float:
        """Return the largest scaled reduced cost without an active bound.

        A positive reduced cost is admissible at the column's lower bound, a negative one at the upper
        bound. The others are divided by ``objective_scale / column_scale``. `reduced` are the reduced
        costs, if they are known.
        """
        p = np.asarray(point, float)
        reduced = self.reduced_costs(p, duals) if reduced is None else reduced
        reach = 1e-6 * np.maximum(np.abs(p), self.column_scale)
        at_lower = p - self.column_lower <= reach
        at_upper = self.column_upper - p <= reach
        explained = np.where(reduced > 0, at_lower, at_upper)
        left = np.where(explained, 0.0, np.abs(reduced)) * self.column_scale / self.objective_scale
        return float(left.max(initial=0.0))

    def start(self, seed: int | None = None) -> Vector:
        """Return the start of a search: the guess, or a random point near it.

        Parameters
        ----------
        seed : int, optional
            None or 0 for the guess, moved into the bounds, and slightly further if a derivative is not
            finite there, for example that of a square root at 0. Any other seed draws each column uniformly:
            between its bounds if it has both, otherwise within its typical size of the guess.

        Returns
        -------
        ndarray, shape (n,)
            The start, within the bounds.
        """
        low, high = self.column_lower, self.column_upper
        if not seed:
            return self._regular(np.clip(self.guess, low, high))
        draw = np.random.default_rng(seed).uniform(-1.0, 1.0, self.size)
        both = np.isfinite(low) & np.isfinite(high)
        with np.errstate(invalid="ignore"):
            middle = np.where(both, 0.5 * (low + high), self.guess)
            reach = np.where(both, 0.5 * (high - low), self.column_scale)
        return np.clip(middle + reach * draw, low, high)

    def _regular(self, point: Vector) -> Vector:
        """Return `point`, or a point near it with finite derivatives."""
        draw = np.random.default_rng(0).uniform(-1.0, 1.0, self.size)
        for step in (0.0, *STEPS):
            near = point + step * self.column_scale * draw
            near = np.clip(near, self.column_lower, self.column_upper)
            if all(part.is_regular() for part in self.first_order(near)):
                return near
        return point

    def to_casadi(self) -> dict[str, Any]:
        """Return the program in the form of ``casadi.nlpsol``: ``{"x", "f", "g"}`` in MX symbols.

        The bounds ``lbx, ubx, lbg, ubg`` are arguments of the solver's call, see
        :meth:`casadi_arguments`.
        """
        import casadi

        x = casadi.MX.sym("x", self.size)
        f, g = self.function(x)
        return {"x": x, "f": f, "g": g}

    def casadi_arguments(self) -> dict[str, Vector]:
        """Return guess and bounds as the arguments of ``casadi.nlpsol``: ``x0, lbx, ubx, lbg, ubg``.

        With :meth:`to_casadi` they pass the program to CasADi alone.
        """
        return {
            "x0": self.start(),
            "lbx": self.column_lower.copy(),
            "ubx": self.column_upper.copy(),
            "lbg": self.row_lower.copy(),
            "ubg": self.row_upper.copy(),
        }

    def to_c(self, name: str = "program") -> str:
        """Return C code of the program with CasADi's interface and without dependencies.

        The functions are `name` (x → f, g), and with the endings ``_first`` (x → grad_f, jac_g),
        ``_second`` (x, lam_f, lam_g → the upper triangle of the Hessian of lam_f f + lam_g·g) and
        ``_arguments`` (→ x0, lbx, ubx, lbg, ubg).

        Parameters
        ----------
        name : str
            Name of the first function.

        Raises
        ------
        InvalidData
            `name` is not a valid name of a C function.
        UnsupportedFormulation
            A function has no C code, such as a callback.
        """
        from .export import c_code

        return c_code(self, name)
