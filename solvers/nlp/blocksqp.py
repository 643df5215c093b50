"""blockSQP: quasi-Newton sequential quadratic programming on qpOASES, through CasADi."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ...models.programs.nonlinear import NonlinearProgram
from ..attempts import solver_tolerance
from ..backend import Option, Request
from .base import COMMON, most_iterations
from .casadi_nlp import CasadiNlp

__all__ = ["BlockSqp"]


class BlockSqp(CasadiNlp):
    """blockSQP with the dense variant of qpOASES, for the sparse one needs a library of its own.

    Without it only BFGS updates are to be had. It hears of no stop and greets past Python, so that its
    runs move to a process of their own.
    """

    name = "blocksqp"
    plugin = "blocksqp"
    features = COMMON
    options: ClassVar[Mapping[str, Option]] = {
        "max_iter": most_iterations(500),
    }
    summary = "blockSQP: dense quasi-Newton SQP, by CasADi"

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return the plugin's options."""
        return {
            "schur": False,
            "print_header": request.verbose,
            "print_iteration": request.verbose,
            "print_maxit_reached": False,
            "max_iter": request.options["max_iter"],
            "opttol": solver_tolerance(request.tolerance, 1e-10, 1e-7),
            "nlinfeastol": solver_tolerance(request.tolerance * 1e-2, 1e-12, 1e-9),
            "hess_update": 2,
            "hess_lim_mem": 0,
        }
