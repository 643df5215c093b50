"""Shortest route with any number of resources that are consumed and reset."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .model import ResourceRouting as ResourceRouting
    from .resource import Resource as Resource

#: Names that modules of other problems import, beside the public ones.
SHARED = (
    "arc_flow.ResourceFlowFormulation",
    "arcs.UsedArcs",
    "arcs.require_few",
    "checks.exact_sum",
    "route.Route",
    "route.route_from_data",
    "route.route_of_indices",
    "route.route_to_data",
    "routes.follow",
    "routes.refuse_revisits",
    "routes.require_positive",
    "routes.require_route",
)
MODELS = {"resource-routing": ".model:ResourceRouting"}
PICTURES = {"resource-routing": ".plot:draw"}
ANIMATIONS = {"resource-routing": ".plot:animate_route"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
