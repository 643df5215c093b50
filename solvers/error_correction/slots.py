"""What searches know of the slots of a grid: critical points as bits, and the way that remains."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .airspace import Airspace
from .grid import Grid
from .steps import distances_to, remaining

__all__ = ["critical_bits", "shortest_ways"]

#: Above so many slots, the quadratic search for the way that remains does not pay.
_MANY = 20_000


def critical_bits(grid: Grid, critical: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """Return the bit of every slot (-1 where it is not critical) and the words that they need.

    Parameters
    ----------
    grid : Grid
        The slots.
    critical : ndarray of int64
        Indices of the critical points, ascending.
    """
    bits = np.full(len(grid.ids), -1)
    if critical.size:
        place = np.minimum(np.searchsorted(critical, grid.ids), critical.size - 1)
        bits = np.where(critical[place] == grid.ids, place, -1)
    return bits.astype(np.int64), (critical.size + 63) // 64


def shortest_ways(
    space: Airspace, grid: Grid, flag: NDArray[np.int8], *, forward: bool = False
) -> NDArray[np.float64]:
    """Return a lower bound on the length from every slot to B, or with `forward` from A to it.

    The shortest way over arcs that the thresholds alone allow; for very many points, where finding
    it takes longer than it saves, the straight line.
    """
    if len(grid.x) > _MANY:
        line: NDArray[np.float64] = distances_to(grid, len(grid.x) - (2 if forward else 1))
        return line
    way: NDArray[np.float64] = remaining(space, grid, forward, flag)
    return way
