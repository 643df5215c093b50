"""PIQP: a proximal interior-point method, dense or sparse."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp

from ...models.programs.linear import QuadraticProgram
from ..attempts import Clock, Ended, Outcome, solver_tolerance
from ..backend import Limit, Option, Request
from .base import POLISH, QuadraticBackend, QuadraticOutcome, own_options
from .forms import SplitForm

__all__ = ["Piqp"]

#: Share of entries that are not zero, above which the dense solver is faster.
DENSE = 0.1
#: Columns and rows together, up to which it is tried at all.
LARGEST_DENSE = 3000


class Piqp(QuadraticBackend):
    """PIQP (Schwan et al. 2023), called with the program's arrays.

    It knows no time limit and keeps the interpreter's lock while it runs, so that only the process can
    be stopped: the dispatcher gives it one of its own.
    """

    name = "piqp"
    requires = ("piqp",)
    distribution = "piqp"
    options: ClassVar[Mapping[str, Option]] = {
        "polish": POLISH,
        "max_iter": Option(250, "Interior-point iterations at most.", int, lower=1),
        "linear_algebra": Option(
            "choose", "Dense or sparse factors; by the share of entries by default.", str,
            ("choose", "dense", "sparse"),
        ),
    }  # fmt: skip
    summary = "PIQP: proximal interior point, dense or sparse; robust to dependent rows"

    def attempt(self, program: QuadraticProgram, request: Request, clock: Clock) -> Outcome:
        """Solve with PIQP."""
        import piqp  # type: ignore[import-untyped]

        split = SplitForm.of(program)
        dense = _dense(program, request.options.get("linear_algebra", "choose"))
        solver: Any = piqp.DenseSolver() if dense else piqp.SparseSolver()
        settings = solver.settings
        # Tighter, and its last steps stall on long programs; the polish finds the rest.
        tolerance = solver_tolerance(request.tolerance * 1e-2, 1e-9, 1e-8)
        for name in ("eps_abs", "eps_rel", "eps_duality_gap_abs", "eps_duality_gap_rel"):
            setattr(settings, name, tolerance)
        settings.check_duality_gap = True
        settings.num_threads = 1
        for name, value in own_options(request, "linear_algebra").items():
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
        status = result.info.status
        ended, limit = {
            states.PIQP_SOLVED: (Ended.PROVEN, None),
            states.PIQP_PRIMAL_INFEASIBLE: (Ended.INFEASIBLE, None),
            states.PIQP_DUAL_INFEASIBLE: (Ended.UNBOUNDED, None),
            states.PIQP_MAX_ITER_REACHED: (Ended.STOPPED, Limit.ITERATIONS),
        }.get(status, (Ended.FAILED, None))
        duals = split.duals(-np.asarray(result.y), np.asarray(result.z_l) - np.asarray(result.z_u))
        return QuadraticOutcome(
            ended,
            np.array(result.x, float),
            None,
            duals,
            limit,
            {"iterations": int(result.info.iter), "factors": "dense" if dense else "sparse"},
            f"PIQP: {status.name}" if ended is Ended.FAILED else "",
            ray=duals if ended is Ended.INFEASIBLE else None,
            direction=np.array(result.x, float) if ended is Ended.UNBOUNDED else None,
        )


def _dense(program: QuadraticProgram, asked: str) -> bool:
    if asked != "choose":
        return asked == "dense"
    size, rows = program.size, program.row_count
    filled = program.hessian.nnz + program.matrix.nnz
    return size + rows <= LARGEST_DENSE and (
        size + rows <= 50 or filled > DENSE * size * (size + rows)
    )
