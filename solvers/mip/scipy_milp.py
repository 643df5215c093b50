"""HiGHS through ``scipy.optimize.milp``: always installed, and independent of highspy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ...errors import UnsupportedOption
from ...models.programs.linear import MixedIntegerProgram
from ...models.verification import ROUNDING
from ..contract.backend import Feature, Limit, Option, Request
from ..programs.attempts import Clock, Ended, Ending
from .base import ProgramBackend, with_cutoff_row, with_offset_column

__all__ = ["ScipyMilp"]

#: Tolerance of HiGHS, which SciPy does not let users change.
TOLERANCE = 1e-6


class ScipyMilp(ProgramBackend):
    """Backend for ``scipy.optimize.milp``, which runs SciPy's own HiGHS in this process.

    Only the time limit can stop it, and it reports nothing before the end.
    """

    name = "scipy"
    features = frozenset({Feature.GAP, Feature.CUTOFF, Feature.DUAL_BOUND, Feature.LOG})
    requires = ("scipy",)
    options: ClassVar[Mapping[str, Option]] = {
        "presolve": Option(True, "Whether to presolve.", bool)
    }
    deterministic = True
    summary = "scipy.optimize.milp: the HiGHS inside SciPy"

    def attempt(self, program: MixedIntegerProgram, request: Request, clock: Clock) -> Ending:
        """Solve the program with SciPy's HiGHS."""
        from scipy import optimize

        if request.tolerance < TOLERANCE:
            raise UnsupportedOption(
                f"backend {self.name!r}: tolerance must be at least {TOLERANCE:g}, "
                f"which scipy.optimize.milp fixes; got {request.tolerance!r}"
            )
        posed = with_offset_column(with_cutoff_row(program, request.cutoff))
        # With a lower bound of -2.5 of an integer column, the presolve of HiGHS cut off the optimum.
        low, high, integral = posed.column_lower, posed.column_upper, posed.integral
        low = np.where(integral, np.ceil(low - ROUNDING), low)
        high = np.where(integral, np.floor(high + ROUNDING), high)
        options: dict[str, Any] = {
            "mip_rel_gap": request.gap,
            "disp": request.verbose,
            **request.options,
        }
        clock.lap("build")
        left = clock.left()
        if left is not None:
            options["time_limit"] = left
        result = optimize.milp(
            posed.cost,
            integrality=posed.integral.astype(np.int8),
            bounds=optimize.Bounds(low, high),
            constraints=optimize.LinearConstraint(posed.matrix, posed.row_lower, posed.row_upper)
            if posed.row_count
            else None,
            options=options,
        )
        clock.lap("solve")
        return _ending(program, result)


def _ending(program: MixedIntegerProgram, result: Any) -> Ending:
    ended = {
        0: Ended.PROVEN,
        1: Ended.STOPPED,
        2: Ended.INFEASIBLE,
        3: Ended.UNBOUNDED,
        # SciPy has no separate status for HiGHS's "infeasible or unbounded".
        4: Ended.UNCLEAR if "infeasible or unbounded" in result.message.lower() else Ended.FAILED,
    }[result.status]
    bound = result.get("mip_dual_bound")
    if program.continuous:
        bound = result.fun if ended is Ended.PROVEN else None
    return Ending(
        ended,
        None if result.x is None else np.array(result.x[: program.size], float),
        None if bound is None else float(bound),
        limit=Limit.TIME if ended is Ended.STOPPED else None,
        statistics={"nodes": int(result.get("mip_node_count") or 0)},
        message=f"SciPy: {result.message}" if ended is Ended.FAILED else "",
    )
