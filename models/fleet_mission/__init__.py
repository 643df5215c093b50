"""A mission of several robots on a map, from polygons to trajectories."""

from __future__ import annotations

from ...lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, {})
