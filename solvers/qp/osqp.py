"""OSQP: operator splitting, which goes on from any point."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp

from ...models.programs.linear import QuadraticProgram
from ..attempts import Clock, Ended, Outcome, limited
from ..backend import Feature, Limit, Option, Request
from .base import (
    COMMON,
    POLISH,
    QuadraticBackend,
    QuadraticOutcome,
    first_order_precision,
    own_options,
)
from .forms import stacked_rows

__all__ = ["Osqp"]

#: Seconds after which OSQP is asked to pause, so that a stop is heard: it has no callback.
SLICE = 0.5


class Osqp(QuadraticBackend):
    """OSQP (Stellato et al. 2020), which goes on from where a slice of time ended."""

    name = "osqp"
    features = COMMON | {Feature.WARM_START, Feature.INTERRUPT}
    requires = ("osqp",)
    distribution = "osqp"
    options: ClassVar[Mapping[str, Option]] = {
        "polish": POLISH,
        "eps": Option(
            None, "Absolute and relative precision; by default a tenth of the tolerance, which the polish "
            "does the rest for, or a thousandth without it.",
            float, lower=1e-15, upper=1.0,
        ),
        "max_iter": Option(200_000, "Iterations at most.", int, lower=1),
        "rho": Option(0.1, "Initial weight of the constraints.", float, lower=1e-6, upper=1e6),
        "scaling": Option(10, "Rounds of scaling the data; 0 is none.", int, lower=0),
        "polishing": Option(
            False,
            "Whether OSQP polishes its own solution; it prints where that fails.",
            bool,
        ),
    }  # fmt: skip
    summary = "OSQP: operator splitting, sparse, warm starts"

    def attempt(self, program: QuadraticProgram, request: Request, clock: Clock) -> Outcome:
        """Solve with OSQP."""
        import osqp  # type: ignore[import-untyped]

        matrix, low, high = stacked_rows(program)
        own = own_options(request, "eps", "max_iter")
        eps = request.options.get("eps") or first_order_precision(request)
        allowed = int(request.options.get("max_iter", 200_000))
        solver = osqp.OSQP()
        began = time.perf_counter()
        solver.setup(
            sp.csc_matrix(sp.triu(program.hessian)),
            program.cost,
            matrix,
            low,
            high,
            verbose=False,
            eps_abs=eps,
            eps_rel=eps,
            eps_prim_inf=1e-9,
            eps_dual_inf=1e-9,
            max_iter=allowed,
            **own,
        )
        # The first solve's time limit counts the set-up as well.
        setup = time.perf_counter() - began
        if request.warm_start is not None:
            solver.warm_start(x=np.asarray(request.warm_start, float))
        clock.lap("build")
        control, iterations = request.control, 0
        status = osqp.SolverStatus
        unfinished = {
            int(status.OSQP_TIME_LIMIT_REACHED),
            int(status.OSQP_SOLVED_INACCURATE),
            int(status.OSQP_PRIMAL_INFEASIBLE_INACCURATE),
            int(status.OSQP_DUAL_INFEASIBLE_INACCURATE),
        }
        while True:
            left = clock.left()
            pause = SLICE if left is None else max(min(SLICE, left), 1e-3)
            solver.update_settings(time_limit=pause + setup)
            setup = 0.0
            found = solver.solve(raise_error=False)
            iterations += int(found.info.iter)
            value = int(found.info.status_val)
            # At a pause it may also say what it is close to: solved, or a certificate.
            paused = value in unfinished and iterations < allowed
            if not paused or control.stopped or clock.left() == 0.0:
                break
            solver.update_settings(max_iter=allowed - iterations)
        clock.lap("solve")
        ended, limit = {
            int(status.OSQP_SOLVED): (Ended.PROVEN, None),
            int(status.OSQP_SOLVED_INACCURATE): (Ended.STOPPED, Limit.ITERATIONS),
            int(status.OSQP_PRIMAL_INFEASIBLE): (Ended.INFEASIBLE, None),
            int(status.OSQP_PRIMAL_INFEASIBLE_INACCURATE): (Ended.INFEASIBLE, None),
            int(status.OSQP_DUAL_INFEASIBLE): (Ended.UNBOUNDED, None),
            int(status.OSQP_DUAL_INFEASIBLE_INACCURATE): (Ended.UNBOUNDED, None),
            int(status.OSQP_MAX_ITER_REACHED): (Ended.STOPPED, Limit.ITERATIONS),
            int(status.OSQP_TIME_LIMIT_REACHED): (Ended.STOPPED, limited(control, Limit.TIME)),
            int(status.OSQP_SIGINT): (Ended.STOPPED, Limit.INTERRUPTED),
        }.get(value, (Ended.FAILED, None))
        if paused:
            ended, limit = Ended.STOPPED, limited(control, Limit.TIME)
        solution = ended not in (Ended.INFEASIBLE, Ended.UNBOUNDED)
        rows = program.row_count
        return QuadraticOutcome(
            ended,
            np.array(found.x, float) if solution else None,
            None,
            -np.array(found.y[:rows], float) if solution else None,
            limit,
            {"iterations": iterations},
            f"OSQP: {found.info.status}" if ended is Ended.FAILED else "",
            ray=_taken(found.prim_inf_cert, rows, -1.0) if ended is Ended.INFEASIBLE else None,
            direction=_taken(found.dual_inf_cert, program.size, 1.0)
            if ended is Ended.UNBOUNDED
            else None,
        )


def _taken(values: Any, size: int, sign: float) -> np.ndarray[Any, np.dtype[np.float64]] | None:
    if values is None:
        return None
    found = np.asarray(values, float)[:size]
    return sign * found if found.size == size and np.isfinite(found).all() else None
