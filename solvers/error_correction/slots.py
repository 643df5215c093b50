"""What searches know of the slots of a grid: critical points as bits, and the way that remains."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .airspace import Airspace
from .grid import Grid
from .steps import remaining

__all__ = ["critical_bits", "shortest_ways"]

#: Arcs that the search for the ways that remain looks at, at most: a second's work or less.
MOST_ARCS = 200_000_000


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

    The shortest way over arcs that the thresholds alone allow, as far as :data:`MOST_ARCS` arcs
    tell; see :func:`.steps.remaining`.
    """
    way: NDArray[np.float64] = remaining(space, grid, forward, MOST_ARCS, flag)
    return way
