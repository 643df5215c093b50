"""The shortest route on which resources are used up and reset."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .model import ResourceRouting as ResourceRouting
    from .resource import Resource as Resource

MODELS = {"resource-routing": ".model:ResourceRouting"}
PICTURES = {"resource-routing": ".plot:draw"}

__getattr__, __dir__, __all__ = attach(
    __name__,
    {"model": ("ResourceRouting",), "resource": ("Resource",)},
)
