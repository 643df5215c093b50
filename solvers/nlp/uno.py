"""Uno: a solver composed of exchangeable parts, through CasADi."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Option, Request
from ..programs.attempts import solver_tolerance
from .base import most_iterations
from .casadi_nlp import CasadiNlp

__all__ = ["Uno"]


class Uno(CasadiNlp):
    """Backend for Uno with one of its presets; others are missing in CasADi's build or fail often.

    With 4000 columns, a step of its dense quadratic solver takes very long, and Fortran code prints to
    standard output, so it runs in a worker process.
    """

    name = "uno"
    plugin = "uno"
    limit_option = "time_limit"
    prompt = False
    options: ClassVar[Mapping[str, Option]] = {
        "max_iter": most_iterations(2000),
        "preset": Option(
            "filtersqp",
            "Strategy of the preset.",
            str,
            ("filtersqp", "funnelsqp", "ipopt"),
        ),
    }
    summary = "Uno: filterSQP, Ipopt's or another strategy, by CasADi"

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return the options of the plugin."""
        tolerance = solver_tolerance(request.tolerance * 1e-1, 1e-11, 1e-8)
        options = {
            "logger": "INFO" if request.verbose else "SILENT",
            "preset": request.options["preset"],
            "max_iterations": request.options["max_iter"],
            "primal_tolerance": tolerance,
            "dual_tolerance": tolerance,
        }
        return {"uno": options}
