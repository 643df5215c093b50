"""Bonmin, Fatrop, blockSQP, SLEQP and Uno: plugins of ``casadi.nlpsol`` that differ only in options."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Limit, Option, Request
from ..programs.attempts import Ended, solver_tolerance
from ..programs.casadi_plugins import HIGHS_MARK, ended_by_words, status_of
from .base import COMMON, most_iterations
from .casadi_nlp import DERIVATIVES, CasadiNlp

__all__ = ["BlockSqp", "Bonmin", "Fatrop", "Sleqp", "Uno"]


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

    Its multipliers are estimated from its point, as CasADi does not read them. It cannot be stopped,
    so it runs in a worker process.
    """

    name = plugin = "bonmin"
    limit_option = "time_limit"
    given = DERIVATIVES
    features = COMMON
    options = {"max_iter": most_iterations(3000)}
    summary = "Bonmin: branch and bound over Ipopt, by CasADi"

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return the options of the plugin."""
        quiet = ("print_level", "bb_log_level", "nlp_log_level", "lp_log_level", "nlp_log_at_root")
        options = {"sb": "yes", "tol": 1e-8, "max_iter": request.options["max_iter"]}
        silent = {} if request.verbose else dict.fromkeys(quiet, 0)
        return {"bonmin": {**silent, **options}}


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
