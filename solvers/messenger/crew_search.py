"""``crew-search``: several UAVs, by moves and exchanges of vehicles between the tours of ``tour-search``."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ...jit import clock
from ...models.messenger.model import MessengerTour
from ...models.messenger.motion import met_after
from ...models.messenger.plan import TourPlan
from ..contract.backend import Answer, Feature, Guarantee, Option, Request, Termination
from .bound import CurvatureBound
from .extensions import TourBackend
from .search import TourSearch, nearest_tour

__all__ = ["CrewSearch"]

#: Options of the search for the tour of one UAV: while vehicles move between UAVs, and at the end.
QUICK = {"bound": False, "patience": 1, "steps": 100}
THOROUGH = {"bound": False, "patience": 8}
#: Least relative gain of a change.
GAIN = 1e-9

Sets = tuple[frozenset[int], ...]


class CrewSearch(TourBackend):
    """Assignment of vehicles to several UAVs, and a tour of each; ours.

    The UAV that can meet a vehicle first gets it. Then vehicles move from the UAV that finishes last to
    another one, or are exchanged, as long as this lowers the latest finish. Random moves restart the
    descent. The bound is the largest over the vehicles of the least bound over the UAVs: some UAV must meet
    the vehicle, and a tour that meets others as well is not shorter.
    """

    name = "crew-search"
    guarantee = Guarantee.RELAXATION
    features = frozenset(
        {Feature.SEED, Feature.INCUMBENTS, Feature.INTERRUPT, Feature.DUAL_BOUND, Feature.GAP}
    )
    single_threaded = True
    requires = ("clarabel",)
    carries = TourBackend.carries | {"uavs"}
    options: ClassVar[Mapping[str, Option]] = {
        "patience": Option(3, "Restarts without a better plan after which it ends.", int, lower=0)
    }
    summary = (
        "several UAVs: assignment of vehicles by moves and exchanges, and a proven bound; ours"
    )

    def refuses(self, problem: MessengerTour) -> str:
        """Return the reason why the backend does not cover `problem`, or an empty string."""
        return super().refuses(problem) or (
            "one UAV: use tour-search" if problem.uavs is None else ""
        )

    def fly(self, problem: MessengerTour, request: Request) -> Answer:
        """Search until a limit is reached, the gap is closed, or the patience is exhausted."""
        begin = clock()
        crew = _Crew(problem, request)
        sets, idle, optimal = crew.first(), 0, False
        crew.offer(sets)
        bound = crew.bound()
        request.control.prove(bound)
        while request.limit is None and not optimal and idle <= request.options["patience"]:
            before = crew.length
            sets = crew.descend(sets)
            for uav, vehicles in enumerate(sets):
                crew.tour(uav, vehicles, thorough=True)
            crew.offer(sets)
            optimal = crew.length < math.inf and crew.length - bound <= request.gap * crew.length
            idle = 0 if crew.length < before * (1 - GAIN) else idle + 1
            sets = crew.kick(crew.sets or sets)
        result = Termination.OPTIMAL if optimal else Termination.FEASIBLE
        return Answer(
            result if crew.plan else Termination.NO_SOLUTION, None if optimal else request.limit, crew.plan,
            crew.length if crew.plan else None, bound, seconds={"solve": clock() - begin},
            statistics={"tours": len(crew.tours)},
        )  # fmt: skip


@dataclass
class _Crew:
    """One run: the tours by start and vehicles, those searched for thoroughly, and the best plan."""

    problem: MessengerTour
    request: Request
    tours: dict[tuple[int, frozenset[int]], TourPlan | None] = field(default_factory=dict)
    finished: set[tuple[int, frozenset[int]]] = field(default_factory=set)
    sets: Sets = ()
    plan: TourPlan | None = None
    length: float = math.inf

    def __post_init__(self) -> None:
        self.draw = np.random.default_rng(self.request.seed or 0)
        starts = [tuple(start.tolist()) for start in self.problem.starts]
        # UAVs with the same start share tours.
        self.base = [starts.index(start) for start in starts]

    def bound(self) -> float:
        """Return a lower bound (m) on the latest finish."""
        best, problem = 0.0, self.problem
        soonest = np.min([
            met_after(problem, start[:2], 0.0, range(problem.size))
            for start in problem.starts
        ], axis=0)  # fmt: skip
        # The last vehicles to be met come first. The others then rarely require a second UAV.
        for k in np.argsort(-soonest).tolist():
            least = math.inf
            for uav in sorted(set(self.base)):
                answer = self.request.within(CurvatureBound(), problem.share(uav, [k]))
                least = min(least, answer.dual_bound or 0.0)
                if least <= best:
                    break
            best = max(best, least)
        return best

    def first(self) -> Sets:
        """Return the assignment of straight flights: the UAV that meets a vehicle first gets it."""
        problem = self.problem
        places = [start[:2] for start in problem.starts]
        times, left = np.zeros(len(places)), list(range(problem.size))
        sets: list[set[int]] = [set() for _ in places]
        while left:
            ends = np.array([
                time + met_after(problem, place, time, left)
                for place, time in zip(places, times.tolist(), strict=True)
            ])  # fmt: skip
            uav, row = divmod(int(ends.argmin()), len(left))
            times[uav] = ends[uav, row]
            vehicle = left.pop(row)
            places[uav] = problem.where(vehicle, float(times[uav]))
            sets[uav].add(vehicle)
        return tuple(map(frozenset, sets))

    def tour(self, uav: int, vehicles: frozenset[int], *, thorough: bool = False) -> float:
        """Return the length (m) of the best known tour of a UAV, inf without one; search for it once."""
        if not vehicles:
            return 0.0
        key = self.base[uav], vehicles
        if key not in self.tours or (thorough and key not in self.finished):
            rows, left = sorted(vehicles), self.request.left()
            alone = self.problem.share(uav, rows)
            answer = self.request.within(
                TourSearch(), alone, seed=self.request.seed or 0,
                options=THOROUGH if thorough else QUICK,
                # Leave time for the tours of the other UAVs.
                time_limit=None if left is None else left / (2 * len(self.base)),
            )  # fmt: skip
            plan, known = answer.point, self.tours.get(key)
            if plan is None and self.plan is None:
                plan = nearest_tour(alone, self.request)
            if plan is not None and (known is None or plan.length < known.length):
                known = TourPlan(
                    tuple(rows[k] for k in plan.order), plan.times, plan.points, plan.start,
                    plan.primitives,
                )  # fmt: skip
            self.tours[key] = known
            if thorough:
                self.finished.add(key)
        result = self.tours[key]
        return math.inf if result is None else result.length

    def descend(self, sets: Sets) -> Sets:
        """Return a local optimum of moves and exchanges of vehicles of the UAV that finishes last."""
        improved = True
        while improved and self.request.limit is None:
            self.offer(sets)
            improved, lengths = False, [self.tour(*item) for item in enumerate(sets)]
            last = int(np.argmax(lengths))
            for trial, uav in self.neighbours(sets, last):
                if self.request.limit is not None:
                    break
                others = [x for k, x in enumerate(lengths) if k not in (last, uav)]
                latest = max(self.tour(last, trial[last]), self.tour(uav, trial[uav]), *others)
                if latest < lengths[last] * (1 - GAIN):
                    sets, improved = trial, True
                    break
        return sets

    def neighbours(self, sets: Sets, last: int) -> Iterator[tuple[Sets, int]]:
        """Yield assignments with a vehicle moved from UAV `last`, or exchanged, in random order."""
        pairs = [
            (mine, uav, other)
            for mine in sorted(sets[last])
            for uav in range(len(sets))
            if uav != last
            for other in (None, *sorted(sets[uav]))
        ]
        for row in self.draw.permutation(len(pairs)).tolist():
            mine, uav, other = pairs[row]
            back = frozenset() if other is None else frozenset({other})
            new = list(sets)
            new[last] = (sets[last] - {mine}) | back
            new[uav] = (sets[uav] - back) | {mine}
            yield tuple(new), uav

    def kick(self, sets: Sets) -> Sets:
        """Return the assignment with random vehicles moved to random UAVs."""
        new = [set(part) for part in sets]
        for vehicle in self.draw.choice(
            self.problem.size, min(2, self.problem.size), replace=False
        ):
            for part in new:
                part.discard(int(vehicle))
            new[int(self.draw.integers(len(new)))].add(int(vehicle))
        return tuple(map(frozenset, new))

    def offer(self, sets: Sets) -> None:
        """Keep the plan of an assignment if it is verified and the best."""
        length = max(self.tour(*item) for item in enumerate(sets))
        if not length < self.length:
            return
        parts = []
        for uav, (vehicles, start) in enumerate(zip(sets, self.problem.starts, strict=True)):
            part = self.tours[self.base[uav], vehicles] if vehicles else None
            pose = np.append(start, 0.0)[:3]
            parts.append(part or TourPlan((), np.zeros(0), np.zeros((0, 2)), pose, ()))
        plan = TourPlan.join(parts)
        if self.problem.verify(plan, tolerance=self.request.tolerance).ok:
            self.plan, self.length, self.sets = plan, length, sets
            self.request.control.incumbent(length, plan)
