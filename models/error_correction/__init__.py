"""Shortest route of a UAV whose positioning errors must be corrected on the way."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .model import (
        ErrorCorrectionRouting as ErrorCorrectionRouting,
        Route as Route,
        Stop as Stop,
    )

MODELS = {"error-correction": ".model:ErrorCorrectionRouting"}
PICTURES = {"error-correction": ".plot:draw"}
ANIMATIONS = {"error-correction": ".plot:animate_route"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
