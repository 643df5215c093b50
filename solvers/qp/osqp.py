"""OSQP: an operator-splitting method with warm starts."""

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
    solver_options,
    stop_reason,
)
from .base import COMMON, QuadraticBackend
from .forms import stacked_rows
from .settings import EPS, POLISH, first_order_precision, slice_iterations, time_left

__all__ = ["Osqp"]


class Osqp(QuadraticBackend):
    """Backend for OSQP (Stellato et al. 2020), which is run in slices of time."""

    name = "osqp"
    features = COMMON | {Feature.WARM_START, Feature.INTERRUPT, Feature.LOG}
    requires = ("osqp",)
    options: ClassVar[Mapping[str, Option]] = {
        "polish": POLISH,
        "eps": EPS,
        "max_iter": Option(200_000, "Limit on iterations.", int, lower=1),
        "rho": Option(0.1, "Initial weight of the constraints.", float, lower=1e-6, upper=1e6),
        "scaling": Option(10, "Rounds of scaling the data; 0: none.", int, lower=0),
    }
    deterministic = True
    summary = "OSQP: operator splitting, sparse, warm starts"

    def attempt(self, program: QuadraticProgram, request: Request, clock: Clock) -> Ending:
        """Solve the program with OSQP."""
        import osqp  # type: ignore[import-untyped]

        matrix, low, high = stacked_rows(program)
        eps, iteration_limit = first_order_precision(request), request.options["max_iter"]
        solver = osqp.OSQP()
        start = time.perf_counter()
        solver.setup(
            sp.csc_matrix(sp.triu(program.hessian)),
            program.cost,
            matrix,
            low,
            high,
            verbose=request.verbose,
            eps_abs=eps,
            eps_rel=eps,
            eps_prim_inf=1e-9,
            eps_dual_inf=1e-9,
            **solver_options(request, "eps"),
        )
        # The time limit of the first solve includes the set-up.
        setup = time.perf_counter() - start
        if request.warm_start is not None:
            solver.warm_start(x=np.asarray(request.warm_start, float))
        clock.lap("build")
        control, iterations = request.control, 0
        step = slice_iterations(program.hessian, matrix)
        status = osqp.SolverStatus
        unfinished = {
            int(status.OSQP_MAX_ITER_REACHED),
            int(status.OSQP_SOLVED_INACCURATE),
            int(status.OSQP_PRIMAL_INFEASIBLE_INACCURATE),
            int(status.OSQP_DUAL_INFEASIBLE_INACCURATE),
        }
        while True:
            solver.update_settings(
                time_limit=time_left(clock) + setup,
                max_iter=min(step, iteration_limit - iterations),
            )
            setup = 0.0
            result = solver.solve(raise_error=False)
            iterations += int(result.info.iter)
            value = int(result.info.status_val)
            # At a pause the status may also be an inaccurate solution or certificate.
            paused = value in unfinished and iterations < iteration_limit
            if not paused or limit_reached(request, clock) is not None:
                break
        clock.lap("solve")
        timed = Ended.STOPPED, stop_reason(control, Limit.TIME)
        infeasible = {
            int(status.OSQP_PRIMAL_INFEASIBLE),
            int(status.OSQP_PRIMAL_INFEASIBLE_INACCURATE),
        }
        unbounded = {int(status.OSQP_DUAL_INFEASIBLE), int(status.OSQP_DUAL_INFEASIBLE_INACCURATE)}
        meanings: dict[int, Meaning] = {
            int(status.OSQP_SOLVED): Ended.PROVEN,
            int(status.OSQP_SOLVED_INACCURATE): (Ended.STOPPED, Limit.ITERATIONS),
            int(status.OSQP_MAX_ITER_REACHED): (Ended.STOPPED, Limit.ITERATIONS),
            int(status.OSQP_TIME_LIMIT_REACHED): timed,
            int(status.OSQP_SIGINT): (Ended.STOPPED, Limit.INTERRUPTED),
            **dict.fromkeys(infeasible, Ended.INFEASIBLE),
            **dict.fromkeys(unbounded, Ended.UNBOUNDED),
        }
        if paused:
            meanings[value] = timed
        ray = result.prim_inf_cert if meanings.get(value) is Ended.INFEASIBLE else result.y
        point = result.dual_inf_cert if meanings.get(value) is Ended.UNBOUNDED else result.x
        return Ending.read(
            "OSQP",
            value,
            meanings,
            result.info.status,
            point=_taken(point, program.size),
            duals=_taken(ray, program.row_count, -1.0),
            statistics={"iterations": iterations},
        )


def _taken(
    values: Any, size: int, sign: float = 1.0
) -> np.ndarray[Any, np.dtype[np.float64]] | None:
    if values is None:
        return None
    entries = np.asarray(values, float)[:size]
    return sign * entries if entries.size == size and np.isfinite(entries).all() else None
