"""PIQP: a proximal interior-point method, dense or sparse."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp

from ...models.programs.linear import QuadraticProgram
from ..contract.backend import Feature, Limit, Option, Request
from ..programs.attempts import Clock, Ended, Ending, Meaning, solver_options, solver_tolerance
from .base import COMMON, QuadraticBackend
from .forms import SplitForm
from .settings import LINEAR_ALGEBRA, POLISH, prefers_dense

__all__ = ["Piqp"]

#: Largest sum of columns and rows for dense factors.
LARGEST_DENSE = 3000


class Piqp(QuadraticBackend):
    """Backend for PIQP (Schwan et al. 2023).

    It has no time limit and keeps the interpreter's lock, so it runs in a worker process that can be
    killed.
    """

    name = "piqp"
    features = COMMON | {Feature.LOG}
    requires = ("piqp",)
    extra = "qp"
    options: ClassVar[Mapping[str, Option]] = {
        "polish": POLISH,
        "max_iter": Option(250, "Limit on interior-point iterations.", int, lower=1),
        "linear_algebra": LINEAR_ALGEBRA,
    }
    deterministic = True
    summary = "PIQP: proximal interior point, dense or sparse; robust to dependent rows"

    def attempt(self, program: QuadraticProgram, request: Request, clock: Clock) -> Ending:
        """Solve the program with PIQP."""
        import piqp  # type: ignore[import-untyped]

        split = SplitForm.of(program)
        dense = prefers_dense(program, request, LARGEST_DENSE)
        solver: Any = piqp.DenseSolver() if dense else piqp.SparseSolver()
        settings = solver.settings
        # With a tighter tolerance its last steps stall on long programs; polishing does the rest.
        tolerance = solver_tolerance(request, 1e-9, 1e-8, share=1e-2)
        for name in ("eps_abs", "eps_rel", "eps_duality_gap_abs", "eps_duality_gap_rel"):
            setattr(settings, name, tolerance)
        settings.check_duality_gap = True
        settings.num_threads = 1
        settings.verbose = request.verbose
        for name, value in solver_options(request, "linear_algebra").items():
            setattr(settings, name, value)

        def form(matrix: Any) -> Any:
            return matrix.toarray() if dense else sp.csc_matrix(matrix)

        solver.setup(
            form(program.hessian),
            program.cost,
            form(split.equal) if split.right.size else None,
            split.right if split.right.size else None,
            form(split.ranged) if split.low.size else None,
            split.low if split.low.size else None,
            split.high if split.low.size else None,
            program.column_lower,
            program.column_upper,
        )
        clock.lap("build")
        solver.solve()
        clock.lap("solve")
        result, states = solver.result, piqp.Status
        meanings: dict[Any, Meaning] = {
            states.PIQP_SOLVED: Ended.PROVEN,
            states.PIQP_PRIMAL_INFEASIBLE: Ended.INFEASIBLE,
            states.PIQP_DUAL_INFEASIBLE: Ended.UNBOUNDED,
            states.PIQP_MAX_ITER_REACHED: (Ended.STOPPED, Limit.ITERATIONS),
        }
        ranged = np.asarray(result.z_l) - np.asarray(result.z_u)
        return Ending.read(
            "PIQP",
            result.info.status,
            meanings,
            result.info.status.name,
            point=np.array(result.x, float),
            duals=split.duals(-np.asarray(result.y), ranged),
            statistics={
                "iterations": int(result.info.iter), "factors": "dense" if dense else "sparse"
            },
        )  # fmt: skip
