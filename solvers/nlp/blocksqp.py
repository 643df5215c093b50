"""blockSQP: quasi-Newton sequential quadratic programming on qpOASES, through CasADi."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Option, Request
from ..programs.attempts import solver_tolerance
from .base import COMMON, most_iterations
from .casadi_nlp import CasadiNlp

__all__ = ["BlockSqp"]


class BlockSqp(CasadiNlp):
    """Backend for blockSQP with the dense qpOASES, because the sparse one needs another library.

    Without it only BFGS updates are available. The solver cannot be stopped and prints past Python, so
    it runs in a worker process.
    """

    name = "blocksqp"
    plugin = "blocksqp"
    features = COMMON
    options: ClassVar[Mapping[str, Option]] = {
        "max_iter": most_iterations(500),
    }
    summary = "blockSQP: dense quasi-Newton SQP, by CasADi"

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return the options of the plugin."""
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
