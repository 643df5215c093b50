"""Shared parts of the routing formulations: validation, and routes from used arcs."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, UnsupportedFormulation, UnsupportedOption, show
from .route import Route

__all__ = ["Ends", "follow", "refuse_revisits", "require_positive", "require_route"]


class Ends(Protocol):
    """Protocol of models whose routes lead from one point to another."""

    @property
    def start(self) -> int:
        """First point of the routes."""

    @property
    def end(self) -> int:
        """Last point of the routes."""

    @property
    def revisits(self) -> bool:
        """Whether a point may be visited more than once."""


def refuse_revisits(model: Ends, formulation: str) -> None:
    """Raise :class:`UnsupportedFormulation` if the model allows revisits or asks for several routes."""
    routes = getattr(model, "routes", 1)
    if routes > 1:
        raise UnsupportedFormulation(
            f"formulation {formulation!r} returns one route, but the model has routes={routes}; "
            "set routes=1 or use a native backend"
        )
    if model.revisits:
        raise UnsupportedFormulation(
            f"formulation {formulation!r} visits a point at most once, but the model has revisits=True; "
            "set revisits=False or use a native backend"
        )


def require_positive(formulation: str, **options: Any) -> None:
    """Raise :class:`UnsupportedOption` unless each option is None or a number above 0."""
    for name, value in options.items():
        positive = isinstance(value, int | float) and not isinstance(value, bool) and value > 0
        if value is not None and not positive:
            raise UnsupportedOption(
                f"formulation {formulation!r}: {name} must be a number > 0, got {show(value)}"
            )


def require_route(model: Ends, plan: Route) -> tuple[int, ...]:
    """Return the indices of a simple route from start to end; raise ``InvalidData`` otherwise."""
    route = plan.route
    if len(route) < 2 or route[0] != model.start or route[-1] != model.end:
        raise InvalidData(
            f"a route goes from point {model.start} to point {model.end}, got {plan}", field="route"
        )
    if len(set(route)) != len(route):
        repeated = next(k for k in route if route.count(k) > 1)
        raise InvalidData(
            f"point {repeated} is in the route twice, which the formulation does not allow",
            field="route",
        )
    return route


def follow(model: Ends, tail: NDArray[np.int64], head: NDArray[np.int64]) -> Route:
    """Return the route from start to end over arcs ``tail -> head``; separate cycles are dropped."""
    successor: dict[int, int] = {}
    for i, j in zip(tail.tolist(), head.tolist(), strict=True):
        if i in successor:
            raise InvalidData(f"two arcs leave point {i}: to {successor[i]} and {j}", field="point")
        successor[i] = j
    route = [model.start]
    while route[-1] != model.end:
        following = successor.get(route[-1])
        if following is None:
            raise InvalidData(
                f"the arcs from the start end at point {route[-1]}, not at the end", field="point"
            )
        if len(route) > len(successor):
            raise InvalidData(
                "the arcs from the start run in a circle and never reach the end", field="point"
            )
        route.append(following)
    return Route(tuple(route))
