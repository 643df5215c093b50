"""Routes of a fleet."""

from __future__ import annotations

from dataclasses import dataclass

from ..declaration import Plan
from ..fields import NumberTuple, Optional, declared
from ..records import Several

__all__ = ["FleetPlan"]


@dataclass(frozen=True, eq=False)
class FleetPlan(Plan):
    """Routes of all vehicles: the nodes of each, in the order of visits.

    Parameters
    ----------
    routes : tuple of tuple of int
        Nodes of each vehicle's route, without the depot at both ends; empty for an idle vehicle.
        Reloads and stations are nodes of the route.
    starts : tuple of tuple of float, optional
        Times of each vehicle in seconds: departure, begin of each service, return. An idle vehicle has
        none. An open route ends with the end of its last service. Models with times require it.

    Raises
    ------
    InvalidData
        The routes are not a list of lists of whole numbers, or the times no list of lists of numbers.
    """

    routes: tuple[tuple[int, ...], ...] = declared(Several(NumberTuple(("stops",), int)))
    starts: tuple[tuple[float, ...], ...] | None = declared(
        Optional(Several(NumberTuple(("times",)))), default=None, added=True
    )

    def __str__(self) -> str:
        return " | ".join("-".join(map(str, route)) or "at the depot" for route in self.routes)
