"""Fatrop: an interior-point method made for optimal control, through CasADi."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Option, Request
from ..programs.attempts import solver_tolerance
from .base import COMMON, most_iterations
from .casadi_nlp import CasadiNlp

__all__ = ["Fatrop"]


class Fatrop(CasadiNlp):
    """Backend for Fatrop, with the program as one dense stage, because programs have no stages here.

    It has no time limit and cannot be stopped, so it runs in a worker process.
    """

    name = "fatrop"
    plugin = "fatrop"
    features = COMMON
    options: ClassVar[Mapping[str, Option]] = {
        "max_iter": most_iterations(1000),
    }
    summary = "Fatrop: interior point for optimal control, by CasADi"

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return the options of the plugin."""
        return {
            "structure_detection": "none",
            "fatrop": {
                "print_level": 5 if request.verbose else 0,
                "tol": solver_tolerance(request.tolerance * 1e-1, 1e-11, 1e-8),
                # Fatrop measures without scaling, and rejected an optimum with an error of 1e-6.
                "tol_acceptable": 1e-5,
                "max_iter": request.options["max_iter"],
            },
        }
