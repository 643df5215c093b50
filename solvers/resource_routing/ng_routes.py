"""Points that labels remember: all critical points, or those near the last point (ng-routes).

Sources: R. Baldacci, A. Mingozzi and R. Roberti, "New route relaxation and pricing strategies for the vehicle
routing problem", Operations Research 59 (2011); the neighbourhoods grow with the cycles that a search returns, as
in R. Roberti and A. Mingozzi, "Dynamic ng-path relaxation for the delivery man problem", Transportation Science
48 (2014).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .network import Network

__all__ = ["Memory"]

#: Points in the first neighbourhood of a point.
NEAR = 8

Whole = NDArray[np.int64]


class Memory:
    """Neighbourhoods of a network, whose points are all critical if prizes make cycles attractive (`signed`)."""

    def __init__(self, net: Network, signed: bool) -> None:
        self.count, self.signed = len(net.first) - 1, signed
        self.near = np.zeros((self.count, self.count if signed else 0), bool)
        if signed:
            tail = np.repeat(np.arange(self.count), np.diff(net.first))
            back = np.full((self.count, self.count), np.inf)
            back[net.head, tail] = net.length
            cost = np.minimum(back, back.T)
            order = np.argsort(cost, axis=1)[:, :NEAR]
            np.put_along_axis(self.near, order, np.isfinite(np.take_along_axis(cost, order, 1)), 1)
            self.near[np.diag_indices(self.count)] = True

    def arrays(self, critical: Whole) -> tuple[Whole, Whole, NDArray[np.uint64]]:
        """Return the critical points, the bit of each point, and the bits that each point remembers."""
        if self.signed:
            critical = np.arange(self.count)
        bits = np.full(self.count, -1)
        bits[critical] = np.arange(critical.size)
        words = (critical.size + 63) // 64
        if not self.signed:
            return critical, bits, np.full((self.count, words), -1).astype(np.uint64)
        padded = np.zeros((self.count, 64 * words), np.uint8)
        padded[:, : self.count] = self.near
        packed = np.packbits(padded, axis=1, bitorder="little").view("<u8")
        return critical, bits, np.ascontiguousarray(packed.astype(np.uint64))

    def learn(self, walk: Whole) -> None:
        """Let the points of each cycle of `walk` remember the point that it repeats."""
        last: dict[int, int] = {}
        for place, point in enumerate(walk.tolist()):
            if point in last:
                self.near[walk[last[point] : place], point] = True
            last[point] = place
