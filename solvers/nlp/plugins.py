"""Plugins of ``casadi.nlpsol`` that differ mainly in options: all but Ipopt."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Limit, Option, Request
from ..programs.attempts import Clock, Ended, Ending, solver_tolerance
from ..programs.casadi_plugins import HIGHS_MARK, ended_by_words, load_plugin, status_of
from .base import COMMON, HESSIAN, most_iterations
from .casadi_nlp import DERIVATIVES, CasadiNlp

__all__ = ["BlockSqp", "Bonmin", "Fatrop", "Sleqp", "SqpMethod", "Uno"]

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


class BlockSqp(CasadiNlp):
    """Backend for blockSQP with the dense qpOASES, because the sparse one needs another library.

    Without it only BFGS updates are available. The solver cannot be stopped and prints past Python, so
    it runs in a worker process.
    """

    name = plugin = "blocksqp"
    features = COMMON
    options = {"max_iter": most_iterations(500)}
    summary = "blockSQP: dense quasi-Newton SQP, by CasADi"

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return the options of the plugin."""
        return {
            "schur": False,
            "print_header": request.verbose,
            "print_iteration": request.verbose,
            "print_maxit_reached": False,
            "max_iter": request.options["max_iter"],
            "opttol": solver_tolerance(request, 1e-10, 1e-7),
            "nlinfeastol": solver_tolerance(request, 1e-12, 1e-9, share=1e-2),
            "hess_update": 2,
            "hess_lim_mem": 0,
        }


class Bonmin(CasadiNlp):
    """Backend for Bonmin, branch and bound with Ipopt, which ends at the root node without integers.

    It prunes with local optima of the relaxations, so its answer is optimal if these are convex. Its
    claim is local in any case, because nothing proves convexity. Its time limit is processor time. Its
    multipliers are estimated from its point, as CasADi does not read them. It cannot be stopped, so it
    runs in a worker process.
    """

    name = plugin = "bonmin"
    limit_option = "time_limit"
    given = DERIVATIVES
    features = COMMON
    integral_kinds = ("nonlinear-program",)
    options = {"max_iter": most_iterations(3000)}
    summary = "Bonmin: branch and bound over Ipopt, by CasADi"

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return the options of the plugin."""
        quiet = ("print_level", "bb_log_level", "nlp_log_level", "lp_log_level", "nlp_log_at_root")
        options = {"sb": "yes", "tol": 1e-8, "max_iter": request.options["max_iter"]}
        silent = {} if request.verbose else dict.fromkeys(quiet, 0)
        if program.integral is None:
            return {"bonmin": {**silent, **options}}
        # Its default, an absolute decrease of 1e-5, pruned better points of objectives of size 1e-6.
        exact = {**silent, **options, "cutoff_decr": 0.0}
        return {"bonmin": exact, "discrete": program.integral.tolist()}


class Fatrop(CasadiNlp):
    """Backend for Fatrop, an interior-point method made for optimal control.

    The program is one dense stage, because programs have no stages here. Fatrop has no time limit and
    cannot be stopped, so it runs in a worker process.
    """

    name = plugin = "fatrop"
    features = COMMON
    options = {"max_iter": most_iterations(1000)}
    summary = "Fatrop: interior point for optimal control, by CasADi"

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return the options of the plugin."""
        return {
            "structure_detection": "none",
            "fatrop": {
                "print_level": 5 if request.verbose else 0,
                "tol": solver_tolerance(request, 1e-11, 1e-8, share=1e-1),
                # Fatrop measures without scaling, and rejected an optimum with an error of 1e-6.
                "tol_acceptable": 1e-5,
                "max_iter": request.options["max_iter"],
            },
        }


class Sleqp(CasadiNlp):
    """Backend for SLEQP with CasADi's HiGHS, which conflicts with highspy and ortools.

    Linear programs choose the active set of its equality-constrained steps.
    """

    name = plugin = "sleqp"
    limit_option = "max_wall_time"
    prompt = False
    brings_highs = True
    conflict_group = "highs"
    natives = (HIGHS_MARK,)
    options = {"max_iter": most_iterations(1000)}
    summary = "SLEQP: linear programs choose the active set, by CasADi"

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return the options of the plugin."""
        return {"max_iter": request.options["max_iter"], "print_level": 3 if request.verbose else 0}

    def ended(self, stats: Mapping[str, Any]) -> tuple[Ended, Limit | None]:
        """Return the ending of the plugin, which reports success in every case."""
        return ended_by_words({**stats, "success": status_of(stats) == "optimal"})


class Uno(CasadiNlp):
    """Backend for Uno with one of its presets; others are missing in CasADi's build or fail often.

    With 4000 columns, a step of its dense quadratic solver takes very long, and Fortran code prints to
    standard output, so it runs in a worker process.
    """

    name = plugin = "uno"
    limit_option = "time_limit"
    prompt = False
    options = {
        "max_iter": most_iterations(2000),
        "preset": Option(
            "filtersqp", "Strategy of the preset.", str, ("filtersqp", "funnelsqp", "ipopt")
        ),
    }
    summary = "Uno: filterSQP, Ipopt's or another strategy, by CasADi"

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return the options of the plugin."""
        tolerance = solver_tolerance(request, 1e-11, 1e-8, share=1e-1)
        options = {
            "logger": "INFO" if request.verbose else "SILENT",
            "preset": request.options["preset"],
            "max_iterations": request.options["max_iter"],
            "primal_tolerance": tolerance,
            "dual_tolerance": tolerance,
        }
        return {"uno": options}


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
