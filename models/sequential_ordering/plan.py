"""Plan of a sequential ordering problem: the order of the nodes."""

from __future__ import annotations

from dataclasses import dataclass

from ..declaration import Plan
from ..fields import NumberTuple, declared

__all__ = ["SequentialOrderingPlan"]


@dataclass(frozen=True, eq=False)
class SequentialOrderingPlan(Plan):
    """Order of all nodes, from the first node to the last one.

    Parameters
    ----------
    order : tuple of int
        The nodes 0 … n - 1, each once.

    Raises
    ------
    InvalidData
        `order` is not a sequence of integers.
    """

    order: tuple[int, ...] = declared(NumberTuple(("n",), int))

    def __str__(self) -> str:
        return "-".join(map(str, self.order))
