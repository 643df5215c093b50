"""Uno: a solver put together from the parts of many, through CasADi."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ...models.programs.nonlinear import NonlinearProgram
from ..attempts import solver_tolerance
from ..backend import Option, Request
from .base import most_iterations
from .casadi_nlp import CasadiNlp

__all__ = ["Uno"]


class Uno(CasadiNlp):
    """Uno as one of its presets; those left out are unknown to CasADi's build or gave up too often.

    On 4000 columns a step of its dense quadratic solver took longer than anybody waits, and words of
    Fortran appeared on the standard output: it runs in a process of its own.
    """

    name = "uno"
    plugin = "uno"
    limit_option = "time_limit"
    prompt = False
    options: ClassVar[Mapping[str, Option]] = {
        "max_iter": most_iterations(2000),
        "preset": Option(
            "filtersqp",
            "Whose strategy is followed.",
            str,
            ("filtersqp", "funnelsqp", "ipopt"),
        ),
    }
    summary = "Uno: filterSQP, Ipopt's or another strategy from one kit, by CasADi"

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return the plugin's options."""
        tolerance = solver_tolerance(request.tolerance * 1e-1, 1e-11, 1e-8)
        options = {
            "logger": "INFO" if request.verbose else "SILENT",
            "preset": request.options["preset"],
            "max_iterations": request.options["max_iter"],
            "primal_tolerance": tolerance,
            "dual_tolerance": tolerance,
        }
        return {"uno": options}
