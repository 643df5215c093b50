"""DAQP: a dual active-set method for small dense programs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...models.programs.linear import QuadraticProgram
from ..contract.backend import Feature, Limit, Request
from ..programs.attempts import Clock, Ended, Ending, Meaning, solver_tolerance
from .base import COMMON, QuadraticBackend
from .settings import too_large

__all__ = ["Daqp"]

#: Value that DAQP treats as infinite.
INFINITE = 1e30
#: Types of a row: an inequality, or an equality that never leaves the working set.
INEQUALITY, EQUALITY = 0, 5
#: Limit on iterations, more than the default of DAQP.
ITERATIONS = 100_000


class Daqp(QuadraticBackend):
    """Backend for DAQP (Arnström et al. 2022) with dense copies of the program's arrays.

    It is called directly instead of through qpsolvers, which drops the exit flag of DAQP and splits a
    row with two bounds into two rows.
    """

    name = "daqp"
    features = COMMON | {Feature.WARM_START}
    requires = ("daqp",)
    extra = "qp"
    deterministic = True
    summary = "DAQP: dual active set, dense; the fastest on small programs"

    def refuses(self, problem: Any) -> str:
        """Return the reason why `problem` is too large for dense arrays, empty if it is not."""
        return too_large(f"backend {self.name!r}", problem)

    def attempt(self, program: QuadraticProgram, request: Request, clock: Clock) -> Ending:
        """Solve the program with DAQP."""
        import daqp  # type: ignore[import-not-found]

        size, rows = program.size, program.row_count
        bounded = bool(
            np.isfinite(program.column_lower).any() or np.isfinite(program.column_upper).any()
        )
        columns = size if bounded else 0
        low = np.concatenate([program.column_lower[:columns], program.row_lower])
        high = np.concatenate([program.column_upper[:columns], program.row_upper])
        sense = np.full(columns + rows, INEQUALITY, np.int32)
        sense[columns:][program.row_lower == program.row_upper] = EQUALITY
        tolerance = solver_tolerance(request, 1e-11, 1e-8, share=1e-2)
        settings: dict[str, Any] = {
            "primal_tol": tolerance,
            "dual_tol": tolerance,
            "iter_limit": ITERATIONS,
            "eps_prox": -1.0,  # chosen by DAQP for singular Hessians
        }
        hessian, matrix = program.hessian.toarray(), program.matrix.toarray()
        start = request.warm_start
        clock.lap("build")
        left = clock.left()
        if left is not None:
            settings["time_limit"] = max(left, 1e-6)
        x, _, flag, info = daqp.solve(
            hessian,
            program.cost.copy(),  # DAQP requires writable arrays
            matrix.reshape(rows, size),
            np.clip(high, -INFINITE, INFINITE),
            np.clip(low, -INFINITE, INFINITE),
            sense,
            primal_start=None if start is None else np.array(start, float),
            **settings,
        )
        clock.lap("solve")
        return Ending.read(
            "DAQP",
            int(flag),
            _MEANINGS,
            _FAILURES.get(int(flag), f"exit flag {flag}"),
            point=np.array(x, float),
            duals=-np.asarray(info["lam"], float)[columns:],
            statistics={"iterations": int(info["iterations"])},
        )


_MEANINGS: Mapping[int, Meaning] = {
    1: Ended.PROVEN,
    -1: Ended.INFEASIBLE,
    -3: Ended.UNBOUNDED,
    -4: (Ended.STOPPED, Limit.ITERATIONS),
    -7: (Ended.STOPPED, Limit.TIME),
}
_FAILURES = {
    -2: "cycling",
    -5: "the Hessian is not convex",
    -6: "the working set is overdetermined",
}
