"""HE-B and HE-C, the paper's greedy rivals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ..backend import Feature, Option, Request
from .rivals import Flight, Rival

__all__ = ["GreedyBoundary", "GreedyCentre"]

_COMMON = {
    "horizon": Option(2, "Vehicles that it looks ahead to choose the next.", int, choices=(1, 2)),
    "two_opt": Option(
        False, "Whether the order is then improved by turning stretches of it around.", bool
    ),
}  # fmt: skip


class GreedyCentre(Rival):
    """HE-C: an order of receding horizon, flown from centre to centre.

    Each leg is the first interception of the vehicle itself, and ends where it enters the disc. A
    vehicle in whose disc the UAV is already is met at once.
    """

    name = "greedy-centre"
    features = frozenset({Feature.INCUMBENTS, Feature.INTERRUPT})
    deterministic = True
    options: ClassVar[Mapping[str, Option]] = _COMMON
    summary = "receding horizon, flying towards centres (HE-C)"

    def search(self, flight: Flight, request: Request) -> Mapping[str, Any]:
        """Build an order, and improve it where that is asked for."""
        from .greedy_kernels import NEAREST, TURN_AROUND_CENTRAL

        order, genes = np.empty(flight.problem.size, np.int64), np.zeros((flight.problem.size, 3))
        for task in (NEAREST, TURN_AROUND_CENTRAL) if request.options["two_opt"] else (NEAREST,):
            self.carry_out(task, order, genes, flight, request)
        return {}

    @staticmethod
    def carry_out(task: int, order: Any, genes: Any, flight: Flight, request: Request) -> bool:
        """Carry out a task of the kernel's, and return whether the path got better."""
        from .greedy_kernels import greedy

        own = request.options
        end = greedy(
            task, order, genes, flight.fleet, flight.craft, own["horizon"],
            own.get("samples", 0), own.get("interior", True), flight.flag, flight.poses, flight.legs,
        )  # fmt: skip
        return flight.offer(order, end)


class GreedyBoundary(GreedyCentre):
    """HE-B: an order of receding horizon, with encounters at samples of the boundary.

    Of a vehicle's samples it takes the one from which the centre of the next in the horizon is reached
    first.
    """

    name = "greedy-boundary"
    options: ClassVar[Mapping[str, Option]] = {
        **_COMMON,
        "samples": Option(100, "Samples of each boundary.", int, lower=1),
        "interior": Option(
            False, "Whether a vehicle is met at once where the UAV is inside its disc.", bool
        ),
    }
    summary = "receding horizon and samples of the boundary (HE-B)"

    def search(self, flight: Flight, request: Request) -> Mapping[str, Any]:
        """Build an order, sample, and improve the order where that is asked for."""
        from .greedy_kernels import NEAREST, SAMPLE, TURN_AROUND

        order, genes = np.empty(flight.problem.size, np.int64), np.zeros((flight.problem.size, 3))
        self.carry_out(NEAREST, order, genes, flight, request)
        rounds, gained = 0, request.options["two_opt"]
        while gained and not request.control.stopped:
            turned = self.carry_out(TURN_AROUND, order, genes, flight, request)
            sampled = self.carry_out(SAMPLE, order, genes, flight, request)
            gained = turned or sampled
            rounds += 1
        return {"rounds": rounds}
