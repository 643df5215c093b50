"""Estimate of a vehicle's sideslip angle from its standard sensors."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .data import (
        Recording as Recording,
        Tyre as Tyre,
        Vehicle as Vehicle,
        estimate_speed as estimate_speed,
    )
    from .identification import Identification as Identification, identify as identify
    from .model import SideslipEstimation as SideslipEstimation
    from .plan import SideslipEstimate as SideslipEstimate

MODELS = {"sideslip": ".model:SideslipEstimation"}
PICTURES = {"sideslip": ".plot:draw"}
ANIMATIONS = {"sideslip": ".plot:animate_estimate"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
