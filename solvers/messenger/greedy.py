"""HE-B and HE-C: the heuristics that the paper uses for comparison, with receding-horizon orders."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ..contract.backend import Option, Request
from .decoding import Task, meet, shortest_time
from .rivals import Flight, Rival

__all__ = ["GreedyBoundary", "GreedyCentre", "build", "next_vehicle"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel
def next_vehicle(order: Ints, k: int, x: float, y: float, fleet: Floats, horizon: int) -> int:
    """Return the index in `order`, at least `k`, of the first vehicle of the best horizon.

    The best horizon is the shortest polyline from (x, y) over the centres at time 0 of `horizon` (1
    or 2) of the vehicles from index `k` on.
    """
    n = len(order)
    shortest, best = math.inf, k
    for a in range(k, n):
        ax, ay = fleet[order[a], 0], fleet[order[a], 1]
        rest = 0.0 if horizon == 1 or n - k == 1 else math.inf
        for b in range(k, n):
            if b != a:
                rest = min(rest, math.hypot(fleet[order[b], 0] - ax, fleet[order[b], 1] - ay))
        if math.hypot(ax - x, ay - y) + rest < shortest:
            shortest, best = math.hypot(ax - x, ay - y) + rest, a
    return best


@kernel
def build(order: Ints, genes: Floats, task: Task, horizon: int, samples: int) -> None:
    """Fill in an order and its genes; `order` contains every vehicle, in any order.

    The UAV flies to the sample of each boundary with the shortest time, of `samples`.
    """
    x, y = task.poses[0, 0], task.poses[0, 1]
    for k in range(len(order)):
        at = next_vehicle(order, k, x, y, task.fleet, horizon)
        order[k], order[at] = order[at], order[k]
        i = order[k]
        x, y = task.fleet[i, 0], task.fleet[i, 1]
        genes[i, 1] = math.inf
        for m in range(samples if task.fleet[i, 4] > 0.0 else 1):
            theta = 2.0 * math.pi * m / samples
            interval = shortest_time(k, i, theta, task)
            if interval < genes[i, 1]:
                genes[i, 0], genes[i, 1] = theta, interval
        meet(k, i, genes, task)


class GreedyCentre(Rival):
    """HE-C: receding-horizon order, flown from centre to centre.

    The next vehicle of the order is the first of the `horizon` vehicles with the shortest polyline over
    their centres, by Euclidean distance at time 0. The UAV flies to each centre in the shortest time.
    The paper prints neither the horizon nor the time of the distances. Distances at the time of the
    flight give tours 2 to 400 times shorter than the paper's for 10 to 40 vehicles.
    """

    name = "greedy-centre"
    deterministic = True
    options: ClassVar[Mapping[str, Option]] = {
        "horizon": Option(2, "Vehicles of the receding horizon.", int, choices=(1, 2)),
    }
    summary = "receding horizon, flying to the centres (HE-C)"

    def search(self, flight: Flight, request: Request) -> Mapping[str, Any]:
        """Build the order and fly it."""
        options = request.options
        if "samples" not in options:
            flight.task.fleet[:, 4] = 0.0
        order, genes = flight.blank()
        build(order, genes, flight.task, options["horizon"], options.get("samples", 1))
        flight.offer(order, genes)
        return {}


class GreedyBoundary(GreedyCentre):
    """HE-B: receding-horizon order, with access points sampled on the boundaries.

    It selects the sample of a boundary that the UAV reaches in the shortest time.
    """

    name = "greedy-boundary"
    options: ClassVar[Mapping[str, Option]] = {
        **GreedyCentre.options,
        "samples": Option(100, "Samples of each boundary (paper: N_HE-B).", int, lower=1),
    }
    summary = "receding horizon and samples of the boundary (HE-B)"
