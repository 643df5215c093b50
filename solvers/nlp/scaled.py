"""Nonlinear program in the units of its solvers, with columns, rows and objective of size 1."""

from __future__ import annotations

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
    ``nlpsol`` can use them.
    """

    def __init__(self, program: NonlinearProgram) -> None:
        import casadi

        self.program = program
        self._z = casadi.MX.sym("x", program.size)
        #: Columns in the units of the program.
        self._x = self._z * _dm(program.column_scale)

    # -- numbers ---------------------------------------------------------------------------------

    def start(self, point: Vector) -> Vector:
        """Return the column vector `point` in the solver's units."""
        return point / self.program.column_scale

    def point(self, z: Vector) -> Vector:
        """Return the solver's `z` as a column vector of the program."""
        return z * self.program.column_scale

    def duals(self, multipliers: Vector) -> Vector:
        """Return the program's multipliers from CasADi's multipliers of the scaled rows."""
        return -multipliers * self.program.objective_scale / self.program.row_scale

    def multipliers(self, point: Vector, duals: Vector) -> dict[str, Vector]:
        """Return CasADi's multipliers of the scaled rows and columns, ``lam_g0`` and ``lam_x0``."""
        p = self.program
        reduced = p.reduced_costs(point, duals)
        bound = np.minimum(point - p.column_lower, p.column_upper - point) <= 1e-6 * p.column_scale
        return {
            "lam_g0": -duals * p.row_scale / p.objective_scale,
            "lam_x0": np.where(bound, -reduced * p.column_scale / p.objective_scale, 0.0),
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

    def problem(self) -> dict[str, Any]:
        """Return the program in the format of ``nlpsol``: ``{"x", "f", "g"}``."""
        return {"x": self._z, "f": self._f, "g": self._g}

    @cached_property
    def gradient(self) -> casadi.Function:
        """``(x, p) -> (f, grad_f_x)``."""
        grad = _part(self.program.first_order, "grad_f")(self._x)
        return self._function("nlp_grad_f", f=self._f, grad_f_x=self._gradient(grad))

    @cached_property
    def jacobian(self) -> casadi.Function:
        """``(x, p) -> (g, jac_g_x)``."""
        jac = _part(self.program.first_order, "jac_g")(self._x)
        return self._function("nlp_jac_g", g=self._g, jac_g_x=self._jacobian(jac))

    @cached_property
    def first_order(self) -> casadi.Function:
        """``(x, p) -> (f, grad_f_x, g, jac_g_x)``, for solvers that evaluate all at once."""
        f, g = self.program.function(self._x)
        grad, jac = self.program.first_order(self._x)
        return self._function(
            "nlp_jac_fg", f=f / self.program.objective_scale, grad_f_x=self._gradient(grad),
            g=self._rows(g), jac_g_x=self._jacobian(jac),
        )  # fmt: skip

    @cached_property
    def hessian(self) -> casadi.Function:
        """``(x, p, lam_f, lam_g) -> (triu_hess_gamma_x_x)``, the upper triangle."""
        multipliers, upper = self._hessian
        return self._function("nlp_hess_l", multipliers, triu_hess_gamma_x_x=upper)

    @cached_property
    def whole_hessian(self) -> casadi.Function:
        """``(x, p, lam_f, lam_g) -> (hess_gamma_x_x)``, both triangles."""
        import casadi

        multipliers, upper = self._hessian
        return self._function("nlp_hess_l", multipliers, hess_gamma_x_x=casadi.triu2symm(upper))

    # -- parts -----------------------------------------------------------------------------------

    def _function(
        self, name: str, more: dict[str, Any] | None = None, /, **results: Any
    ) -> casadi.Function:
        """Return a function of x, p and the symbols `more`."""
        import casadi

        arguments = {"x": self._z, "p": casadi.MX.sym("p", 0), **(more or {})}
        return casadi.Function(
            name, [*arguments.values()], [*results.values()], [*arguments], [*results]
        )

    # Line searches evaluate the objective alone, so objective and rows are separate functions.

    @cached_property
    def _f(self) -> Any:
        return _part(self.program.function, "f")(self._x) / self.program.objective_scale

    @cached_property
    def _g(self) -> Any:
        return self._rows(_part(self.program.function, "g")(self._x))

    @cached_property
    def _hessian(self) -> tuple[dict[str, Any], Any]:
        """Multipliers of objective and rows as symbols, and the scaled upper triangle."""
        import casadi

        weight, duals = casadi.MX.sym("lam_f"), casadi.MX.sym("lam_g", self.program.row_count)
        upper = self.program.second_order(
            self._x, weight / self.program.objective_scale, self._rows(duals)
        )
        row, column = _places(upper)
        scale = self.program.column_scale
        factor = _dm(scale[row] * scale[column], upper.sparsity())
        return {"lam_f": weight, "lam_g": duals}, upper * factor

    def _rows(self, rows: Any) -> Any:
        return rows * _dm(1.0 / self.program.row_scale)

    def _gradient(self, grad: Any) -> Any:
        import casadi

        return casadi.densify(grad) * _dm(self.program.column_scale / self.program.objective_scale)

    def _jacobian(self, jac: Any) -> Any:
        row, column = _places(jac)
        factor = self.program.column_scale[column] / self.program.row_scale[row]
        return jac * _dm(factor, jac.sparsity())


def _dm(values: Vector, sparsity: Any = None) -> Any:
    import casadi

    return casadi.DM(values) if sparsity is None else casadi.DM(sparsity, values)


def _places(matrix: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    rows, columns = matrix.sparsity().get_triplet()
    return np.asarray(rows, np.int64), np.asarray(columns, np.int64)


def _part(function: Any, result: str) -> Any:
    """Return `function` with one of its results only, without the computations of the others.

    A function that is not an expression, such as a user's callback, is kept whole.
    """
    import casadi

    try:
        return function.factory(f"only_{result}", ["x"], [result])
    except RuntimeError:
        x = casadi.MX.sym("x", *function.size_in(0))
        index = function.name_out().index(result)
        return casadi.Function(f"only_{result}", [x], [function(x)[index]], ["x"], [result])
