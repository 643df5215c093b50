"""``tour-search``: annealing from many starts, polished as a nonlinear program, with a proven bound."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from ...jit import clock
from ...models.messenger.checks import UNDECIDABLE, decidable_length, integrated
from ...models.messenger.model import MessengerTour
from ...models.messenger.motion import met_after
from ...models.messenger.plan import TourPlan
from ..contract.backend import (
    Answer,
    Feature,
    Guarantee,
    Limit,
    Option,
    Request,
    Termination,
)
from .annealing import anneal
from .chain import fly
from .emission import Chain, move_to_boundary
from .extensions import TourBackend
from .last_leg import fly_to_rims, shorten_last_leg
from .ordering import anneal_order

__all__ = ["TourSearch", "nearest_tour"]

#: Temperatures relative to the length of the tour: at a start, at a reheating, and at the end of both.
HOT, WARM, COLD = 0.3, 0.02, 1e-3
#: Steps of one annealing per vehicle, and the least number.
STEPS, LEAST = 20, 300
#: Least number of vehicles for annealing orders instead of starting from scratch.
MANY = 50
#: Steps per vehicle of the annealing of an order, without a limit and at most, and its temperatures.
ORDER_STEPS, ORDER_MOST, ORDER_HOT, ORDER_COLD = 500, 4000, 0.1, 1e-3
#: Shares of the time left, and most steps per vehicle, of one annealing of an order and of a tour.
ORDER_SHARE, TOUR_SHARE, TOUR_MOST = 0.25, 0.3, 150
#: Changes of a heading (rad). The first one that requires no circle is used: at the heading of the
#: shortest path itself, rounding decides.
AWAY = (1e-4, -1e-4, 0.03, -0.03, 0.1, -0.1, 0.3, -0.3, 1.0, -1.0)
#: Number of tours in the pool, which are annealed again.
POOL = 4
#: Share of the time for the bound, and again for orders; without a limit, number of programs solved.
BOUND_SHARE, BOUND_PROGRAMS = 0.2, 3000
#: Share of the time for the bound of many vehicles, whose orders are not used.
MANY_SHARE = 0.05
#: Programs solved for tours without curvature if the search for the bound completed no order.
SKETCH_PROGRAMS = 300
#: Least relative gain of a shorter tour that resets the patience.
BETTER = 1e-6
#: Ratio to the best length up to which a tour is polished.
NEAR = 1.03


class TourSearch(TourBackend):
    """Ruin and recreate under annealing, from many starts, then the best tours again; ours.

    The best tours are polished by the nonlinear program of their order and turns, which never makes them longer.
    The bound is that of :class:`.bound.CurvatureBound`, so that the tour comes with a gap.
    """

    name = "tour-search"
    guarantee = Guarantee.RELAXATION
    features = frozenset(
        {
            Feature.SEED, Feature.INCUMBENTS, Feature.INTERRUPT, Feature.WARM_START,
            Feature.DUAL_BOUND, Feature.GAP,
        }
    )  # fmt: skip
    single_threaded = True
    options: ClassVar[Mapping[str, Option]] = {
        "interior": Option(
            True, "Whether vehicles may be met inside their discs, or on the boundaries only.", bool
        ),
        "polish": Option(True, "Whether to polish tours by a nonlinear program.", bool),
        "bound": Option(True, "Whether to prove a bound as well.", bool),
        "patience": Option(
            16, "Annealings without a shorter tour after which the search ends.", int, lower=1
        ),
        "steps": Option(
            0, "Steps of one annealing; 0 means 20 per vehicle, but at least 300.", int, lower=0
        ),
    }
    summary = "annealing, polish, and a proven bound; ours"

    def fly(self, problem: MessengerTour, request: Request) -> Answer:
        """Search until a limit is reached, the gap is closed, or the patience is exhausted."""
        return _Search(self, problem, request).answer()


@dataclass
class _Search:
    """One run."""

    backend: TourSearch
    problem: MessengerTour
    request: Request
    pool: list[tuple[float, int, Chain]] = field(default_factory=list)
    best: TourPlan | None = None
    bound: float | None = None
    runs: int = 0
    idle: int = 0
    polishes: int = 0
    undecidable: float = math.inf
    pace: float = 0.0

    def __post_init__(self) -> None:
        self.draw = np.random.default_rng(self.request.seed or 0)

    def answer(self) -> Answer:
        """Search, and return the best tour with its bound."""
        begin = clock()
        request, options = self.request, self.request.options
        if request.warm_start is not None:
            self.offer(request.warm_start)
        if request.time_limit is not None:
            self.fly_nearest()
        if self.problem.start is not None:  # quick for any number of vehicles
            self.anneal(1, self.fly_rims(self.nearest()))
        if self.many:
            self.anneal(LEAST, self.lay(self.nearest()))
        if self.best is None or not self.many:
            self.anneal(LEAST)
        proven = clock()
        orders = self.prove() if options["bound"] else []
        proven = clock() - proven
        steps = options["steps"] or max(STEPS * self.problem.size, LEAST)
        for order in orders:
            if not self.ended:
                self.anneal(steps, self.guided(order))
        while not self.ended:
            again = bool(self.pool) and self.many
            again = again or (len(self.pool) == POOL and self.runs % 2 == 1)
            k = 0 if self.many or not again else int(self.draw.integers(len(self.pool)))
            if self.many:
                steps = self.affordable(TOUR_SHARE, self.pace, LEAST, steps, TOUR_MOST)
            self.anneal(steps, self.pool[k][2].copy() if again else None)
        limit = self.request.control.reason if self.request.control.stopped else None
        if limit is None and request.left() == 0.0:
            limit = Limit.TIME
        statistics = {"annealings": self.runs, "polishes": self.polishes}
        seconds = {"solve": clock() - begin, "bound": proven}
        best, done = self.best, self.within_gap
        result = Termination.OPTIMAL if done else Termination.FEASIBLE
        return Answer(
            Termination.NO_SOLUTION if best is None else result, None if done else limit, best,
            None if best is None else best.length, self.bound, seconds=seconds,
            statistics=statistics, message=self.reason(limit) if best is None else "",
        )  # fmt: skip

    def reason(self, limit: Limit | None) -> str:
        """Return why no tour was found."""
        if self.undecidable < math.inf:
            problem, most = self.problem, decidable_length(self.problem)
            paces = np.hypot(*problem.velocities.T)
            row = int(paces.argmax())
            advice = (
                "use a larger radius, or nearer positions"
                if problem.at_rest
                else f"legs grow with velocities[{row}] of {paces[row]:.4g} m/s at a speed of "
                f"{problem.speed:g} m/s: use slower or fewer vehicles, or a larger radius"
            )
            return (
                "no tour was found that double precision can check: the shortest one is "
                f"{self.undecidable:.3g} m long, and beyond {most:.3g} m rounding exceeds a tenth of the "
                f"radius, {float(problem.radius.max()):g} m, or of the room of a vehicle without one; "
                f"{advice}"
            )
        if limit is not None:
            return "no tour was found in time"
        return "no tour was found whose coordinates floating-point numbers can hold"

    @property
    def many(self) -> bool:
        """Whether annealing from scratch takes too long for the number of vehicles."""
        return self.problem.size >= MANY

    @property
    def ended(self) -> bool:
        """Whether the search has ended."""
        if self.request.control.stopped or self.request.left() == 0.0 or self.within_gap:
            return True
        return self.idle >= int(self.request.options["patience"])

    @property
    def within_gap(self) -> bool:
        """Whether the best tour is proven within the requested gap."""
        if self.best is None or self.bound is None:
            return False
        return self.best.length - self.bound <= self.request.gap * self.best.length

    def prove(self) -> list[tuple[int, ...]]:
        """Prove a lower bound, and return the orders with the least bounds."""
        from .bound import straight
        from .bound_search import OrderSearch, best_orders

        control, left = self.request.control, self.request.left()
        begin = clock()
        share = MANY_SHARE if self.many else BOUND_SHARE
        end = math.inf if left is None else begin + share * left
        search = OrderSearch(self.problem, curved=True)

        def rising(bound: float) -> None:
            control.bound = bound

        def stopped() -> bool:
            # Without a limit, count programs, so that the same seed gives the same plan.
            many = left is None and search.chains.solved >= BOUND_PROGRAMS
            return control.stopped or many or clock() > end

        search.run(stopped, rising, self.request.gap)
        self.bound = search.bound
        if search.best is not None and self.request.options["interior"]:  # where turns are free
            self.offer(straight(self.problem, search.best.order, search.best.points))
        if self.many:
            return []
        orders = [order for _, order in sorted(search.orders)]
        if not orders:
            # Without curvature the search dives for tours.
            def enough(sketch: OrderSearch) -> bool:
                many = len(sketch.tours) >= POOL or sketch.chains.solved >= SKETCH_PROGRAMS
                return control.stopped or many or clock() > 2.0 * end - begin

            sketches = best_orders(self.problem, enough, gap=self.request.gap)
            orders = [order for order, _ in sketches]
        return orders[:POOL]

    def fly_nearest(self) -> None:
        """Offer the tour of :meth:`nearest`, which takes milliseconds without compiled loops."""
        chain = self.nearest()
        if fly(chain.stops, chain.count, 1, chain.scene, math.inf) < math.inf:
            self.offer(chain.plan())

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
        """Return the steps that take a share of the time left, or `steps` without a limit.

        A step takes `pace` seconds, and `most` is the limit per vehicle.
        """
        left = self.request.left()
        if left is None or pace <= 0.0 or self.request.options["steps"]:
            return steps
        return int(min(max(share * left / pace, least), most * self.problem.size))

    def lay(self, chain: Chain) -> Chain:
        """Anneal the order of `chain`, which stops at every vehicle, and return the chain of its path."""
        order, scene, flag = (
            chain.stops.order[: chain.count].copy(),
            chain.scene,
            self.request.control.flag,
        )
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

    def fly_rims(self, chain: Chain) -> Chain:
        """Offer the flight from rim to rim in the order of `chain`, and return it as a chain."""
        problem = self.problem
        if problem.heading is None or problem.turning_radius == 0.0:
            return chain
        order = chain.stops.order[1 : chain.count].tolist()
        plan = fly_to_rims(problem, order, self.request.control.flag)
        if plan is None:
            return chain
        if self.request.options["interior"]:
            self.offer(plan)
        legs = [primitive.leg for primitive in plan.primitives]
        ends = np.searchsorted(legs, np.arange(problem.size), "right")
        headings = integrated(plan, problem.turning_radius)[ends, 2].tolist()
        chain.count = 1
        for k, vehicle in enumerate(plan.order):
            offset = plan.points[k] - problem.where(vehicle, float(plan.times[k]))
            chain.append(vehicle, offset, headings[k])
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

    def chain(self) -> Chain:
        """Return a chain without stops."""
        return Chain(self.problem, interior=self.request.options["interior"])

    def anneal(self, steps: int, chain: Chain | None = None) -> None:
        """Anneal `chain`, or a tour from scratch, and keep good results."""
        hot, chain = (HOT, self.chain()) if chain is None else (WARM, chain)
        flag, begin = self.request.control.flag, clock()
        chain.count, value = anneal(
            chain.stops, chain.count, chain.scene, steps, hot, COLD, self.draw, flag
        )
        self.pace = (clock() - begin) / steps
        self.runs += 1
        self.idle += 1
        if not value < math.inf:
            return
        length = value * self.problem.speed
        if all(abs(length - entry[0]) > 1e-9 * length for entry in self.pool):
            self.pool = sorted([*self.pool, (length, self.runs, chain)])[:POOL]
        if self.best is None or length < NEAR * self.best.length:
            plan = chain.plan()
            if self.best is None:
                self.offer(plan)  # the polish may take longer than the time allows
            self.offer(self.polish(plan))

    def polish(self, plan: TourPlan) -> TourPlan:
        """Return a plan no longer than `plan`, by the nonlinear program of its order and turns."""
        if not self.request.options["polish"] or self.request.control.stopped:
            return plan
        from .polish import polish

        self.polishes += 1
        result = polish(self.problem, plan, self.request)
        if self.request.options["interior"]:
            return result
        return move_to_boundary(self.problem, result) or plan

    def offer(self, plan: TourPlan) -> None:
        """Keep `plan` if it is feasible and the best."""
        if self.request.options["interior"]:
            plan = shorten_last_leg(self.problem, plan, self.request.control.flag) or plan
        if self.best is not None and plan.length >= self.best.length:
            return
        verification = self.problem.verify(plan, tolerance=self.request.tolerance)
        if verification.ok:
            if self.best is None or plan.length < self.best.length * (1.0 - BETTER):
                self.idle = 0
            self.best = plan
            self.request.control.incumbent(plan.length, plan)
        elif any(UNDECIDABLE in check.where for check in verification.checks):
            self.undecidable = min(self.undecidable, plan.length)


def nearest_tour(problem: MessengerTour, request: Request) -> TourPlan | None:
    """Return the tour of :meth:`_Search.fly_nearest`, also after the time of `request` is over."""
    backend = TourSearch()
    with request.control.stage(None) as control:
        options = backend.checked_options({})
        search = _Search(backend, problem, replace(request, control=control, options=options))
        search.fly_nearest()
    return search.best
