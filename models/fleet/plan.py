"""Routes of a fleet."""

from __future__ import annotations

from dataclasses import dataclass

from ..declaration import Plan
from ..fields import NumberTuple, declared
from ..records import Several

__all__ = ["FleetPlan"]


@dataclass(frozen=True, eq=False)
class FleetPlan(Plan):
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

    routes: tuple[tuple[int, ...], ...] = declared(Several(NumberTuple(("stops",), int)))

    def __str__(self) -> str:
        return " | ".join("-".join(map(str, route)) or "at the depot" for route in self.routes)
