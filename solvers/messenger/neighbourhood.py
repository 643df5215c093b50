"""VNS: variable neighbourhood search over orders and angles."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ..contract.backend import Option, Request
from .decoding import Task, follow
from .greedy import GreedyBoundary, build
from .rivals import Flight, RandomRival

__all__ = ["VariableNeighbourhood", "exchange", "improve", "move", "shake"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel
def move(order: Ints, begin: int, count: int, place: int) -> None:
    """Move the `count` vehicles from index `begin` on so that the first is at index `place`."""
    if place > begin:
        exchange(order, begin, begin + count, begin + count, place + count)
    else:
        exchange(order, place, begin, begin, begin + count)


@kernel
def exchange(order: Ints, a: int, b: int, c: int, d: int) -> None:
    """Exchange the stretches from `a` to `b` and from `c` to `d` (excluded); a <= b <= c <= d."""
    old = order[a:d].copy()
    k = a
    for low, high in ((c, d), (b, c), (a, b)):
        for m in range(low, high):
            order[k] = old[m - a]
            k += 1


@kernel
def shake(order: Ints, kind: int, rng: np.random.Generator) -> None:
    """Move a random stretch of the order (`kind` 0), or exchange two stretches (`kind` 1)."""
    n = len(order)
    if kind == 0:
        begin = int(rng.random() * n)
        count = 1 + int(rng.random() * (n - begin))
        move(order, begin, count, int(rng.random() * (n - count + 1)))
    else:
        cuts = np.empty(4, np.int64)
        for m in range(4):
            cuts[m] = int(rng.random() * (n + 1))
        cuts.sort()
        exchange(order, cuts[0], cuts[1], cuts[2], cuts[3])


@kernel
def improve(order: Ints, genes: Floats, task: Task, trials: int, rng: np.random.Generator) -> float:
    """Try random moves of one vehicle, exchanges of two, and new angles; return the end of the tour (s).

    A change is accepted if the tour ends sooner. `trials` is the number of changes to try. Order,
    genes and the poses of the task are updated.
    """
    n, poses = len(order), task.poses
    end = follow(order, genes, task, 0, math.inf)
    trial, trial_genes, spot = order.copy(), genes.copy(), poses.copy()
    attempt = Task(task.fleet, spot, task.speed, task.r, task.margin, task.flag)
    for _ in range(trials):
        if task.flag[0] != 0:
            break
        kind, a, b = int(rng.random() * 3), int(rng.random() * n), int(rng.random() * n)
        if kind < 2 and a == b:
            continue
        first = a if kind == 2 else min(a, b)
        if kind == 0:
            move(trial, a, 1, b)
        elif kind == 1:
            trial[a], trial[b] = trial[b], trial[a]
        else:
            trial_genes[order[a], 0] = 2.0 * math.pi * rng.random()
        spot[first] = poses[first]
        there = follow(trial, trial_genes, attempt, first, end)
        if there < end:
            end, order[:], genes[:] = there, trial, trial_genes
            poses[first:] = spot[first:]
        else:
            trial[:], trial_genes[:] = order, genes
    return end


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
        options, n, task, rng = request.options, flight.problem.size, flight.task, flight.rng
        order, genes = flight.blank()
        build(order, genes, task, options["horizon"], options["samples"])
        best = flight.offer(order, genes)
        end = improve(order, genes, task, n * n, rng)
        best = min(best, flight.offer(order, genes))
        idle = 0
        while idle < options["iterations"] and not request.control.stopped:
            trial, trial_genes = order.copy(), genes.copy()
            shake(trial, idle % 2, rng)
            there = improve(trial, trial_genes, task, n * n, rng)
            idle += 1
            if there < end:
                order, genes, end, idle = trial, trial_genes, there, 0
                best = min(best, flight.offer(order, genes))
        return best
