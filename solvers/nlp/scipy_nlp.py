"""SciPy's two methods for constrained programs, on the scaled program: SLSQP and trust-constr."""

from __future__ import annotations

import warnings
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Feature, Limit, Request
from ..programs.attempts import Clock, Ended, Ending, Meaning, limit_reached, stop_reason
from ..programs.casadi_plugins import last_line, vector
from .base import COMMON, NonlinearBackend, most_iterations
from .scaled import Scaled

__all__ = ["Slsqp", "TrustConstr"]

Vector = NDArray[np.float64]

#: Largest dense Jacobian of SLSQP in gigabytes.
MEMORY = 1.0
#: Barrier parameters of trust-constr: the first one, and the one at which the search ends.
FIRST_BARRIER, BARRIER = 0.1, 1e-9


class _Stopped(Exception):
    """Exception that ends SciPy's search, which has no other reliable way to stop."""


class _Posed:
    """Scaled program for ``scipy.optimize.minimize``; every evaluation polls `limit_reached`."""

    def __init__(
        self, program: NonlinearProgram, limit_reached: Callable[[], bool], start: Vector
    ) -> None:
        self.scaled, self._limit_reached = Scaled(program), limit_reached
        bounds = self.scaled.bounds
        self.columns = bounds["lbx"], bounds["ubx"]
        #: Rows with a bound, and their bounds.
        self.bounded = np.flatnonzero(np.isfinite(bounds["lbg"]) | np.isfinite(bounds["ubg"]))
        self.row_bounds = bounds["lbg"][self.bounded], bounds["ubg"][self.bounded]
        self.row_count = program.row_count
        self.start = self.last = self.scaled.start(start)
        self.count = 0

    def _at(self, name: str, z: Vector, *multipliers: Any) -> Any:
        if self._limit_reached():
            raise _Stopped
        return getattr(self.scaled, name)(z, [], *multipliers)

    def objective(self, z: Vector) -> tuple[float, Vector]:
        """Return the scaled objective and its gradient."""
        value, gradient = self._at("gradient", z)
        return float(value), vector(gradient)

    def rows(self, z: Vector) -> Vector:
        """Return the bounded rows."""
        return vector(self._at("jacobian", z)[0])[self.bounded]

    def jacobian(self, z: Vector) -> sp.csc_array:
        """Return the Jacobian of the bounded rows."""
        return sp.csc_array(self._at("jacobian", z)[1].sparse())[self.bounded]

    def hessian(self, z: Vector, weight: float, duals: Any = 0.0) -> sp.csc_array:
        """Return the Hessian of ``weight f + duals·g``, both triangles."""
        upper = sp.csc_array(self._at("hessian", z, weight, self.all_rows(duals)).sparse())
        return sp.csc_array(upper + sp.triu(upper, 1).T)

    def all_rows(self, values: Any) -> Vector:
        """Return `values` of the bounded rows with 0 for the others."""
        result = np.zeros(self.row_count)
        result[self.bounded] = values
        return result

    def see(self, z: Vector, *_: Any) -> None:
        """Store `z` as the point of an iteration."""
        self.last, self.count = np.array(z, float), self.count + 1


class _ScipyNlp(NonlinearBackend):
    """Base of the backends for ``scipy.optimize.minimize``."""

    requires = ("casadi",)
    distribution = "scipy"
    features = COMMON | {Feature.INTERRUPT}
    single_threaded: ClassVar[bool] = True

    @abstractmethod
    def search(self, posed: _Posed, request: Request) -> Ending:
        """Run SciPy's search in scaled columns; point and duals of the ending are scaled, too."""

    def attempt(
        self, program: NonlinearProgram, request: Request, clock: Clock, start: Vector
    ) -> Ending:
        """Pass the program to SciPy. A stopped run returns the point of its last iteration."""
        posed = _Posed(program, lambda: limit_reached(request, clock) is not None, start)
        clock.lap("build")
        try:
            with np.errstate(all="ignore"), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                ending = self.search(posed, request)
        except _Stopped:
            limit = stop_reason(request.control, Limit.TIME)
            counts = {"iterations": posed.count}
            ending = Ending(Ended.STOPPED, posed.last, limit=limit, statistics=counts)
        except (RuntimeError, ValueError, np.linalg.LinAlgError) as error:
            message = f"{self.name}: {last_line(error)}"
            ending = Ending(Ended.FAILED, posed.last, message=message)
        clock.lap("solve")
        point = None if ending.point is None else posed.scaled.point(ending.point)
        duals = None if ending.duals is None else posed.scaled.duals(ending.duals)
        return replace(ending, point=point, duals=duals)

    def minimise(self, posed: _Posed, start: Vector, **arguments: Any) -> Any:
        """Run ``scipy.optimize.minimize`` with the finite bounds of the program."""
        from scipy.optimize import Bounds, NonlinearConstraint, minimize

        rows = NonlinearConstraint(
            posed.rows, *posed.row_bounds, jac=posed.jacobian,
            hess=lambda z, duals: posed.hessian(z, 0.0, duals),
        )  # fmt: skip
        return minimize(
            posed.objective, start, jac=True, method=self.name, callback=posed.see,
            bounds=Bounds(*posed.columns) if np.isfinite(posed.columns).any() else None,
            constraints=[rows] if posed.bounded.size else [], **arguments,
        )  # fmt: skip


class Slsqp(_ScipyNlp):
    """Backend for SciPy's dense ``"SLSQP"``; multipliers are estimated from its point."""

    name = "slsqp"
    prompt = False
    options = {"max_iter": most_iterations(500)}
    summary = "SciPy's SLSQP: dense, for small programs"

    def refuses(self, problem: NonlinearProgram) -> str:
        """Return the reason why the program is too large, empty if it is not."""
        size = 8.0 * problem.size * (problem.size + problem.row_count) / 1e9
        if size <= MEMORY:
            return ""
        return (
            f"backend 'slsqp' is dense: {problem.row_count} rows and {problem.size} columns would "
            f"take {size:.1f} GB, and it stops at {MEMORY:g} GB"
        )

    def search(self, posed: _Posed, request: Request) -> Ending:
        """Run SLSQP."""
        # The tolerance applies to the objective, whose error is about the square of the point's error.
        accuracy = max(min(1e-11, request.tolerance * 1e-5), 1e-15)
        options = {"maxiter": request.options["max_iter"], "ftol": accuracy}
        options |= {"disp": request.verbose, "iprint": 2}
        result = self.minimise(posed, posed.start, options=options)
        meanings: dict[int, Meaning] = {
            0: Ended.PROVEN,
            4: Ended.INFEASIBLE,
            9: (Ended.STOPPED, Limit.ITERATIONS),
        }
        counts = {"iterations": int(result.nit)}
        point = np.array(result.x, float)
        ending = Ending.read("slsqp", int(result.status), meanings, point=point, statistics=counts)
        proven = ending.ended is Ended.PROVEN
        return replace(ending, message="" if proven else f"slsqp: {result.message}")


class TrustConstr(_ScipyNlp):
    """Backend for SciPy's ``"trust-constr"`` with exact sparse derivatives."""

    name = "trust-constr"
    options = {"max_iter": most_iterations(1000)}
    summary = "SciPy's trust-constr: trust region and barrier, sparse"

    def search(self, posed: _Posed, request: Request) -> Ending:
        """Run trust-constr, again with a smaller barrier until the barrier is small enough."""
        point, most, barrier = posed.start, request.options["max_iter"], FIRST_BARRIER
        while True:
            options = {
                "maxiter": max(most - posed.count, 1), "verbose": 3 if request.verbose else 0,
                "gtol": 1e-8 if barrier == FIRST_BARRIER else 1e-13, "xtol": 1e-12,
                "initial_barrier_parameter": barrier, "initial_barrier_tolerance": barrier,
                "barrier_tol": BARRIER,
            }  # fmt: skip
            result = self.minimise(
                posed, point, hess=lambda z: posed.hessian(z, 1.0), options=options
            )
            point, is_finished = np.array(result.x, float), result.status in (1, 2)
            last = float(result.get("barrier_parameter", 0.0))
            if not is_finished or last <= BARRIER or posed.count >= most:
                break
            # SciPy stops when the problem with this barrier is solved, however large the barrier is.
            barrier = max(min(last, barrier) * 0.01, BARRIER)
        multipliers = result.get("v") if posed.bounded.size else None
        return Ending(
            Ended.PROVEN if is_finished else Ended.STOPPED,
            point,
            duals=posed.all_rows(multipliers[0] if multipliers else 0.0),
            limit=None if is_finished else Limit.ITERATIONS,
            statistics={"iterations": posed.count},
            message="" if is_finished else f"trust-constr: {result.message}",
        )
