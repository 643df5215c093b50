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
    """Routes of all vehicles: the nodes of each, in the order of visits.

    Parameters
    ----------
    routes : tuple of tuple of int
        Nodes of each vehicle's route, without the depot at both ends; empty for an idle vehicle.

    Raises
    ------
    InvalidData
        The routes are not a list of lists of whole numbers.
    """

    routes: tuple[tuple[int, ...], ...]

    def __post_init__(self) -> None:
        entries = self.routes
        if isinstance(entries, str | Mapping) or not isinstance(entries, Sequence):
            raise InvalidData(
                f"routes must be a list of routes, got {show(entries)}", field="routes"
            )
        routes = tuple(
            tuple(Array((f"n{k}",), int).coerce(f"routes[{k}]", route, {}).tolist())
            for k, route in enumerate(entries)
        )
        object.__setattr__(self, "routes", routes)

    def to_data(self) -> dict[str, Any]:
        """Return the plan as JSON data."""
        return {"routes": [list(route) for route in self.routes]}

    @classmethod
    def from_data(cls, data: Any) -> FleetPlan:
        """Return the plan stored in `data` by :meth:`to_data`; bad data raises ``InvalidData``."""
        if not isinstance(data, Mapping) or set(data) != {"routes"}:
            raise InvalidData(
                f"a plan must be an object with the key routes, got {show(data)}", field="plan"
            )
        return cls(data["routes"])

    def __str__(self) -> str:
        return " | ".join("-".join(map(str, route)) or "at the depot" for route in self.routes)
