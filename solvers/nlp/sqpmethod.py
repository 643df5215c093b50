"""CasADi's sequential quadratic programming with any of its quadratic solvers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Limit, Option, Request
from ..programs.attempts import Clock, Ended, Ending, solver_tolerance
from ..programs.casadi_plugins import ended_by_words, load_plugin, status_of
from .base import HESSIAN, most_iterations
from .casadi_nlp import CasadiNlp

__all__ = ["SqpMethod"]

Vector = NDArray[np.float64]

#: Largest block of the Hessian, in columns, whose eigenvalues are computed.
LARGE = 50
#: Options that silence each quadratic solver.
_QUIET: Mapping[str, Mapping[str, Any]] = {
    "qrqp": {"print_iter": False, "print_header": False, "print_info": False},
    "qpoases": {"printLevel": "none"},
    "osqp": {"osqp": {"verbose": False, "eps_abs": 1e-10, "eps_rel": 1e-10, "max_iter": 20000}},
    "daqp": {},
}


class SqpMethod(CasadiNlp):
    """Backend for CasADi's ``sqpmethod``, a line search on a merit function.

    Quadratic solvers with which it fails more often (HiGHS, ipqp, ProxQP) are not offered, nor is
    PIQP, which writes messages about rows without bounds to standard error.
    """

    name = "sqpmethod"
    plugin = "sqpmethod"
    prompt = False
    given = {"jac_fg": "first_order", "hess_lag": "whole_hessian"}
    options: ClassVar[Mapping[str, Option]] = {
        "qp": Option("qrqp", "Name of the quadratic solver in CasADi.", str, tuple(_QUIET)),
        "max_iter": most_iterations(500),
        "hessian": HESSIAN,
        "convexify": Option(
            "auto",
            "Method that makes the Hessian convex: a multiple of the identity, or its eigenvalues, block "
            "by block; auto uses the eigenvalues if no block is large.",
            str,
            ("auto", "regularize", "eigen-reflect", "eigen-clip"),
        ),
    }
    summary = "CasADi's SQP method on qrqp, qpOASES, OSQP or DAQP, by option"

    def load(self, request: Request) -> None:
        """Load the plugin and its quadratic solver."""
        super().load(request)
        qp = str(request.options["qp"])
        load_plugin(self.name, "conic", qp)

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return the options of the plugin."""
        given = request.options
        qp = str(given["qp"])
        exact = given["hessian"]
        options: dict[str, Any] = {
            "qpsol": qp,
            "qpsol_options": {"error_on_fail": False, **_QUIET[qp]},
            "print_header": request.verbose,
            "print_iteration": request.verbose,
            "print_status": request.verbose,
            "max_iter": given["max_iter"],
            "tol_pr": solver_tolerance(request, 1e-12, 1e-9, share=1e-2),
            "tol_du": solver_tolerance(request, 1e-11, 1e-7),
            "hessian_approximation": exact,
        }
        if exact == "exact":
            strategy = str(given["convexify"])
            options["convexify_strategy"] = _strategy(program) if strategy == "auto" else strategy
        return options

    def attempt(
        self, program: NonlinearProgram, request: Request, clock: Clock, start: Vector
    ) -> Ending:
        """Search; if the quadratic programs fail, search again with a multiple of the identity.

        Reflected eigenvalues leave a singular Hessian singular, and quadratic solvers failed on it. With
        zero multipliers, the Hessian for a linear objective is zero, so the multipliers are estimated.
        """
        first = super().attempt(program, request, clock, start)
        is_fixed = request.options["convexify"] != "auto"
        if first.ended is not Ended.FAILED or is_fixed or request.control.stopped:
            return first
        options = {**request.options, "convexify": "regularize"}
        safer = replace(request, options=options, warm_start=start)
        second = super().attempt(program, safer, clock, start)
        return second if second.ended is Ended.PROVEN else first

    def ended(self, stats: Mapping[str, Any]) -> tuple[Ended, Limit | None]:
        """Return the ending of the plugin."""
        if status_of(stats) == "Search_Direction_Becomes_Too_Small":
            return Ended.FAILED, None
        return ended_by_words(stats)


def _strategy(program: NonlinearProgram) -> str:
    """Return the convexification: eigenvalues, unless the columns form a large block.

    CasADi's eigenvalue method is slow for larger blocks, and then fails to converge.
    """
    import scipy.sparse as sp
    from scipy.sparse.csgraph import connected_components

    hessian = program.second_order.sparsity_out(0)
    rows, columns = (np.asarray(places, np.int64) for places in hessian.get_triplet())
    entries = sp.coo_array((np.ones(rows.size), (rows, columns)), shape=hessian.shape)
    blocks = connected_components(entries, directed=False)[1]
    return "eigen-reflect" if np.bincount(blocks).max() <= LARGE else "regularize"
