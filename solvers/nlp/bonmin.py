"""Bonmin: branch and bound with Ipopt. Without integer columns, it ends at the root node."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Option, Request
from .base import COMMON, most_iterations
from .casadi_nlp import DERIVATIVES, CasadiNlp

__all__ = ["Bonmin"]


class Bonmin(CasadiNlp):
    """Backend for Bonmin. Its multipliers are estimated from its point, as CasADi does not read them.

    It cannot be stopped, so it runs in a worker process.
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
        """Return the options of the plugin."""
        quiet = ("print_level", "bb_log_level", "nlp_log_level", "lp_log_level", "nlp_log_at_root")
        options = {"sb": "yes", "tol": 1e-8, "max_iter": request.options["max_iter"]}
        silent = {} if request.verbose else dict.fromkeys(quiet, 0)
        return {"bonmin": {**silent, **options}}
