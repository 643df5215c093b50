"""Data of grid slots for searches: bits of critical points, and remaining lengths."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .airspace import Airspace
from .grid import Grid
from .steps import remaining

__all__ = ["critical_bits", "shortest_ways"]

#: Maximum number of arcs scanned for the remaining lengths, at most about 1 s of work.
MOST_ARCS = 200_000_000


def critical_bits(grid: Grid, critical: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """Return the bit number of every slot (-1 if not critical) and the number of 64-bit words.

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
    """Return a lower bound on the length from every slot to B, m, or with `forward` from A to it.

    The bound is the shortest path over arcs within the thresholds, computed with at most
    :data:`MOST_ARCS` arcs; see :func:`.steps.remaining`.
    """
    way: NDArray[np.float64] = remaining(space, grid, forward, MOST_ARCS, flag)
    return way
