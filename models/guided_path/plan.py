"""Plan of a guided vehicle's tour: the order of service."""

from __future__ import annotations

from dataclasses import dataclass

from ..declaration import Plan
from ..fields import NumberTuple, declared

__all__ = ["GuidedPathPlan"]


@dataclass(frozen=True, eq=False)
class GuidedPathPlan(Plan):
    """Order of service of the customers, between the start and the end of the tour.

    Parameters
    ----------
    order : tuple of int
        The customers 1 … n, each once, without the start; those of several vehicles in one sequence.
    vehicles : tuple of int
        Vehicle of each entry of `order`, numbered from 0 from left to right; empty for one vehicle.

    Raises
    ------
    InvalidData
        `order` or `vehicles` is not a sequence of integers.
    """

    order: tuple[int, ...] = declared(NumberTuple(("n",), int))
    vehicles: tuple[int, ...] = declared(NumberTuple(("m",), int), default=(), added=True)

    def __str__(self) -> str:
        words = " by vehicles " + "-".join(map(str, self.vehicles)) if self.vehicles else ""
        return "-".join(map(str, self.order)) + words
