"""Routes of a fleet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...errors import InvalidData
from ..fields import Array, show

__all__ = ["FleetPlan"]


@dataclass(frozen=True)
class FleetPlan:
    """Which nodes each vehicle visits, in which order.

    Parameters
    ----------
    routes : tuple of tuple of int
        The nodes of each vehicle's route, without the depot at both ends; empty where it stays there.
    """

    routes: tuple[tuple[int, ...], ...]

    def __post_init__(self) -> None:
        given = self.routes
        if isinstance(given, str | Mapping) or not isinstance(given, Sequence):
            raise InvalidData(f"routes must be a list of routes, got {show(given)}", field="routes")
        routes = tuple(
            tuple(Array((f"n{k}",), int).coerce(f"routes[{k}]", route, {}).tolist())
            for k, route in enumerate(given)
        )
        object.__setattr__(self, "routes", routes)

    def to_data(self) -> dict[str, Any]:
        """Return the plan as JSON data."""
        return {"routes": [list(route) for route in self.routes]}

    @classmethod
    def from_data(cls, data: Any) -> FleetPlan:
        """Return the plan that :meth:`to_data` wrote; bad data raises ``InvalidData``."""
        if not isinstance(data, Mapping) or set(data) != {"routes"}:
            raise InvalidData(
                f"a plan must be an object with the key routes, got {show(data)}", field="plan"
            )
        return cls(data["routes"])

    def __str__(self) -> str:
        return " | ".join("-".join(map(str, route)) or "at the depot" for route in self.routes)
