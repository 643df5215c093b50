"""Tour of a UAV that delivers messages to moving vehicles."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .model import MessengerTour as MessengerTour
    from .plan import Primitive as Primitive, TourPlan as TourPlan

MODELS = {"messenger-tour": ".model:MessengerTour"}
PICTURES = {"messenger-tour": ".plot:draw"}
ANIMATIONS = {"messenger-tour": ".plot:animate_tour"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
