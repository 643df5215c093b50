"""DS: double sampling of times and boundaries, the paper's reference for two and three vehicles."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.messenger.model import MessengerTour
from ..contract.backend import Option, Request
from .decoding import Task, meet
from .rivals import Flight, Rival

__all__ = ["DirectSampling", "search_samples"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel
def _soonest(k: int, i: int, t: float, task: Task) -> float:
    """Return a lower bound (s) on the time at which a UAV at pose `k` meets vehicle `i`.

    The bound is the time of a straight flight from time `t` on, with the vehicle heading for the
    UAV.
    """
    vehicle, pose = task.fleet[i], task.poses[k]
    dx = vehicle[0] + vehicle[2] * t - pose[0]
    dy = vehicle[1] + vehicle[3] * t - pose[1]
    gap = math.hypot(dx, dy) - vehicle[4]
    soonest: float = t + max(gap, 0.0) / (task.speed + math.hypot(vehicle[2], vehicle[3]))
    return soonest


@kernel
def search_samples(
    order: Ints, genes: Floats, task: Task, samples: int, step: float, ceiling: float
) -> float:
    """Fill `genes` with the best samples for `order`; return the end of the tour (s).

    Depth-first search: each level is an encounter. Its nodes are the times in multiples of `step`
    (s) and the `samples` angles of the boundary that the UAV can reach exactly at these times. A
    node is pruned if a straight flight from it cannot end before the best tour so far. The result
    is inf if no tour ends before `ceiling` (s), and the best tour so far if the stop flag is set.
    """
    n = len(order)
    trial, best = genes.copy(), math.inf
    # Node number: tick * samples + angle.
    level, nodes = 0, np.zeros(n, np.int64)
    nodes[0] = int(_soonest(0, order[0], 0.0, task) / step) * samples
    while level >= 0 and task.flag[0] == 0:
        i, last = order[level], level + 1 == n
        tick = nodes[level] // samples
        theta = 2.0 * math.pi * (nodes[level] % samples) / samples
        nodes[level] += 1
        t = tick * step
        interval = t - task.poses[level, 3]
        if not t < ceiling or (
            not last and not _soonest(level, order[n - 1], task.poses[level, 3], task) < ceiling
        ):
            level -= 1
            continue
        trial[i, 0], trial[i, 1] = theta, interval
        if interval < 0.0 or meet(level, i, trial, task) != 0.0:
            continue
        if last:
            best = ceiling = t
            genes[:] = trial
            level -= 1
            continue
        soonest = _soonest(level + 1, order[level + 1], t, task)
        if soonest < ceiling:
            level += 1
            nodes[level] = int(soonest / step) * samples
    return best


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
        options, ceiling = request.options, math.inf
        for permutation in itertools.permutations(range(flight.problem.size)):
            order, genes = np.array(permutation), flight.blank()[1]
            end = search_samples(
                order, genes, flight.task, options["samples"], options["step"], ceiling
            )
            if end < ceiling:
                ceiling = end
                flight.offer(order, genes)
            if request.control.stopped:
                break
        return {}
