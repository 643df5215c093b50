"""Reconstruction of the attractor behind a measured time series, such as pursuing robots."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .model import AttractorAnalysis as AttractorAnalysis
    from .plan import (
        AttractorEstimate as AttractorEstimate,
        Evidence as Evidence,
        Judgement as Judgement,
        Measures as Measures,
        Slope as Slope,
        Spectrum as Spectrum,
        SurrogateTest as SurrogateTest,
    )

MODELS = {"attractor": ".model:AttractorAnalysis"}
PICTURES = {"attractor": ".plot:draw"}
ANIMATIONS = {"attractor": ".plot:animate_states"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
