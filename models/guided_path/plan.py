"""Plan of a guided vehicle's tour: the order of service."""

from __future__ import annotations

from dataclasses import dataclass

from ..declaration import Plan
from ..fields import NumberTuple, declared

__all__ = ["GuidedPathPlan"]


@dataclass(frozen=True, eq=False)
class GuidedPathPlan(Plan):
    """Order of service of the customers, from the start and back to it.

    Parameters
    ----------
    order : tuple of int
        The customers 1 … n, each once, without the start.

    Raises
    ------
    InvalidData
        `order` is not a sequence of integers.
    """

    order: tuple[int, ...] = declared(NumberTuple(("n",), int))

    def __str__(self) -> str:
        return "-".join(map(str, (0, *self.order, 0)))
