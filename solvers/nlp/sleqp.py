"""SLEQP: active sets from linear programs and equality-constrained steps, through CasADi."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Limit, Option, Request
from ..programs.attempts import Ended
from ..programs.casadi_plugins import HIGHS_MARK, ended_by_words, status_of
from .base import most_iterations
from .casadi_nlp import CasadiNlp

__all__ = ["Sleqp"]


class Sleqp(CasadiNlp):
    """Backend for SLEQP with CasADi's HiGHS, which conflicts with highspy and ortools."""

    name = "sleqp"
    plugin = "sleqp"
    limit_option = "max_wall_time"
    prompt = False
    brings_highs = True
    conflict_group = "highs"
    natives = (HIGHS_MARK,)
    options: ClassVar[Mapping[str, Option]] = {
        "max_iter": most_iterations(1000),
    }
    summary = "SLEQP: linear programs choose the active set, by CasADi"

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return the options of the plugin."""
        return {"max_iter": request.options["max_iter"], "print_level": 3 if request.verbose else 0}

    def ended(self, stats: Mapping[str, Any]) -> tuple[Ended, Limit | None]:
        """Return the ending of the plugin, which reports success in every case."""
        return ended_by_words({**stats, "success": status_of(stats) == "optimal"})
