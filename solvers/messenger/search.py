"""``tour-search``: annealing from many starts, polished as a nonlinear program, with a proven bound."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from ...jit import clock
from ...models.messenger.checks import UNDECIDABLE, decidable_length
from ...models.messenger.model import MessengerTour
from ...models.messenger.plan import TourPlan
from ..contract.backend import Answer, Feature, Guarantee, Limit, Option, Request, Termination
from .annealing import anneal
from .chain import fly
from .emission import Chain, move_to_boundary
from .extensions import TourBackend
from .last_leg import bound_only_leg, fly_to_rims, shorten_last_leg
from .pose_bound import covers, prepare, prove_poses
from .starts import LEAST, Starts

__all__ = ["TourSearch", "nearest_tour"]

#: Temperatures relative to the length of the tour: at a start, at a reheating, and at the end of both.
HOT, WARM, COLD = 0.3, 0.02, 1e-3
#: Steps of one annealing per vehicle; the least number is that of :mod:`.starts`.
STEPS = 20
#: Least number of vehicles for annealing orders instead of starting from scratch.
MANY = 50
#: Share of the time left, and most steps per vehicle, of one annealing of a tour.
TOUR_SHARE, TOUR_MOST = 0.3, 150
#: Number of tours in the pool, which are annealed again.
POOL = 4
#: Share of the time for the bound, and again for orders; without a limit, number of programs solved.
BOUND_SHARE, BOUND_PROGRAMS = 0.2, 3000
#: Share of the time for the bound of many vehicles, whose orders are not used.
MANY_SHARE = 0.05
#: Programs solved for tours without curvature if the search for the bound completed no order.
SKETCH_PROGRAMS = 300
#: Largest number of vehicles of the bound over poses. Its number of edges, and the factor on it if the
#: requested gap is at least the given one.
FEW, EDGES, MORE_EDGES, WIDE_GAP = 3, 300_000, 200, 1e-5
#: Least number of steps of an annealing for so few vehicles at first, and largest gap after which no longer
#: annealings follow. The first run of a process then needs no compiled annealing.
BRIEF_STEPS, CLOSE = 60, 5e-3
#: Factor on the patience otherwise: with short legs, most annealings miss the shortest tour.
MORE = 4
#: Largest relative violation of a tour that is repaired.
NEAR_MISS = 1e-3
#: Least relative gain of a shorter tour that resets the patience.
BETTER = 1e-6
#: Ratio to the best length up to which a tour is polished.
NEAR = 1.03


class TourSearch(TourBackend):
    """Ruin and recreate under annealing, from many starts, then the best tours again; ours.

    The best tours are polished by the nonlinear program of their order and turns, which never makes them longer.
    The bound is that of :class:`.bound.CurvatureBound`, and for up to three vehicles the one of :mod:`.pose_bound`.
    For these, short annealings are enough if the gap is then at most 0.5 %.
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
            16,
            "Annealings without a shorter tour after which the search ends; for up to three vehicles half as "
            "many if the gap is then at most 0.5 %, else four times as many.",
            int,
            lower=1,
        ),
        "steps": Option(
            0,
            "Steps of one annealing; 0 means 20 per vehicle, but at least 300, or 60 at first for up to three vehicles.",
            int,
            lower=0,
        ),
    }
    summary = "annealing, polish, and a proven bound; ours"

    def fly(self, problem: MessengerTour, request: Request) -> Answer:
        """Search until a limit is reached, the gap is closed, or the patience is exhausted."""
        return _Search(problem, request).answer()


@dataclass
class _Search(Starts):
    """One run."""

    pool: list[tuple[float, int, Chain]] = field(default_factory=list)
    best: TourPlan | None = None
    bound: float | None = None
    runs: int = 0
    idle: int = 0
    polishes: int = 0
    undecidable: float = math.inf
    pace: float = 0.0
    #: Whether annealings are short, and the tour that the bound over poses was computed for.
    brief: bool = False
    compared: TourPlan | None = None

    def answer(self) -> Answer:
        """Search, and return the best tour with its bound."""
        begin = clock()
        request, options = self.request, self.request.options
        self.brief = self.few and options["bound"]
        if self.brief:
            prepare()
        if request.warm_start is not None:
            self.offer(request.warm_start)
        if request.time_limit is not None:
            self.fly_nearest()
        if self.problem.start is not None:  # quick for any number of vehicles
            self.anneal(1, self.fly_rims(self.nearest()))
        if self.many:
            self.anneal(self.least, self.lay(self.nearest()))
        if self.best is None or not self.many:
            self.anneal(self.least)
        proven = clock()
        orders = self.prove() if options["bound"] else []
        proven = clock() - proven
        for order in orders:
            if not self.ended:
                self.anneal(self.steps, self.guided(order))
        self.anneal_again()
        if self.brief:
            self.prove_few()
            self.brief, self.idle = self.is_within(CLOSE), 0
            if not self.brief:
                self.anneal_again()
        if options["bound"]:
            self.prove_few()
        limit = request.limit
        statistics = {"annealings": self.runs, "polishes": self.polishes}
        seconds = {"solve": clock() - begin, "bound": proven}
        best, done = self.best, self.is_within(request.gap)
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
    def few(self) -> bool:
        """Whether the vehicles are so few that short annealings suffice, and the bound over poses applies."""
        return self.problem.size <= FEW and covers(self.problem)

    @property
    def least(self) -> int:
        """Least number of steps of an annealing."""
        return BRIEF_STEPS if self.brief else LEAST

    @property
    def steps(self) -> int:
        """Number of steps of an annealing without a limit."""
        return self.request.options["steps"] or max(STEPS * self.problem.size, self.least)

    @property
    def patience(self) -> int:
        """Number of annealings without a shorter tour after which the search ends."""
        patience = int(self.request.options["patience"])
        if self.brief:
            return max(patience // 2, 1)
        return MORE * patience if self.few and self.compared is not None else patience

    @property
    def ended(self) -> bool:
        """Whether the search has ended."""
        done = self.request.limit is not None or self.is_within(self.request.gap)
        return done or self.idle >= self.patience

    def is_within(self, gap: float) -> bool:
        """Return whether the best tour is proven within a relative gap."""
        if self.best is None or self.bound is None:
            return False
        return self.best.length - self.bound <= gap * self.best.length

    def prove(self) -> list[tuple[int, ...]]:
        """Prove a lower bound, and return the orders with the least bounds."""
        from .bound import straight
        from .bound_search import OrderSearch, best_orders

        control, left = self.request.control, self.request.left()
        if (leg := bound_only_leg(self.problem)) is not None:
            self.bound = leg
            control.prove(leg)
            return []
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

    def prove_few(self) -> None:
        """Raise the bound of a tour over few vehicles, also for short legs."""
        problem, gap = self.problem, self.request.gap
        if not self.few or self.best is None or self.is_within(gap) or self.best is self.compared:
            return
        self.compared = self.best
        edges = EDGES * (MORE_EDGES if gap >= WIDE_GAP else 1)
        bound = prove_poses(
            problem, self.best.length, gap, edges, lambda: self.request.limit is not None
        )
        self.bound = max(bound, self.bound or 0.0)
        self.request.control.prove(self.bound)

    def anneal_again(self) -> None:
        """Anneal tours from scratch, and those of the pool again, until the search has ended."""
        steps = self.steps
        while not self.ended:
            again = bool(self.pool) and self.many
            again = again or (len(self.pool) == POOL and self.runs % 2 == 1)
            k = 0 if self.many or not again else int(self.draw.integers(len(self.pool)))
            if self.many:
                steps = self.affordable(TOUR_SHARE, self.pace, LEAST, steps, TOUR_MOST)
            self.anneal(steps, self.pool[k][2].copy() if again else None)

    def fly_nearest(self) -> None:
        """Offer the tour of :meth:`nearest`, which takes milliseconds without compiled loops."""
        chain = self.nearest()
        if fly(chain.stops, chain.count, 1, chain.scene, math.inf) < math.inf:
            self.offer(chain.plan())

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
        return self.chain_of(plan)

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
        if not verification.ok and (near := self.repaired(plan)) is not None:
            plan, verification = near, self.problem.verify(near, tolerance=self.request.tolerance)
            if self.best is not None and plan.length >= self.best.length:
                return
        if verification.ok:
            if self.best is None or plan.length < self.best.length * (1.0 - BETTER):
                self.idle = 0
            self.best = plan
            self.request.control.incumbent(plan.length, plan)
        elif any(UNDECIDABLE in check.where for check in verification.checks):
            self.undecidable = min(self.undecidable, plan.length)

    def repaired(self, plan: TourPlan) -> TourPlan | None:
        """Return the flight over the encounters of a plan that misses a disc slightly, or None."""
        if self.problem.start is None or not self.problem.verify(plan, tolerance=NEAR_MISS).ok:
            return None
        chain = self.chain_of(plan)
        if not fly(chain.stops, chain.count, 1, chain.scene, math.inf) < math.inf:
            return None
        return chain.plan()


def nearest_tour(problem: MessengerTour, request: Request) -> TourPlan | None:
    """Return the tour of :meth:`_Search.fly_nearest`, also after the time of `request` is over."""
    backend = TourSearch()
    with request.control.stage(None) as control:
        options = backend.checked_options({})
        search = _Search(problem, replace(request, control=control, options=options))
        search.fly_nearest()
    return search.best
