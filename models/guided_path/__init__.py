"""Tour of a guided vehicle along a path, with precedence between customers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .model import GuidedPathTour as GuidedPathTour
    from .plan import GuidedPathPlan as GuidedPathPlan

MODELS = {"guided-path-tour": ".model:GuidedPathTour"}
PICTURES = {"guided-path-tour": ".plot:draw"}
ANIMATIONS = {"guided-path-tour": ".plot:animate_tour"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
