"""Nonlinear program in the units of its solvers, with columns, rows and objective of size 1."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...models.programs.nonlinear import NonlinearProgram

if TYPE_CHECKING:
    import casadi

__all__ = ["Scaled"]

Vector = NDArray[np.float64]


class Scaled:
    """Program in ``z = x / column_scale``, rows ``g / row_scale``, objective ``f / objective_scale``.

    Its functions take ``(x, p)`` in CasADi's names, with z as x and no parameters p, so that
    ``nlpsol`` can use them. Scales of 1 are free; others cost one product per nonzero.

    Parameters
    ----------
    program : NonlinearProgram
        The program.
    """

    def __init__(self, program: NonlinearProgram) -> None:
        self.program = program
        self._columns = _unless_one(program.column_scale)
        self._rows = _unless_one(program.row_scale)
        self._objective = program.objective_scale

    # -- numbers ---------------------------------------------------------------------------------

    def start(self, point: Vector) -> Vector:
        """Return the column vector `point` in the solver's units."""
        return point if self._columns is None else point / self._columns

    def point(self, z: Vector) -> Vector:
        """Return the solver's `z` as a column vector of the program."""
        return z if self._columns is None else z * self._columns

    def duals(self, multipliers: Vector) -> Vector:
        """Return the program's multipliers from CasADi's multipliers of the scaled rows."""
        return -multipliers * self._objective / self.program.row_scale

    def multipliers(self, point: Vector, duals: Vector) -> dict[str, Vector]:
        """Return CasADi's multipliers of the scaled rows and columns, ``lam_g0`` and ``lam_x0``."""
        p = self.program
        reduced = p.reduced_costs(point, duals)
        bound = np.minimum(point - p.column_lower, p.column_upper - point) <= 1e-6 * p.column_scale
        return {
            "lam_g0": -duals * p.row_scale / self._objective,
            "lam_x0": np.where(bound, -reduced * p.column_scale / self._objective, 0.0),
        }

    @property
    def bounds(self) -> dict[str, Vector]:
        """Bounds of columns and rows under CasADi's names: ``lbx, ubx, lbg, ubg``."""
        p = self.program
        return {
            "lbx": p.column_lower / p.column_scale,
            "ubx": p.column_upper / p.column_scale,
            "lbg": p.row_lower / p.row_scale,
            "ubg": p.row_upper / p.row_scale,
        }

    # -- functions -------------------------------------------------------------------------------

    @cached_property
    def objective_only(self) -> Any:
        """``(x) -> (f)``, unscaled; separate because line searches evaluate it alone."""
        return _part(self.program.function, ["x"], "f")

    @cached_property
    def rows_only(self) -> Any:
        """``(x) -> (g)``, unscaled."""
        return _part(self.program.function, ["x"], "g")

    def problem(self) -> dict[str, Any]:
        """Return the program in the format of ``nlpsol``: ``{"x", "f", "g"}``."""
        z = self._symbol()
        x = self._unscaled(z)
        return {"x": z, "f": self._f(x), "g": self._g(x)}

    @cached_property
    def gradient(self) -> casadi.Function:
        """``(x, p) -> (f, grad_f_x)``."""
        part = _part(self.program.first_order, ["x"], "grad_f")
        return self._posed(
            "nlp_grad_f", lambda x: {"f": self._f(x), "grad_f_x": self._grad(part(x))}
        )

    @cached_property
    def jacobian(self) -> casadi.Function:
        """``(x, p) -> (g, jac_g_x)``."""
        part = _part(self.program.first_order, ["x"], "jac_g")
        return self._posed("nlp_jac_g", lambda x: {"g": self._g(x), "jac_g_x": self._jac(part(x))})

    @cached_property
    def first_order(self) -> casadi.Function:
        """``(x, p) -> (f, grad_f_x, g, jac_g_x)``, for solvers that evaluate all at once."""

        def parts(x: Any) -> dict[str, Any]:
            f, g = self.program.function(x)
            grad, jac = self.program.first_order(x)
            return {
                "f": f / self._objective,
                "grad_f_x": self._grad(grad),
                "g": self._scaled_rows(g),
                "jac_g_x": self._jac(jac),
            }

        return self._posed("nlp_jac_fg", parts)

    @cached_property
    def hessian(self) -> casadi.Function:
        """``(x, p, lam_f, lam_g) -> (triu_hess_gamma_x_x)``, the upper triangle."""
        return self._hessian("triu_hess_gamma_x_x", lambda upper: upper)

    @cached_property
    def whole_hessian(self) -> casadi.Function:
        """``(x, p, lam_f, lam_g) -> (hess_gamma_x_x)``, both triangles."""
        import casadi

        return self._hessian("hess_gamma_x_x", casadi.triu2symm)

    # -- parts -----------------------------------------------------------------------------------

    def _posed(self, name: str, parts: Callable[[Any], dict[str, Any]]) -> casadi.Function:
        """Return a function of ``(x, p)`` with the results that `parts` computes from unscaled columns."""
        import casadi

        z = self._symbol()
        results = parts(self._unscaled(z))
        return casadi.Function(name, [z, _none()], [*results.values()], ["x", "p"], [*results])

    def _hessian(self, result: str, shape: Callable[[Any], Any]) -> casadi.Function:
        import casadi

        z, weight = self._symbol(), casadi.MX.sym("lam_f")
        duals = casadi.MX.sym("lam_g", self.program.row_count)
        hess = self.program.second_order(
            self._unscaled(z), weight / self._objective, self._scaled_rows(duals)
        )
        if self._columns is not None:
            row, column = _places(hess)
            hess = hess * casadi.DM(hess.sparsity(), self._columns[row] * self._columns[column])
        return casadi.Function(
            "nlp_hess_l",
            [z, _none(), weight, duals],
            [shape(hess)],
            ["x", "p", "lam_f", "lam_g"],
            [result],
        )

    def _symbol(self) -> Any:
        import casadi

        return casadi.MX.sym("x", self.program.size)

    def _unscaled(self, z: Any) -> Any:
        import casadi

        return z if self._columns is None else z * casadi.DM(self._columns)

    def _f(self, x: Any) -> Any:
        return self.objective_only(x) / self._objective

    def _g(self, x: Any) -> Any:
        return self._scaled_rows(self.rows_only(x))

    def _scaled_rows(self, rows: Any) -> Any:
        import casadi

        return rows if self._rows is None else rows * casadi.DM(1.0 / self._rows)

    def _grad(self, grad: Any) -> Any:
        import casadi

        grad = casadi.densify(grad)
        if self._columns is None:
            return grad if self._objective == 1.0 else grad / self._objective
        return grad * casadi.DM(self._columns / self._objective)

    def _jac(self, jac: Any) -> Any:
        import casadi

        if self._columns is None and self._rows is None:
            return jac
        row, column = _places(jac)
        factor = np.ones(row.size) if self._columns is None else self._columns[column]
        if self._rows is not None:
            factor = factor / self._rows[row]
        return jac * casadi.DM(jac.sparsity(), factor)


def _unless_one(scale: Vector) -> Vector | None:
    return None if (scale == 1.0).all() else scale


def _none() -> Any:
    """Return an empty symbol for the parameters."""
    import casadi

    return casadi.MX.sym("p", 0)


def _places(matrix: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    rows, columns = matrix.sparsity().get_triplet()
    return np.asarray(rows, np.int64), np.asarray(columns, np.int64)


def _part(function: Any, arguments: list[str], result: str) -> Any:
    """Return `function` with one of its results only, without the computations of the others.

    A function that is not an expression, such as a user's callback, is kept whole.
    """
    import casadi

    try:
        return function.factory(f"only_{result}", arguments, [result])
    except RuntimeError:
        x = casadi.MX.sym("x", *function.size_in(0))
        index = function.name_out().index(result)
        return casadi.Function(f"only_{result}", [x], [function(x)[index]], arguments, [result])
