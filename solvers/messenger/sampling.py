"""DS: double sampling of times and boundaries, the paper's reference for two and three vehicles."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ...models.messenger.model import MessengerTour
from ..contract.backend import Option, Request
from .rivals import Flight, Rival

__all__ = ["DirectSampling"]


class DirectSampling(Rival):
    """Exhaustive search over orders, sampled times and boundary points, by branch and bound.

    All lengths that the paper prints for DS are even numbers of metres: at 10 m/s, its trajectories have
    one sample per 0.2 s. The paper does not print the number of boundary samples.
    """

    name = "direct-sampling"
    deterministic = True
    options: ClassVar[Mapping[str, Option]] = {
        "samples": Option(16, "Samples of each boundary.", int, lower=1),
        "step": Option(0.2, "Time between samples of the trajectories, s.", lower=1e-6),
    }
    summary = "all orders, sampled times and boundaries of up to three vehicles (DS)"

    def refuses(self, problem: MessengerTour) -> str:
        """Return the reason for a refusal, which includes more than three vehicles."""
        if problem.size > 3:
            return f"more than 3 vehicles, got {problem.size}: combinations are too many"
        return super().refuses(problem)

    def search(self, flight: Flight, request: Request) -> Mapping[str, Any]:
        """Search all orders."""
        from .sampling_kernels import search_samples

        options, ceiling = request.options, math.inf
        for permutation in itertools.permutations(range(flight.problem.size)):
            order, genes = np.array(permutation), np.zeros((len(permutation), 2))
            end = search_samples(
                order, genes, flight.fleet, flight.craft, options["samples"], options["step"], ceiling,
                flight.flag, flight.poses,
            )  # fmt: skip
            if end < ceiling:
                ceiling = end
                flight.offer(order, genes)
            if request.control.stopped:
                break
        return {}
