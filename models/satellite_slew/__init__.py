"""Minimum-time slew of a satellite with control moment gyros."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .flight import Breach as Breach, Tracking as Tracking
    from .model import SatelliteSlew as SatelliteSlew
    from .tracking import track as track

MODELS = {"satellite-slew": ".model:SatelliteSlew"}
PICTURES = {"satellite-slew": ".plot:draw"}
ANIMATIONS = {"satellite-slew": ".plot:animate_slew"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
