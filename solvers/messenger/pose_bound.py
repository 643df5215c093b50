"""Lower bound for few vehicles, also with short legs: cells of poses at the first contact with each disc.

Every flight enters the discs in some order. The first contact is on the boundary with a heading into
the disc, or the start is in the disc, whose vehicle is then omitted. For each order, a layer of cells
covers angle, heading and time of each contact, and a layered graph bounds the time at every cell and
the rest of the flight from it, with :func:`.pose_kernels.least_flight` for its edges. Cells that
cannot improve the best tour are removed, and those near the bound are divided, until the
bound is within the gap or the number of edges reaches its limit. The last contact of an open tour
needs no heading, and a closed tour has a last layer for the home.

Source of the cells for vehicles at rest: Váňa and Faigl, Robotics: Science and Systems, 2018.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...jit import start_compiling
from ...models.messenger.model import MessengerTour
from .pose_kernels import HIGH, LOW, PHI, PHI_HALF, THETA, THETA_HALF, arrivals, tails

__all__ = ["covers", "prepare", "prove_poses"]

Floats = NDArray[np.float64]

#: Share of the distance between bound and best length within which cells are divided. On 24 fields of 1 to 4 turning
#: radii with two or three vehicles, 0.2 instead of 0.5 lowers the mean gap after 300,000 edges from 31 % to 23 %.
SHARE = 0.2
#: Relative rounding error of a bound.
ROUNDING = 1e-9


def covers(problem: MessengerTour) -> bool:
    """Return whether the bound applies: one UAV that begins at a given place and cannot turn on the spot."""
    return problem.start is not None and problem.turning_radius > 0 and problem.uavs is None


def prepare() -> None:
    """Start to compile the kernels in the background, if they are not compiled yet."""
    cells, node, times = np.empty((1, 6)), np.empty(5), np.empty(1)
    start_compiling(arrivals, cells, node, times, cells, node, 1.0, times)
    start_compiling(tails, cells, node, times, cells, node, times, 1.0, times)


def prove_poses(
    problem: MessengerTour, best: float, gap: float, edges: int, stopped: Callable[[], bool]
) -> float:
    """Return a lower bound (m) on the length of every tour that is shorter than `best` (m).

    Parameters
    ----------
    problem : MessengerTour
        Tour that :func:`covers` accepts, without wind. Zones are ignored.
    best : float
        Length of a tour. The bound is at most this length.
    gap : float
        Relative gap at which the search ends.
    edges : int
        Limit on the number of edges evaluated.
    stopped : callable
        Returns True to end the search.
    """
    assert problem.start is not None
    apart = np.hypot(*(problem.positions - problem.start[:2]).T)
    far = np.flatnonzero(apart > problem.radius)
    slack = ROUNDING * (best + float(apart.max()) + problem.turning_radius)
    # The bound remains within the gap if the rounding error is subtracted.
    limit = min(best * (1.0 - gap) + 2.0 * slack, best)
    heap = [
        (0.0, number, _Order(problem, order, best, limit))
        for number, order in enumerate(itertools.permutations(far.tolist()))
    ]
    while heap and heap[0][0] < limit and far.size and not stopped():
        bound, number, order = heap[0]
        edges -= order.size
        if edges < 0:
            break
        heapq.heapreplace(heap, (max(bound, order.refine()), number, order))
    bound = min(heap[0][0], limit) if far.size else 0.0
    return max(bound - slack, 0.0)


class _Order:
    """Layers of cells for one order of the vehicles that are not met at the start."""

    def __init__(
        self, problem: MessengerTour, order: tuple[int, ...], best: float, limit: float
    ) -> None:
        assert problem.start is not None
        self.r, self.best, self.limit = problem.turning_radius, best, limit
        speed, heading = problem.speed, problem.heading
        home = [0.0, 0.0, *(problem.home_drift / speed), 0.0]
        places = problem.positions - problem.start[:2]
        self.nodes = [np.array(home)] + [
            np.array([*places[k], *(problem.velocities[k] / speed), problem.radius[k]])
            for k in order
        ]
        fixed = [0.0, 0.0, heading or 0.0, math.pi if heading is None else 0.0]
        self.cells = [np.array([[*fixed, 0.0, 0.0]])]
        self.cells += [np.array([[0.0, math.pi, 0.0, math.pi, 0.0, best]]) for _ in order]
        if problem.closed:
            self.nodes.append(np.array(home))
            self.cells.append(np.array([[*fixed, 0.0, best]]))
        #: Number of layers whose headings are divided.
        self.headed = len(order) + problem.closed

    @property
    def size(self) -> int:
        """Number of edges that :meth:`refine` evaluates at most."""
        return 2 * sum(len(a) * len(b) for a, b in itertools.pairwise(self.cells))

    def refine(self) -> float:
        """Return the bound of the present cells (m), remove and divide cells."""
        cells, nodes, last = self.cells, self.nodes, len(self.cells) - 1
        times, rest = [np.zeros(1)], np.zeros(len(cells[last]))
        for k in range(last):
            met = np.empty(len(cells[k + 1]))
            arrivals(cells[k], nodes[k], times[k], cells[k + 1], nodes[k + 1], self.r, met)
            times.append(met)
        bound = float(times[last].min(initial=math.inf))
        near = bound + SHARE * (self.limit - bound)
        for k in range(last, 0, -1):
            through = times[k] + rest
            kept = through < self.limit
            cell, through, after = cells[k][kept], through[kept], rest[kept]
            cell[:, LOW] = np.maximum(cell[:, LOW], times[k][kept])
            cell[:, HIGH] = np.minimum(cell[:, HIGH], self.best - after)
            # The cells of this layer are divided after those before it have used them.
            before = np.empty(len(cells[k - 1]))
            tails(cells[k - 1], nodes[k - 1], times[k - 1], cell, nodes[k], after, self.r, before)
            cells[k], rest = self._divide(cell, nodes[k], through <= near, k), before
        return bound

    def _divide(self, cells: Floats, node: Floats, chosen: NDArray[np.bool_], layer: int) -> Floats:
        """Return the cells of a layer, with the `chosen` ones halved along their largest extent."""
        halved = cells[chosen]
        extents = np.zeros((len(halved), 3))
        if layer <= self.headed and node[4] > 0.0:
            extents[:, 0] = node[4] * halved[:, PHI_HALF]
        if layer < self.headed:
            extents[:, 1] = self.r * halved[:, THETA_HALF]
        extents[:, 2] = 0.5 * np.hypot(node[2], node[3]) * (halved[:, HIGH] - halved[:, LOW])
        widest, parts = extents.argmax(axis=1), []
        for side in (-1.0, 1.0):
            part = halved.copy()
            for axis, (middle, half) in enumerate(((PHI, PHI_HALF), (THETA, THETA_HALF))):
                rows = widest == axis
                part[rows, half] *= 0.5
                part[rows, middle] += side * part[rows, half]
            rows = (widest == 2) & (extents[:, 2] > 0.0)
            part[rows, LOW if side > 0.0 else HIGH] = halved[rows][:, [LOW, HIGH]].mean(axis=1)
            parts.append(part[(extents.max(axis=1) > 0.0) | (side < 0.0)])
        cells = np.vstack([cells[~chosen], *parts])
        if node[4] == 0.0:
            return cells
        # Flights into the disc, relative to its vehicle.
        off = np.abs(np.remainder(cells[:, THETA] - cells[:, PHI] + math.pi, 2 * math.pi) - math.pi)
        most = np.minimum(off + cells[:, THETA_HALF] + cells[:, PHI_HALF], math.pi)
        along = node[2] * np.cos(cells[:, PHI]) + node[3] * np.sin(cells[:, PHI])
        along += np.hypot(node[2], node[3]) * cells[:, PHI_HALF]
        inward: Floats = cells[np.cos(most) <= along + ROUNDING]
        return inward
