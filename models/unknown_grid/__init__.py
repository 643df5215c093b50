"""Navigation of a vehicle on a partially observed map."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .camera import Camera as Camera, Rendering as Rendering
    from .model import UnknownGridNavigation as UnknownGridNavigation
    from .plan import NavigationRuns as NavigationRuns, Outcome as Outcome
    from .scenes import Aspect as Aspect, Corners as Corners, Hover as Hover
    from .world import World as World

MODELS = {"unknown-grid": ".model:UnknownGridNavigation"}
PICTURES = {"unknown-grid": ".plot:draw"}
ANIMATIONS = {"unknown-grid": ".plot:animate_run"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
