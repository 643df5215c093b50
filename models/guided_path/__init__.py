"""Tour of a guided vehicle along a path, with precedence between customers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .model import GuidedPathTour as GuidedPathTour
    from .plan import GuidedPathPlan as GuidedPathPlan

#: Names that modules of other problems import, beside the public ones.
SHARED = (
    "orders.columns_of_order",
    "orders.follow_arcs",
    "orders.order_program",
    "orders.usable_arcs",
    "relation.closure_of",
    "relation.listed_pairs",
    "relation.sorted_customers",
)
MODELS = {"guided-path-tour": ".model:GuidedPathTour"}
PICTURES = {"guided-path-tour": ".plot:draw"}
ANIMATIONS = {"guided-path-tour": ".plot:animate_tour"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
