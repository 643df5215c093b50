"""HE-B and HE-C: the heuristics that the paper uses for comparison."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ..contract.backend import Option, Request
from .rivals import Flight, Rival

__all__ = ["GreedyBoundary", "GreedyCentre"]


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
        from .greedy_kernels import build

        options, n = request.options, flight.problem.size
        order, genes = np.arange(n), np.zeros((n, 2))
        fleet = flight.fleet.copy()
        if "samples" not in options:
            flight.fleet[:, 4] = 0.0
        build(
            order, genes, flight.fleet, flight.craft, options["horizon"], options.get("samples", 1),
            flight.poses,
        )  # fmt: skip
        flight.offer(order, genes)
        flight.fleet[:] = fleet
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
