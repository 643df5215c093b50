"""Bonmin: branch and bound over Ipopt, which a program without integers leaves at its root."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ...models.programs.nonlinear import NonlinearProgram
from ..backend import Option, Request
from .base import COMMON, most_iterations
from .casadi_nlp import DERIVATIVES, CasadiNlp

__all__ = ["Bonmin"]


class Bonmin(CasadiNlp):
    """Bonmin, whose multipliers CasADi does not read: they are estimated from its point.

    It hears of no stop, so that its runs move to a process of their own.
    """

    name = "bonmin"
    plugin = "bonmin"
    limit_option = "time_limit"
    given = DERIVATIVES
    features = COMMON
    options: ClassVar[Mapping[str, Option]] = {
        "max_iter": most_iterations(3000),
    }
    summary = "Bonmin: branch and bound over Ipopt, by CasADi"

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return the plugin's options."""
        quiet = ("print_level", "bb_log_level", "nlp_log_level", "lp_log_level", "nlp_log_at_root")
        own = {"sb": "yes", "tol": 1e-8, "max_iter": request.options["max_iter"]}
        told = {} if request.verbose else dict.fromkeys(quiet, 0)
        return {"bonmin": {**told, **own}}
