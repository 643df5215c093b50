"""Primal-dual interior-point steps from an earlier solution, with the KKT system of :mod:`.stages`.

From a solution for nearby data, Newton steps with a constant small barrier converge in a few iterations.
There is no line search. If the steps do not converge, the backend solves the program. S. J. Wright,
"Primal-Dual Interior-Point Methods" (1997), chapter 5, contains the equations.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .elimination import Singular
from .parametric import Parametric
from .stages import Stages

__all__ = ["StructuredSolver"]

Floats = NDArray[np.float64]

#: Barrier parameter, and smallest initial multiplier and distance from a bound. With 1e-10 the tracking
#: problems of the benchmark took up to 11 iterations, with 1e-11 up to 8.
BARRIER, NEAR = 1e-11, 1e-8
#: Fraction of a distance from a bound that a step leaves.
LEFT = 1e-3
#: Largest error of the objective by the residuals of the rows, relative, and absolute in its scale. Without
#: this limit, the scale of an objective with large bounds on its states left relative errors of 2e-5.
ACCURATE, ROUNDED = 3e-7, 1e-13
#: Bound of a column without a bound.
FAR = 1e20
#: Largest number of Newton steps.
MOST = 20
#: Multiples of the identity that are added to a Hessian without positive curvature, one after the other.
CONVEX = (0.0, 1e-3, 1e-2, 1e-1, 1.0)
#: Sign of the step in the distance from the lower and from the upper bound.
SIDES = np.array([[1.0], [-1.0]])


class StructuredSolver:
    """Interior-point method for warm starts of a program with the structure of one phase.

    `tolerance` bounds the residuals of the optimality conditions, in scaled columns and rows. `hessian` may be
    the function ``posed.derivative("hessian")``. A program without the structure raises ``NotStaged``.
    """

    def __init__(self, posed: Parametric, tolerance: float, hessian: Any = None) -> None:
        import casadi

        self.tolerance = tolerance
        first, second = posed.derivative("first_order"), hessian or posed.derivative("hessian")
        sizes = posed.free.size, posed.given.size, posed.rows.size
        x, p, duals = map(casadi.MX.sym, ("x", "p", "lam_g"), sizes)
        f, gradient, g, jacobian = first(x, p)
        hessian = second(x, p, 1.0, duals)
        nonzeros = [casadi.vec(matrix.nz[:]) for matrix in (jacobian, hessian)]
        function = casadi.Function(
            "kkt", [x, p, duals], [gradient, casadi.densify(g), *nonzeros, f]
        )
        self.stages = Stages(posed, jacobian.sparsity(), hessian.sparsity())
        row, column = jacobian.sparsity().get_triplet()
        self._row, self._column = np.array(row, np.int64), np.array(column, np.int64)
        # A call with buffers took 0.1 ms less than one with matrices.
        self._buffer, self._evaluate = posed._expanded(function).buffer()
        self._inputs = [np.zeros(size) for size in sizes]
        self._results = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
        for k, array in enumerate(self._inputs):
            self._buffer.set_arg(k, memoryview(array))  # type: ignore[arg-type]
        for k, array in enumerate(self._results):
            self._buffer.set_res(k, memoryview(array))  # type: ignore[arg-type]
        low, high = posed.bounds["lbg"], posed.bounds["ubg"]
        bounded = np.isfinite(low) | np.isfinite(high)
        self._equal, self._between = (
            np.flatnonzero(low == high),
            np.flatnonzero(bounded & (low < high)),
        )
        self._values = low[self._equal]
        #: Bounds of z, then of the slacks of the inequality rows.
        self._low = np.concatenate([posed.bounds["lbx"], low[self._between]]).clip(-FAR)
        self._high = np.concatenate([posed.bounds["ubx"], high[self._between]]).clip(None, FAR)
        self._sided = np.stack([self._low > -FAR, self._high < FAR])
        self._push = np.minimum(NEAR, 0.25 * (self._high - self._low))

    def _at(self, *arguments: Floats) -> list[Floats]:
        """Return gradient, rows, nonzeros of Jacobian and Hessian, and objective, in reused arrays."""
        for array, value in zip(self._inputs, arguments, strict=True):
            array[:] = value
        self._evaluate()
        return self._results

    @np.errstate(all="ignore")  # a start that is far away overflows and does not converge
    def solve(self, p: Floats, z: Floats, multipliers: tuple[Floats, Floats]) -> dict[str, Any]:
        """Search from the free columns `z` and their multipliers, and those of the rows, with CasADi's signs.

        Returns ``success``, ``status``, ``iterations``, ``z``, ``multipliers``, and the scaled objective ``f``
        and rows ``g`` at z.
        """
        count, between, low, high = z.size, self._between, self._low, self._high
        duals = multipliers[1]
        pressure = np.concatenate([multipliers[0], duals[between]])
        zeta = np.where(self._sided, np.maximum(-SIDES * pressure, NEAR), 0.0)
        weight, residual = np.full(duals.size, np.inf), np.zeros(duals.size)
        status, success, convex = "Maximum_Iterations_Exceeded", False, 0.0
        v = z.clip((low + self._push)[:count], (high - self._push)[:count])
        for number in range(MOST + 1):
            gradient, g, jacobian, hessian, f = self._at(v[:count], p, duals)
            if number == 0:
                v = np.concatenate([v, g[between]]).clip(low + self._push, high - self._push)
            gap = np.stack([v - low, high - v])
            residual[self._equal] = g[self._equal] - self._values
            residual[between] = g[between] - v[count:]
            slope = gradient + np.bincount(self._column, jacobian * duals[self._row], count)
            force = np.concatenate([slope, -duals[between]]) + zeta[1] - zeta[0]
            parts = force, residual, (zeta * gap).reshape(-1)
            error = max(float(np.abs(part).max(initial=0.0)) for part in parts)
            if not np.isfinite(error) or not (gap > 0.0).all():
                status = "Invalid_Number_Detected"
                break
            is_accurate = abs(duals @ residual) <= max(ACCURATE * abs(f[0]), ROUNDED)
            # The curvature is known after the first step.
            if error <= self.tolerance and is_accurate and convex == 0.0 and number > 0:
                status, success = "Solve_Succeeded", True
                break
            if number == MOST:
                break
            push = BARRIER / gap
            barrier = push[1] - push[0]
            ratio = zeta / gap
            sigma = ratio[0] + ratio[1]
            weight[between] = sigma[count:]
            shifted = residual.copy()
            shifted[between] += barrier[count:] / sigma[count:]
            system = gradient + barrier[:count], shifted, weight
            for convex in CONVEX:
                try:
                    step, duals = self.stages.solve(
                        jacobian, hessian, sigma[:count] + convex, *system
                    )
                    break
                except Singular as reason:
                    status = str(reason)
            else:
                break
            step = np.concatenate([step, (duals[between] - barrier[count:]) / sigma[count:]])
            # Each distance and multiplier is kept positive by itself, without a common step length.
            zeta = np.maximum(push - SIDES * ratio * step, LEFT * zeta)
            v = (v + step).clip(low + LEFT * gap[0], high - LEFT * gap[1])
        return {
            "method": "structured", "success": success, "status": status, "iterations": number,
            "z": v[:count].copy(), "multipliers": ((zeta[1] - zeta[0])[:count], duals),
            "f": float(f[0]), "g": g.copy(),
        }  # fmt: skip
