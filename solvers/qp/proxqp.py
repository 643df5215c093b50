"""ProxQP: a proximal augmented Lagrangian method, dense or sparse."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp

from ...models.programs.linear import QuadraticProgram
from ..contract.backend import Feature, Limit, Option, Request
from ..programs.attempts import (
    Clock,
    Ended,
    Ending,
    Meaning,
    limit_reached,
    solver_tolerance,
    stop_reason,
)
from .base import COMMON, QuadraticBackend
from .forms import SplitForm
from .settings import LINEAR_ALGEBRA, POLISH, prefers_dense

__all__ = ["Proxqp"]

#: Largest sum of columns and rows for dense factors.
LARGEST_DENSE = 2000
#: Outer iterations before the first check of the clock; ProxQP has no time limit and no callback.
SLICE = 20
#: Seconds of a slice below which the next one is longer, because continuing loses some progress.
SHORT = 0.3
#: Value that ProxQP treats as infinite.
INFINITE = 1e20


class Proxqp(QuadraticBackend):
    """Backend for ProxQP (Bambade et al. 2022), which is run in slices of iterations."""

    name = "proxqp"
    features = COMMON | {Feature.WARM_START, Feature.INTERRUPT, Feature.LOG}
    requires = ("proxsuite",)
    extra = "qp"
    options: ClassVar[Mapping[str, Option]] = {
        "polish": POLISH,
        "max_iter": Option(400, "Limit on outer iterations.", int, lower=1),
        "eps_abs": Option(
            None, "Absolute precision. Default: a thousandth of the tolerance.",
            float, lower=1e-15, upper=1.0,
        ),
        "linear_algebra": LINEAR_ALGEBRA,
    }  # fmt: skip
    deterministic = True
    summary = "ProxQP: proximal augmented Lagrangian, dense or sparse, warm starts"

    def attempt(self, program: QuadraticProgram, request: Request, clock: Clock) -> Ending:
        """Solve the program with ProxQP."""
        from proxsuite import proxqp  # type: ignore[import-untyped]

        split = SplitForm.of(program)
        dense = prefers_dense(program, request, LARGEST_DENSE)
        bounded = np.flatnonzero(
            np.isfinite(program.column_lower) | np.isfinite(program.column_upper)
        )
        # Column bounds are passed as rows: the dense solver lost precision with its own bounds, and
        # the sparse one has none.
        unit = sp.eye_array(program.size, format="csr")[bounded]
        rows = sp.vstack([split.ranged, unit], format="csc")
        low = np.concatenate([split.low, program.column_lower[bounded]])
        high = np.concatenate([split.high, program.column_upper[bounded]])
        module = proxqp.dense if dense else proxqp.sparse
        solver: Any = module.QP(program.size, split.right.size, low.size)

        def form(matrix: Any) -> Any:
            return matrix.toarray() if dense else sp.csc_matrix(matrix)

        settings = solver.settings
        eps = request.options["eps_abs"] or solver_tolerance(request, 1e-11, 1e-8, share=1e-2)
        settings.eps_abs = eps
        settings.eps_rel = 0.0
        settings.check_duality_gap = True
        settings.eps_duality_gap_abs = eps
        settings.eps_duality_gap_rel = eps
        # With its defaults of 1e-4, ProxQP claimed feasible programs infeasible and bounded ones not.
        settings.eps_primal_inf = settings.eps_dual_inf = 1e-10
        settings.verbose = request.verbose
        piece = settings.max_iter = SLICE
        settings.initial_guess = proxqp.InitialGuess.NO_INITIAL_GUESS
        solver.init(
            form(program.hessian),
            program.cost,
            form(split.equal) if split.right.size else None,
            split.right if split.right.size else None,
            form(rows) if low.size else None,
            np.clip(low, -INFINITE, INFINITE) if low.size else None,
            np.clip(high, -INFINITE, INFINITE) if low.size else None,
        )
        start = request.warm_start
        if start is not None:
            settings.initial_guess = proxqp.InitialGuess.WARM_START
        clock.lap("build")
        iteration_limit = request.options["max_iter"]
        states, iterations, outer = proxqp.QPSolverOutput, 0, 0
        while True:
            slice_start = time.perf_counter()
            if start is not None:
                solver.solve(
                    np.asarray(start, float), np.zeros(split.right.size), np.zeros(low.size)
                )
                start = None
            else:
                solver.solve()
            info = solver.results.info
            outer, iterations = outer + piece, iterations + int(info.iter)
            if info.status != states.PROXQP_MAX_ITER_REACHED or outer >= iteration_limit:
                break
            if limit_reached(request, clock) is not None:
                break
            if time.perf_counter() - slice_start < SHORT:
                piece = settings.max_iter = min(4 * piece, iteration_limit)
            settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        clock.lap("solve")
        meanings: dict[Any, Meaning] = {
            states.PROXQP_SOLVED: Ended.PROVEN,
            states.PROXQP_PRIMAL_INFEASIBLE: Ended.INFEASIBLE,
            states.PROXQP_DUAL_INFEASIBLE: Ended.UNBOUNDED,
            states.PROXQP_MAX_ITER_REACHED: (
                Ended.STOPPED,
                Limit.ITERATIONS
                if outer >= iteration_limit
                else stop_reason(request.control, Limit.TIME),
            ),
        }
        result = solver.results
        ranged = -np.asarray(result.z, float)[: split.low.size]
        return Ending.read(
            "ProxQP",
            info.status,
            meanings,
            info.status.name,
            point=np.array(result.x, float),
            duals=split.duals(-np.asarray(result.y, float), ranged),
            statistics={"iterations": iterations, "factors": "dense" if dense else "sparse"},
        )
