"""Fatrop: an interior-point method made for optimal control, through CasADi."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ...models.programs.nonlinear import NonlinearProgram
from ..attempts import solver_tolerance
from ..backend import Option, Request
from .base import COMMON, most_iterations
from .casadi_nlp import CasadiNlp

__all__ = ["Fatrop"]


class Fatrop(CasadiNlp):
    """Fatrop, on the program as one stage, hence dense: its stages are no part of a program here.

    It hears of no stop and knows no time limit, so that its runs move to a process of their own.
    """

    name = "fatrop"
    plugin = "fatrop"
    features = COMMON
    options: ClassVar[Mapping[str, Option]] = {
        "max_iter": most_iterations(1000),
    }
    summary = "Fatrop: interior point for optimal control, by CasADi"

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return the plugin's options."""
        return {
            "structure_detection": "none",
            "fatrop": {
                "print_level": 5 if request.verbose else 0,
                "tol": solver_tolerance(request.tolerance * 1e-1, 1e-11, 1e-8),
                # It measures without scaling, and was seen to leave an optimum to which 1e-6 lacked.
                "tol_acceptable": 1e-5,
                "max_iter": request.options["max_iter"],
            },
        }
