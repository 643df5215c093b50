"""blockSQP: quasi-Newton sequential quadratic programming on qpOASES, through CasADi."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ...models.programs.nonlinear import NonlinearProgram
from ..backend import Option, Request
from .casadi_nlp import CasadiNlp

__all__ = ["BlockSqp"]


class BlockSqp(CasadiNlp):
    """blockSQP with the dense variant of qpOASES, for the sparse one needs a library of its own.

    Without it only BFGS updates are to be had. It hears of no stop and greets past Python, so that its
    runs move to a process of their own.
    """

    name = "blocksqp"
    plugin = "blocksqp"
    watchable = False
    talks = "native"
    options: ClassVar[Mapping[str, Option]] = {
        "max_iter": Option(500, "Iterations at most.", int, lower=1),
    }
    summary = "blockSQP: dense quasi-Newton SQP, by CasADi"

    def settings(
        self, program: NonlinearProgram, request: Request, left: float | None
    ) -> dict[str, Any]:
        """Return the plugin's options."""
        return {
            "schur": False,
            "print_header": False,
            "print_iteration": False,
            "print_maxit_reached": False,
            "max_iter": request.options.get("max_iter", 500),
            "opttol": max(min(1e-7, request.tolerance * 1e-1), 1e-10),
            "nlinfeastol": max(min(1e-9, request.tolerance * 1e-3), 1e-12),
            "hess_update": 2,
            "hess_lim_mem": 0,
        }
