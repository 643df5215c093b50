"""Shortest path through all nodes with asymmetric distances and precedence: sequential ordering."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .model import SequentialOrdering as SequentialOrdering
    from .plan import SequentialOrderingPlan as SequentialOrderingPlan

MODELS = {"sequential-ordering": ".model:SequentialOrdering"}
PICTURES = {"sequential-ordering": ".plot:draw"}
ANIMATIONS = {"sequential-ordering": ".plot:animate_ordering"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
