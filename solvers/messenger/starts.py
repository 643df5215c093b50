"""Initial tours of ``tour-search``: nearest vehicle next, annealed orders, and orders of the bound."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...jit import clock
from ...models.messenger.checks import integrated
from ...models.messenger.model import MessengerTour
from ...models.messenger.motion import met_after
from ...models.messenger.plan import TourPlan
from ..contract.backend import Request
from .chain import fly
from .emission import Chain
from .ordering import anneal_order

__all__ = ["LEAST", "Starts"]

#: Least number of steps of an annealing.
LEAST = 300
#: Steps per vehicle of the annealing of an order, without a limit and at most, and its temperatures.
ORDER_STEPS, ORDER_MOST, ORDER_HOT, ORDER_COLD = 500, 4000, 0.1, 1e-3
#: Share of the time left of one annealing of an order.
ORDER_SHARE = 0.25
#: Changes of a heading (rad). The first one that requires no circle is used: at the heading of the
#: shortest path itself, rounding decides.
AWAY = (1e-4, -1e-4, 0.03, -0.03, 0.1, -0.1, 0.3, -0.3, 1.0, -1.0)


@dataclass
class Starts:
    """Problem and request of a run, and chains that its annealings can begin with."""

    problem: MessengerTour
    request: Request

    def __post_init__(self) -> None:
        self.draw = np.random.default_rng(self.request.seed or 0)

    def chain(self) -> Chain:
        """Return a chain without stops."""
        return Chain(self.problem, interior=self.request.options["interior"])

    def chain_of(self, plan: TourPlan) -> Chain:
        """Return the chain of the encounters of a plan with a given start, moved into the discs."""
        problem, chain = self.problem, self.chain()
        legs = [primitive.leg for primitive in plan.primitives]
        ends = np.searchsorted(legs, np.arange(problem.size), "right")
        headings = integrated(plan, problem.turning_radius)[ends, 2].tolist()
        for k, vehicle in enumerate(plan.order):
            offset = plan.points[k] - problem.where(vehicle, float(plan.times[k]))
            chain.append(vehicle, offset, headings[k])
        return chain

    def nearest(self) -> Chain:
        """Return the chain that meets next the vehicle with the shortest straight flight."""
        problem, chain = self.problem, self.chain()
        left = np.arange(problem.size, dtype=np.int64)
        if problem.start is None:  # a chain begins at vehicle 0
            place, left = problem.positions[0], left[1:]
        else:
            place = problem.start[:2]
        time = 0.0
        while left.size:
            wait = met_after(problem, place, time, left)
            k = int(np.argmin(wait))
            vehicle, time = int(left[k]), time + float(wait[k])
            target = problem.where(vehicle, time)
            heading = float(np.arctan2(*(target - place)[::-1]))
            inside = -problem.radius[vehicle] * np.array([np.cos(heading), np.sin(heading)])
            chain.append(vehicle, inside, heading)
            place, left = target, np.delete(left, k)
        return chain

    def affordable(self, share: float, pace: float, least: int, steps: int, most: int) -> int:
        """Return the steps of `pace` s for a share of the time left, at most `most` per vehicle."""
        left = self.request.left()
        if left is None or pace <= 0.0 or self.request.options["steps"]:
            return steps
        return int(min(max(share * left / pace, least), most * self.problem.size))

    def lay(self, chain: Chain) -> Chain:
        """Anneal the order of `chain`, which stops at every vehicle, and return the chain of its path."""
        order = chain.stops.order[: chain.count].copy()
        scene, flag = chain.scene, self.request.control.flag
        path, n = np.zeros((len(order), 4)), self.problem.size
        path[0, :3] = *chain.scene.nodes[order[0], :2], chain.stops.poses[order[0], 2]
        path[0, :2] += chain.stops.poses[order[0], :2]
        steps = first = ORDER_STEPS * n
        if self.request.time_limit is not None:
            first, begin = LEAST, clock()
            anneal_order(order, scene, path, first, ORDER_HOT, ORDER_COLD, self.draw, flag)
            pace = (clock() - begin) / first
            steps = self.affordable(ORDER_SHARE, pace, first, steps, ORDER_MOST)
        anneal_order(order, scene, path, steps, ORDER_HOT, ORDER_COLD, self.draw, flag)
        stops, chain.count = chain.stops, 1
        for k in range(1, len(order)):
            flown, vehicle = path[k, 3] - path[k - 1, 3], int(order[k])
            if flown == 0.0:  # met on the way
                continue
            at = chain.count
            chain.append(vehicle, path[k, :2] - self.problem.where(vehicle, path[k, 3]), 0.0)
            best, limit = (math.inf, 0.0), stops.times[at - 1] + 1.01 * flown
            for away in AWAY:
                stops.poses[vehicle, 2] = path[k, 2] + away
                fly(stops, chain.count, at, scene, math.inf)
                best = min(best, (float(stops.times[at]), away))
                if best[0] <= limit:
                    break
            stops.poses[vehicle, 2] = path[k, 2] + best[1]
            fly(stops, chain.count, at, scene, math.inf)
        return chain

    def guided(self, order: tuple[int, ...]) -> Chain:
        """Return the chain of an order with the poses that its bound suggests."""
        from .bound_search import guide

        chain = self.chain()
        if self.problem.start is None:
            # Any vehicle may be the first; a chain begins at vehicle 0.
            at = order.index(0)
            order, chain.count = order[at:] + order[:at], 0
        near = guide(self.problem, order)
        for vehicle, offset, heading in zip(order, near.offsets, near.headings, strict=True):
            chain.append(vehicle, offset, heading)
        return chain
