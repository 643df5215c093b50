"""CasADi's own sequential quadratic programming, on any of its quadratic solvers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.programs.nonlinear import NonlinearProgram
from ..attempts import Clock, Ended, Ending, solver_tolerance
from ..backend import Limit, Option, Request
from ..casadi_plugins import ended_by_words, load_plugin, status_of
from .base import HESSIAN, most_iterations
from .casadi_nlp import CasadiNlp

__all__ = ["SqpMethod"]

Vector = NDArray[np.float64]

#: Columns of a block of the Hessian above which its eigenvalues are left alone.
LARGE = 50
#: What keeps each quadratic solver quiet.
_QUIET: Mapping[str, Mapping[str, Any]] = {
    "qrqp": {"print_iter": False, "print_header": False, "print_info": False},
    "qpoases": {"printLevel": "none"},
    "osqp": {"osqp": {"verbose": False, "eps_abs": 1e-10, "eps_rel": 1e-10, "max_iter": 20000}},
    "daqp": {},
}


class SqpMethod(CasadiNlp):
    """CasADi's ``sqpmethod``: a line search on a merit function, with the quadratic solver named.

    Left out are those that made it give up where these do not (HiGHS, ipqp, ProxQP), and PIQP, which
    writes of rows without bounds to the error output.
    """

    name = "sqpmethod"
    plugin = "sqpmethod"
    prompt = False
    given = {"jac_fg": "first_order", "hess_lag": "whole_hessian"}
    options: ClassVar[Mapping[str, Option]] = {
        "qp": Option("qrqp", "CasADi's name of the quadratic solver.", str, tuple(_QUIET)),
        "max_iter": most_iterations(500),
        "hessian": HESSIAN,
        "convexify": Option(
            "auto",
            "What makes the Hessian convex: a multiple of the identity, or its eigenvalues, block "
            "by block; auto takes the eigenvalues where no block is large.",
            str,
            ("auto", "regularize", "eigen-reflect", "eigen-clip"),
        ),
    }
    summary = "CasADi's SQP method on qrqp, qpOASES, OSQP … by option"

    def load(self, request: Request) -> None:
        """Load the plugin and its quadratic solver."""
        super().load(request)
        qp = str(request.options["qp"])
        load_plugin(self.name, "conic", qp)

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return the plugin's options."""
        own = request.options
        qp = str(own["qp"])
        exact = own["hessian"]
        options: dict[str, Any] = {
            "qpsol": qp,
            "qpsol_options": {"error_on_fail": False, **_QUIET[qp]},
            "print_header": request.verbose,
            "print_iteration": request.verbose,
            "print_status": request.verbose,
            "max_iter": own["max_iter"],
            "tol_pr": solver_tolerance(request.tolerance * 1e-2, 1e-12, 1e-9),
            "tol_du": solver_tolerance(request.tolerance, 1e-11, 1e-7),
            "hessian_approximation": exact,
        }
        if exact == "exact":
            how = str(own["convexify"])
            options["convexify_strategy"] = _strategy(program) if how == "auto" else how
        return options

    def attempt(
        self, program: NonlinearProgram, request: Request, clock: Clock, start: Vector
    ) -> Ending:
        """Search; where the quadratic programs fail, once more with a multiple of the identity.

        Reflected eigenvalues leave a Hessian singular that is, and solvers were seen to fail on it.
        With multipliers of 0 that of a linear objective is 0 altogether, so they are estimated.
        """
        found = super().attempt(program, request, clock, start)
        chosen = request.options["convexify"] != "auto"
        if found.ended is not Ended.FAILED or chosen or request.control.stopped:
            return found
        options = {**request.options, "convexify": "regularize"}
        safer = replace(request, options=options, warm_start=start)
        again = super().attempt(program, safer, clock, start)
        return again if again.ended is Ended.PROVEN else found

    def ended(self, stats: Mapping[str, Any]) -> tuple[Ended, Limit | None]:
        """Return how the plugin ended."""
        if status_of(stats) == "Search_Direction_Becomes_Too_Small":
            return Ended.FAILED, None
        return ended_by_words(stats)


def _strategy(program: NonlinearProgram) -> str:
    """Return the convexification: eigenvalues, unless columns hang together in a large block.

    CasADi's eigenvalues take long where a block has more columns, and then fail to converge.
    """
    import scipy.sparse as sp
    from scipy.sparse.csgraph import connected_components

    hessian = program.second_order.sparsity_out(0)
    rows, columns = (np.asarray(places, np.int64) for places in hessian.get_triplet())
    entries = sp.coo_array((np.ones(rows.size), (rows, columns)), shape=hessian.shape)
    blocks = connected_components(entries, directed=False)[1]
    return "eigen-reflect" if np.bincount(blocks).max() <= LARGE else "regularize"
