"""Trust-constr, from SciPy: a trust-region interior-point method on sparse derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..contract.backend import Limit, Option, Request
from ..programs.attempts import Ended, Ending
from .base import most_iterations
from .scipy_nlp import Posed, ScipyNlp

__all__ = ["TrustConstr"]

Vector = NDArray[np.float64]

#: Barrier parameter at which the search ends.
BARRIER = 1e-9


class TrustConstr(ScipyNlp):
    """Backend for SciPy's ``minimize(method="trust-constr")`` with exact sparse derivatives."""

    name = "trust-constr"
    options: ClassVar[Mapping[str, Option]] = {
        "max_iter": most_iterations(1000),
    }
    summary = "SciPy's trust-constr: trust region and barrier, sparse"

    def search(
        self, posed: Posed, bounds: Mapping[str, Vector], request: Request, start: Vector
    ) -> Ending:
        """Run trust-constr on the rows that have a bound."""
        import warnings

        from scipy.optimize import Bounds, NonlinearConstraint, minimize

        bound = np.flatnonzero(np.isfinite(bounds["lbg"]) | np.isfinite(bounds["ubg"]))
        constraints = []
        if bound.size:

            def curvature(z: Vector, weights: Vector) -> Any:
                duals = np.zeros(posed.row_count)
                duals[bound] = weights
                return posed.hessian(z, 0.0, duals)

            constraints.append(
                NonlinearConstraint(
                    lambda z: posed.rows(z)[bound],
                    bounds["lbg"][bound],
                    bounds["ubg"][bound],
                    jac=lambda z: posed.jacobian(z)[bound],
                    hess=curvature,
                )
            )

        def look(z: Vector, state: Any) -> bool:
            posed.seen(z)
            return False

        none = np.zeros(posed.row_count)
        limits = None
        if np.isfinite(bounds["lbx"]).any() or np.isfinite(bounds["ubx"]).any():
            limits = Bounds(bounds["lbx"], bounds["ubx"])
        iteration_limit, barrier = request.options["max_iter"], 0.1
        while True:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                result = minimize(
                    posed.objective,
                    start,
                    jac=posed.gradient,
                    hess=lambda z: posed.hessian(z, 1.0, none),
                    method="trust-constr",
                    bounds=limits,
                    constraints=constraints,
                    callback=look,
                    options={
                        "maxiter": max(iteration_limit - posed.count, 1),
                        "verbose": 3 if request.verbose else 0,
                        "gtol": 1e-8 if barrier == 0.1 else 1e-13,
                        "xtol": 1e-12,
                        "initial_barrier_parameter": barrier,
                        "initial_barrier_tolerance": barrier,
                        "barrier_tol": BARRIER,
                    },
                )
            start, is_finished = np.array(result.x, float), result.status in (1, 2)
            last = float(result.get("barrier_parameter", 0.0))
            if not is_finished or last <= BARRIER or posed.count >= iteration_limit:
                break
            # SciPy stops when the problem with this barrier is solved, however large the barrier is.
            barrier = max(min(last, barrier) * 0.01, BARRIER)
        duals = np.zeros(posed.row_count)
        if constraints and result.get("v"):
            duals[bound] = np.asarray(result.v[0], float)
        return Ending(
            Ended.PROVEN if is_finished else Ended.STOPPED,
            start,
            duals=duals,
            limit=None if is_finished else Limit.ITERATIONS,
            statistics={"iterations": posed.count},
            message="" if is_finished else f"trust-constr: {result.message}",
        )
