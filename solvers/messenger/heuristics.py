"""Heuristics that the paper compares with: HE-B and HE-C, VNS, and DS."""

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
from .decoding import Task, copy_pairs, follow, meet, shortest_time
from .rivals import Flight, RandomRival, Rival

__all__ = ["DirectSampling", "GreedyBoundary", "GreedyCentre", "VariableNeighbourhood"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel
def next_vehicle(order: Ints, k: int, x: float, y: float, fleet: Floats, horizon: int) -> int:
    """Return the index in `order`, from `k` on, of the first vehicle of the shortest polyline from (x, y).

    The polyline leads over the centres at time 0 of `horizon` (1 or 2) vehicles.
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
def build_greedily(order: Ints, genes: Floats, task: Task, horizon: int, samples: int) -> None:
    """Fill in an order, and genes by the fastest of `samples` points of each boundary."""
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
        "horizon": Option(2, "Vehicles of the receding horizon.", int, choices=(1, 2))
    }
    summary = "receding horizon, flying to the centres (HE-C)"

    def search(self, flight: Flight, request: Request) -> Mapping[str, Any]:
        """Build the order and fly it."""
        options = request.options
        if "samples" not in options:
            flight.task.fleet[:, 4] = 0.0
        order, genes = flight.blank()
        build_greedily(order, genes, flight.task, options["horizon"], options.get("samples", 1))
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
    """Try `trials` moves, exchanges and new angles, and keep those that end sooner; return the end (s)."""
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
        for j in range(4):
            spot[first, j] = poses[first, j]
        there = follow(trial, trial_genes, attempt, first, end)
        is_better = there < end
        if is_better:
            end = there
            copy_pairs(trial_genes, genes)
            for k in range(first, n + 1):
                for j in range(4):
                    poses[k, j] = spot[k, j]
        else:
            copy_pairs(genes, trial_genes)
        for k in range(n):
            if is_better:
                order[k] = trial[k]
            else:
                trial[k] = order[k]
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
        build_greedily(order, genes, task, options["horizon"], options["samples"])
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


@kernel
def _soonest(k: int, i: int, t: float, task: Task) -> float:
    """Return a lower bound (s) on the time of vehicle `i`: both head for each other from time `t` on."""
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
    """Fill `genes` with the best samples for `order`; return the end of the tour (s), inf if not before `ceiling`.

    Each level of the depth-first search is an encounter, at a time in multiples of `step` (s) and one of the `samples`
    angles that the UAV can reach exactly then. A node is pruned if a straight flight cannot end sooner than the best
    tour. If the stop flag is set, the result is the best tour so far.
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
            copy_pairs(trial, genes)
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
