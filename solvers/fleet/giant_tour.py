"""Routes of equal vehicles of one depot as one closed tour, for the sum of symmetric distances.

Each vehicle has a copy of the depot, and the routes are the paths between copies. Source: M. Bellmore and
S. Hong, "Transformation of multisalesmen problem to the standard traveling salesman problem", Journal of
the ACM 21, 1974.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...models.fleet import FleetRouting
from .chain_kernels import DEPTH, Tour, chain
from .fleet_kernels import Fleet

__all__ = ["GiantTour"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]

#: Nearest nodes of each node, and copies of the depot, that an exchange may join to it.
NEAREST, COPIES = 8, 3
#: Length of an edge between two copies if every vehicle is used; the longest distance is 1.
BARRED = 1e3
#: Longest record of reversals between two decisions.
RECORD = 100_000
#: First and last temperature, relative to the mean edge. Of 0.05 to 0.3 and 0.001 to 0.01 they give the
#: shortest tours of 575 random points in 2 s.
HOT, COLD = 0.1, 0.003
#: Smallest number of nodes and copies.
LEAST = 8


@dataclass
class GiantTour:
    """Tour through customers 0 … c - 1 and the copies c … c + m - 1 of the depot.

    `nodes`, shape (c,), are the nodes of the customers; `distances` and `near` are those of
    :class:`~.chain_kernels.Tour`.
    """

    nodes: Whole
    distances: Floats
    near: Whole

    @staticmethod
    def covers(model: FleetRouting) -> bool:
        """Return whether the sum of `model`, without other limits than a budget, is that of a tour."""
        size = len(model.customers) + model.vehicles
        return model.preferred_formulation == "two-index" and size >= LEAST

    @classmethod
    def of(
        cls, model: FleetRouting, fleet: Fleet, ended: Callable[[], bool] = lambda: False
    ) -> Self | None:
        """Return the tour of `model`, None if it does not cover the model or the time `ended`."""
        if not cls.covers(model):
            return None
        nodes, m = fleet.nodes, model.vehicles
        places = np.concatenate([nodes, model.homes])
        distances = fleet.distances[np.ix_(places, places)]
        c, copies = len(nodes), min(COPIES, m)
        distances[c:, c:] = BARRED if model.use_all else 0.0
        np.fill_diagonal(distances, 0.0)
        width = min(NEAREST + copies, c)
        near = np.full((c + m, width), -1)
        # A customer may join a few copies, which differ from one customer to the next.
        marks = c + (COPIES * np.arange(c)[:, None] + np.arange(copies)) % m
        for i in range(c + m):
            if i % 256 == 255 and ended():
                return None
            row = distances[i, :c].copy()
            if i < c:
                row[i] = np.inf
            count = min(NEAREST, c - 1) if i < c else width
            picked = np.argpartition(row, count - 1)[:count] if count else np.zeros(0, int)
            if i < c:
                picked = np.concatenate([picked, marks[i]])[:width]
            order = picked[np.lexsort([picked, distances[i, picked]])]
            near[i, : order.size] = order
        return cls(nodes, distances, near)

    def improve(
        self, routes: list[list[int]], kicks: int, flag: NDArray[np.int8], draw: np.random.Generator
    ) -> tuple[list[list[int]], int]:
        """Return better `routes`, which visit all nodes, and the number of kicks."""
        c, n = len(self.nodes), len(self.distances)
        order = np.concatenate(
            [[c + k, *np.searchsorted(self.nodes, stops)] for k, stops in enumerate(routes)]
        ).astype(np.int64)
        lists = np.zeros((5, n), np.int64)
        lists[0] = order
        record = np.zeros((4, RECORD + 2 * DEPTH), np.int64)
        tour = Tour(self.distances, self.near, lists, record, np.zeros(2, np.int64))
        done, _ = chain(tour, kicks, HOT, COLD, flag, draw)
        order = np.roll(lists[0], -int(np.flatnonzero(lists[0] == c)[0]))
        parts = np.split(order, np.flatnonzero(order >= c)[1:])
        return [self.nodes[part[1:]].tolist() for part in parts], int(done)
