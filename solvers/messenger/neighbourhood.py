"""VNS: variable neighbourhood search over orders and angles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from ..contract.backend import Option, Request
from .greedy import GreedyBoundary
from .rivals import Flight, RandomRival

__all__ = ["VariableNeighbourhood"]


class VariableNeighbourhood(RandomRival):
    """VNS that starts from the tour of HE-B, with the shortest encounter paths.

    After R. Pěnička, J. Faigl, M. Saska and P. Váňa, "Data collection planning with non-zero sensing
    distance for a budget and curvature constrained unmanned aerial vehicle", Autonomous Robots 43 (2019)
    1937-1956. Shaking moves a stretch of the order or exchanges two stretches. The local search
    then tries N² changes: it moves one vehicle, exchanges two, or draws an angle. The paper does
    not print a termination criterion.
    """

    name = "variable-neighbourhood"
    options: ClassVar[Mapping[str, Option]] = {
        **RandomRival.options,
        "iterations": Option(10, "Shakes without a gain after which it ends.", int, lower=0),
        **GreedyBoundary.options,
    }
    summary = "variable neighbourhood search from HE-B (VNS)"

    def search_once(self, flight: Flight, request: Request) -> float:
        """Search until no shake improves the tour; return the length of the best plan (m)."""
        from .greedy_kernels import build
        from .neighbourhood_kernels import improve, shake

        options, n, rng = request.options, flight.problem.size, flight.rng
        fleet, craft, poses, flag = flight.fleet, flight.craft, flight.poses, flight.flag
        order, genes = np.arange(n), np.zeros((n, 2))
        build(order, genes, fleet, craft, options["horizon"], options["samples"], poses)
        best = flight.offer(order, genes)
        end = improve(order, genes, fleet, craft, n * n, rng, flag, poses)
        best = min(best, flight.offer(order, genes))
        idle = 0
        while idle < options["iterations"] and not request.control.stopped:
            trial, trial_genes = order.copy(), genes.copy()
            shake(trial, idle % 2, rng)
            there = improve(trial, trial_genes, fleet, craft, n * n, rng, flag, poses)
            idle += 1
            if there < end:
                order, genes, end, idle = trial, trial_genes, there, 0
                best = min(best, flight.offer(order, genes))
        return best
