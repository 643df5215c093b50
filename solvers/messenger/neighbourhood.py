"""VNS: variable neighbourhood search over orders and encounter directions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..backend import Option, Request
from .rivals import Flight, Rival

__all__ = ["VariableNeighbourhood"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class VariableNeighbourhood(Rival):
    """Shake the order, improve it by random small changes, and go on from the better one.

    After N. Mladenović and P. Hansen, Computers & Operations Research 24 (1997) 1097-1100, in the
    randomised form that R. Pěnička, J. Faigl, P. Váňa and M. Saska, IEEE Robotics and Automation
    Letters 2 (2017) 1210-1217, give it for Dubins orienteering: a stretch of the order is moved or
    two are exchanged; then N² times a vehicle is moved, two are exchanged, or a vehicle's encounter
    direction is drawn anew. Every vehicle is met at its first interception. Ours: directions are not
    of a fixed set, and it starts from the order of HE-C.
    """

    name = "variable-neighbourhood"
    options: ClassVar[Mapping[str, Option]] = {
        "iterations": Option(50, "Shakes without a gain after which it ends.", int, lower=0),
        "interior": Option(
            False, "Whether a vehicle may be met inside its disc, not on the boundary only.", bool
        ),
        "restarts": Option(
            False, "Whether it starts again from random directions until the time limit.", bool
        ),
    }  # fmt: skip
    summary = "variable neighbourhood search over orders and directions (VNS)"

    def search(self, flight: Flight, request: Request) -> Mapping[str, Any]:
        """Search, until nothing is gained any more or the time is used up."""
        runs = shakes = 0
        while runs == 0 or (
            request.options["restarts"]
            and request.time_limit is not None
            and not request.control.stopped
        ):
            shakes += self._descend(flight, request)
            runs += 1
        return {"runs": runs, "shakes": shakes}

    def _descend(self, flight: Flight, request: Request) -> int:
        """Run the search once; return the number of shakes."""
        from .greedy_kernels import NEAREST, greedy
        from .neighbourhood_kernels import improve, shake

        own, n, rng = request.options, flight.problem.size, flight.rng
        fleet, craft, poses, legs = flight.fleet, flight.craft, flight.poses, flight.legs
        interior, flag = own["interior"], flight.flag
        order, genes = np.empty(n, np.int64), np.zeros((n, 3))
        greedy(NEAREST, order, genes, fleet, craft, 1, 0, True, flag, poses, legs)
        genes[:, 0] = rng.uniform(0.0, 2.0 * math.pi, n)
        genes[:, 2] = np.sqrt(rng.uniform(size=n)) if interior else 1.0

        def improved(order: Ints, genes: Floats) -> float:
            return improve(order, genes, fleet, craft, n * n, interior, rng, flag, poses, legs)

        end = improved(order, genes)
        flight.offer(order, end)
        shakes = idle = 0
        while idle < own["iterations"] and not request.control.stopped:
            trial, kept = order.copy(), genes.copy()
            shake(trial, idle % 2, rng)
            there = improved(trial, kept)
            shakes, idle = shakes + 1, idle + 1
            if there < end:
                order, genes, end, idle = trial, kept, there, 0
                flight.offer(order, end)
        return shakes
