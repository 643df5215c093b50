"""Search for the routes of a fleet by annealing from many starts and recombination; ours."""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...jit import clock
from ...models.fleet import FleetPlan, FleetRouting
from ...models.fleet.checks import loads_of, objective_of
from ...models.fleet.data import LARGE, Metric
from ..contract.backend import Answer, Feature, Guarantee, Option, Request, Termination
from .bound import lower_bound, trip_bound
from .candidate import PENALTY, Candidate, scaled
from .decomposition import SIZE, Parts
from .fleet_kernels import Fleet
from .giant_tour import GiantTour
from .rivals import FleetBackend
from .start import ROUNDING, cut_tour, first_plan, first_routes, repair
from .tree_bound import tree_bound

__all__ = ["FleetSearch"]

Floats = NDArray[np.float64]

#: Steps of annealing that take as long as a kick of a tour.
PER_KICK = 5
#: Steps of one annealing: per node, minimum and maximum.
STEPS, LEAST, MOST = 250, 500, 50_000
#: Size of the pool of routes for recombination.
KEPT = 8
#: Annealings from scratch per generation, and rounds without improvement that end it.
BORN, STALE = 8, 10
#: Concurrent annealings; independent of the number of threads, so threads do not change the plan.
ABREAST = 2
#: Initial temperatures relative to the energy, from scratch and for recombined routes. Chosen from
#: 0.003 … 0.1 for the shortest longest routes on TSPLIB instances of 51 to 200 nodes.
HOT, WARM = 0.02, 0.01
#: Factor of the penalty for violated limits, up or down, and its maximum.
STRICTER, STRICTEST = 2.0, 1e4
#: Largest number of nodes of one tour, whose distances are stored.
MOST_IN_TOUR = 5000
#: Largest number of points whose bound uses all distances, which takes 0.6 s and 0.3 GB. The spanning tree gives
#: a bound that is 9 % lower for 5 vehicles and 2000 random points, and 45 % lower for 20 vehicles and 1000.
MOST_PRICED = 2000
#: Parts without improvement after which a search ends, beside three times all parts.
PARTS = 50
#: Relative improvement of the objective required for a new incumbent.
BETTER = 1e-9


class FleetSearch(FleetBackend):
    """Simulated annealing by ruin and recreate, from many starts, for every fleet objective.

    The best routes form a pool; they are recombined route by route and annealed again. The energy is
    the model's objective plus a penalty for violated limits. A separate computation proves a lower
    bound, see :mod:`.bound`.
    """

    name = "fleet-search"
    guarantee = Guarantee.RELAXATION
    features = frozenset(
        {
            Feature.SEED, Feature.THREADS, Feature.INCUMBENTS, Feature.INTERRUPT,
            Feature.WARM_START, Feature.DUAL_BOUND, Feature.GAP,
        }
    )  # fmt: skip
    options: ClassVar[Mapping[str, Option]] = {
        "patience": Option(
            1,
            "Consecutive generations without better routes after which the search ends.",
            int,
            lower=1,
        ),
        "steps": Option(
            0,
            "Steps of one annealing; 0 means 250 per node, from 500 to 50000, and 60 per node of each part "
            "if more than 1000 nodes are planned in parts.",
            int,
            lower=0,
        ),
        "bound": Option(True, "Whether to prove a lower bound as well.", bool),
    }
    summary = "annealing from many starts and recombination, with a proven bound; ours"

    def run(self, problem: FleetRouting, request: Request) -> Answer:
        """Search until the time limit, a closed gap or the end of the patience."""
        self.require_support(problem)
        return _Search(problem, request).answer()


@dataclass
class _Search:
    """State of one run."""

    model: FleetRouting
    request: Request
    pool: list[Candidate] = field(default_factory=list)
    fleet: Fleet = field(init=False)
    in_parts: bool = False
    tour: GiantTour | None = None
    best: FleetPlan | None = None
    objective: float = math.inf
    packing: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    key: tuple[float, float] = (math.inf, math.inf)
    bound: float | None = None
    steps: int = 0
    rounds: int = 0
    born: int = 0
    proving: float = 0.0

    def answer(self) -> Answer:
        """Run the search and return its answer."""
        model, request = self.model, self.request
        begin = clock()
        seeds = np.random.SeedSequence(request.seed or 0).spawn(ABREAST)
        self.draws = [np.random.default_rng(seed) for seed in seeds]
        self.in_parts = model.size > LARGE and not (
            GiantTour.covers(model) and model.size <= MOST_IN_TOUR
        )
        if self.in_parts:
            self.search_parts()
        else:
            # More threads than concurrent annealings would stay idle.
            threads = min(ABREAST, request.available_threads)
            if self.begin():
                with ThreadPoolExecutor(threads) as pool:
                    self.search(pool)
        limit = request.limit
        statistics = {"steps": self.steps, "rounds": self.rounds}
        seconds = {"solve": clock() - begin, "bound": self.proving}
        if self.best is None:
            return Answer(
                Termination.NO_SOLUTION, limit, None, None, self.bound, seconds=seconds,
                statistics=statistics, message="no routes were found that keep all limits",
            )  # fmt: skip
        done = self.within_gap
        return Answer(
            Termination.OPTIMAL if done else Termination.FEASIBLE, None if done else limit, self.best,
            self.objective, self.bound, seconds=seconds, statistics=statistics,
        )  # fmt: skip

    @property
    def must_stop(self) -> bool:
        """Whether a stop was requested or the time limit is reached."""
        return self.request.limit is not None

    @property
    def within_gap(self) -> bool:
        """Whether the gap of the incumbent is at most the requested gap."""
        if self.best is None or self.bound is None:
            return False
        return self.objective - self.bound <= self.request.gap * abs(self.objective)

    def begin(self) -> bool:
        """Compute the fast bound, the first routes and the data of the kernels; return whether time is left.

        The first routes need no matrix, which takes seconds for thousands of nodes.
        """
        model, request = self.model, self.request
        if request.options["bound"]:
            self.prove(trip_bound(model))
        self.packing = np.random.default_rng(np.random.SeedSequence([request.seed or 0, 1]))
        warm = request.warm_start
        if warm is None:
            first = first_plan(model, self.packing, lambda: self.must_stop)
            if first is not None:
                self.keep(*first)
            # The matrix alone takes 0.5 s for 5000 points.
            if self.must_stop or (model.distances.size and self.must_stop):
                return False
        self.fleet = scaled(model, not GiantTour.covers(model))
        if warm is not None:
            self.offer(Candidate(self.fleet, [list(route) for route in warm.routes]))
        if not self.must_stop:
            self.tour = GiantTour.of(model, self.fleet, lambda: self.must_stop)
        return not self.must_stop

    def search_parts(self) -> None:
        """Find routes of a large fleet and improve them part by part."""
        model, request, draw = self.model, self.request, self.draws[0]
        if request.options["bound"]:
            self.prove(trip_bound(model))
        warm = request.warm_start
        routes = [] if warm is None else [list(route) for route in warm.routes]
        if sorted(node for stops in routes for node in stops) != model.customers.tolist():
            routes = first_routes(model, draw, lambda: self.must_stop) or cut_tour(model)
        parts = Parts(model, routes, draw)
        self.keep_if_verified(parts)
        if request.options["bound"] and not self.within_gap:
            begin, plane = clock(), model.costs is None and model.metric is not Metric.GRID
            lean, flag = plane and model.size > MOST_PRICED, request.control.flag
            self.prove(tree_bound(model) if lean else lower_bound(model, flag))
            self.proving += clock() - begin
        idle, most = 0, request.options["patience"] * (PARTS + 3 * model.size // SIZE)
        while idle < most and not (self.must_stop or self.within_gap):
            better = parts.improve(request.control.flag, request.options["steps"])
            idle = 0 if better else idle + 1
            self.rounds += 1
            if better and parts.objective < self.objective:
                self.keep_if_verified(parts)
        self.steps = parts.steps

    def keep_if_verified(self, parts: Parts) -> None:
        """Make the routes of `parts` the incumbent if they keep all limits and are better."""
        plan = parts.plan
        checked = self.model.verify(plan, tolerance=ROUNDING)
        if checked.ok and checked.objective is not None:
            self.keep(plan, checked.objective)

    def search(self, threads: ThreadPoolExecutor) -> None:
        """Anneal in rounds: each generation starts from scratch, then recombines its pool."""
        request, options = self.request, self.request.options
        count = len(self.fleet.nodes)
        steps = options["steps"] or min(max(STEPS * count, LEAST), MOST)
        idle = stale = 0
        improved = False
        flag, unit = request.control.flag, float(self.model.distances.max()) or 1.0

        def work(job: tuple[Candidate, float, np.random.Generator]) -> int:
            candidate, hot, draw = job
            if self.tour is not None:
                stops, done = self.tour.improve(candidate.stops(), steps // PER_KICK, flag, draw)
                candidate.assign(stops)
                return done
            return candidate.anneal(hot, steps, flag, draw)

        while idle < options["patience"] and not self.within_gap:
            if self.must_stop:
                return
            if self.bound is not None:  # annealing ends at this objective
                self.fleet.rules[8] = self.bound / (1.0 - min(self.request.gap, 0.5)) / unit
            jobs = [self.select_start(draw) for draw in self.draws]
            self.steps += sum(threads.map(work, jobs))
            self.rounds += 1
            before = self.pool[0].key if self.pool else None
            better = [self.offer(candidate) for candidate, _, _ in jobs]
            better += [self.repair(candidate) for candidate, _, _ in jobs]
            improved |= any(better)
            self.weigh([candidate.key[0] > 0.0 for candidate, _, _ in jobs])
            stale = 0 if self.pool[0].key != before else stale + 1
            if self.rounds == 1 and options["bound"] and not self.within_gap:
                begin = clock()
                self.prove(lower_bound(self.model, flag))  # once routes are known
                self.proving += clock() - begin
            if stale >= STALE and self.born >= BORN:
                idle = 0 if improved else idle + 1
                self.pool.clear()
                self.born, stale, improved = 0, 0, False

    def prove(self, bound: float) -> None:
        """Report a lower bound."""
        self.request.control.prove(bound)
        self.bound = max(bound, self.bound or 0.0)

    def weigh(self, broken: list[bool]) -> None:
        """Increase the penalty if all annealings ended with violations, decrease it if none did."""
        if all(broken):
            self.fleet.rules[7] = min(self.fleet.rules[7] * STRICTER, STRICTEST)
        elif not any(broken):
            self.fleet.rules[7] = max(self.fleet.rules[7] / STRICTER, PENALTY)

    def repair(self, candidate: Candidate) -> bool:
        """Remove the overload of annealed routes and offer them; return whether they are the best."""
        if not (candidate.routes.values[1] > self.fleet.limits[1]).any():
            return False
        fixed = repair(self.model, candidate.stops(), self.packing, lambda: self.must_stop)
        return fixed is not None and self.offer(Candidate(self.fleet, fixed))

    def select_start(
        self, draw: np.random.Generator
    ) -> tuple[Candidate, float, np.random.Generator]:
        """Return routes to anneal, empty or recombined from the pool, and their temperature."""
        if self.tour is not None:
            self.born = BORN
            first = self.pool[0].stops() if self.pool else cut_tour(self.model)
            return Candidate(self.fleet, first), WARM, draw
        if self.born < BORN:
            self.born += 1
            return Candidate(self.fleet, []), HOT, draw
        a, b = (int(k) for k in draw.integers(0, len(self.pool), 2))
        return self.cross(self.pool[a], self.pool[b], draw), WARM, draw

    def cross(self, parent: Candidate, other: Candidate, draw: np.random.Generator) -> Candidate:
        """Return the crossover of two fleets: random routes of `parent`, completed from `other`."""
        first, second = parent.stops(), other.stops()
        m = len(first)
        chosen = [k for k in range(m) if draw.random() < 0.5]
        if parent is other or not chosen:
            return Candidate(self.fleet, first)
        taken = {node for k in chosen for node in first[k]}
        routes: list[list[int]] = [[] for _ in range(m)]
        free = [k for k in range(m) if k not in chosen]
        # Prefer routes of the other fleet that share the fewest nodes with the chosen ones.
        shared = [sum(node in taken for node in stops) for stops in second]
        for k in chosen:
            routes[k] = first[k]
        if (self.model.homes == self.model.homes[0]).all():
            rest = [second[k] for k in sorted(range(m), key=shared.__getitem__)[: len(free)]]
        else:
            rest = [second[k] for k in free]
        for k, stops in zip(free, rest, strict=True):
            routes[k] = [node for node in stops if node not in taken]
        missing = len(self.fleet.nodes) - sum(map(len, routes))
        if self.model.use_all and sum(not stops for stops in routes) > missing:
            return Candidate(self.fleet, first)
        return Candidate(self.fleet, routes)

    def offer(self, candidate: Candidate) -> bool:
        """Add new routes to the pool if they are good enough; return whether they are the best."""
        if candidate.key not in [member.key for member in self.pool]:
            self.pool.append(candidate)
            self.pool.sort(key=lambda member: member.key)
            del self.pool[KEPT:]
        first = candidate.key < self.key
        self.key = min(self.key, candidate.key)
        if candidate.key[0] > 0.0:
            return first
        plan = FleetPlan(tuple(map(tuple, candidate.stops())))
        return self.keep(plan, objective_of(self.model, loads_of(self.model, plan)))

    def keep(self, plan: FleetPlan, objective: float) -> bool:
        """Make `plan` the incumbent if it is better; return whether it is."""
        if not objective < self.objective - BETTER * abs(self.objective) and self.best is not None:
            return False
        self.best, self.objective = plan, objective
        self.request.control.incumbent(objective, plan)
        return True
