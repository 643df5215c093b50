"""DS, direct sampling: the paper's yardstick for two and three vehicles."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ...models.messenger.model import MessengerTour
from ..backend import Feature, Option, Request
from .rivals import Flight, Rival

__all__ = ["DirectSampling"]


class DirectSampling(Rival):
    """All orders, with all combinations of boundary samples, each met at its first interception.

    It is not exact: samples are a grid, and an encounter that waits may leave the UAV with a heading
    from which the next vehicle is met sooner.
    """

    name = "direct-sampling"
    features = frozenset({Feature.INCUMBENTS, Feature.INTERRUPT})
    deterministic = True
    options: ClassVar[Mapping[str, Option]] = {
        "samples": Option(72, "Samples of each boundary.", int, lower=1),
        "interior": Option(
            False, "Whether a vehicle is met at once where the UAV is inside its disc.", bool
        ),
    }  # fmt: skip
    summary = "all orders and boundary samples of up to three vehicles (DS)"

    def refuses(self, problem: MessengerTour) -> str:
        """Return what is refused: more than three vehicles too."""
        if problem.size > 3:
            return f"more than 3 vehicles, got {problem.size}: combinations are too many"
        return super().refuses(problem)

    def search(self, flight: Flight, request: Request) -> Mapping[str, Any]:
        """Go through all orders."""
        from .decoding import decode
        from .sampling_kernels import enumerate_samples

        own, n = request.options, flight.problem.size
        samples, interior, flag = own["samples"], own["interior"], flight.flag
        fleet, craft, poses, legs = flight.fleet, flight.craft, flight.poses, flight.legs
        ceiling = math.inf
        for permutation in itertools.permutations(range(n)):
            order, genes = np.array(permutation), np.ones((n, 3))
            end = enumerate_samples(
                order, genes, fleet, craft, samples, interior, ceiling, flag, poses, legs
            )
            if end < ceiling:
                ceiling = end
                end = decode(order, genes, fleet, craft, 0, False, interior, math.inf, poses, legs)
                flight.offer(order, end)
            if request.control.stopped:
                break
        return {}
