"""``staged``: from polygons to verified trajectories, a stage after the other."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...jit import OutOfTime, clock
from ...models.fleet.model import FleetRouting
from ...models.fleet.plan import FleetPlan
from ...models.fleet_mission.data import MissionObjective
from ...models.fleet_mission.model import FleetMission
from ...models.fleet_mission.plan import MissionPlan
from ...models.grid_path import distances
from ...models.grid_path.model import Connectivity, GridPath
from ...models.minimum_snap.model import MinimumSnap
from ...models.programs.linear import QuadraticProgram
from ...models.verification import Verification
from ..contract.backend import Answer, Backend, Feature, Guarantee, Option, Request, Termination
from .corridor import Cell, Corridor, corridor, crossed
from .courses import Course, courses_with_rests, whole_courses
from .delays import departures
from .flight import Flight, fly, resting
from .lanes import kept_right
from .neighbours import NeighbourWays
from .schedule import schedule
from .stages import Stages, Unanswered, planned, taking

__all__ = ["Staged"]

Floats = NDArray[np.float64]

#: Default seconds for the routing, per node.
SECONDS_A_NODE = 0.04
#: Largest share of the remaining time for the routing.
ROUTING_SHARE = 0.4
#: Lanes and rests are considered if the last return exceeds the longest flight by this factor.
LATE = 1.001
#: Time for the flights with lanes and rests as a multiple of the time for the direct ones.
LEGS = 8.0
#: Corners of the polygon around the last place of a moving obstacle, and its least radius in cells.
CORNERS, POINT = 32, 1e-3


class Staged(Backend):
    """Distances on the map, routes, paths, corridors of free cells, curves in them, departures.

    Each stage is solved by a backend of its own model and checked by it. Corridors consist of whole
    free cells, so the curves keep their distance from the obstacles whatever they do in between; a
    curve that rests at each knot fits into every corridor, so there is always one.
    """

    name = "staged"
    accepts = FleetMission
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.SEED, Feature.THREADS, Feature.INTERRUPT})
    options: ClassVar[Mapping[str, Option]] = {
        "routing": Option("fleet-search", "Backend for the routes.", str),
        "paths": Option(
            "any-angle", "Backend for the paths from node to node, in any direction.", str
        ),
        "trajectories": Option(
            "rounded",
            "Curves: polylines with rounded corners ('rounded'), or minimum snap by the backend named.",
            str,
        ),
        "detour": Option(
            1e-3,
            "Largest share by which rounded corners lengthen the shortest polyline.",
            lower=0.0,
        ),
        "margin": Option(
            1.0, "How far corridors reach beyond the shortest polyline, in cells.", lower=0.01
        ),
    }
    summary = "distances, routes, paths, corridors and fast curves in them, each checked; ours"

    def run(self, problem: FleetMission, request: Request) -> Answer:
        """Carry out the stages."""
        begin = clock()
        for mission in itertools.chain([problem], _around_last_places(problem)):
            stages = Stages(mission, request)
            try:
                answer = self._carried_out(stages)
            except Unanswered as fault:
                answer = fault.ended(request, stages.statistics)
            if answer.point is not None or stages.stopped() is not None:
                break
        return Answer(
            answer.termination, answer.limit, answer.point, answer.primal_bound,
            seconds={"solve": clock() - begin},
            statistics=stages.statistics, message=answer.message,
        )  # fmt: skip

    def _carried_out(self, stages: Stages) -> Answer:
        problem, request = stages.problem, stages.request
        own, counts = request.options, stages.statistics
        router = taking("routing", own["routing"], FleetRouting)
        searcher = taking("paths", own["paths"], GridPath)
        solver = None
        if own["trajectories"] != "rounded":
            solver = taking("trajectories", own["trajectories"], MinimumSnap, QuadraticProgram)
        with stages.clock("gridding"):
            problem.map  # noqa: B018 - made when it is first asked for
        seconds, left = SECONDS_A_NODE * len(problem.nodes), request.left()
        if left is not None:
            seconds = min(seconds, ROUTING_SHARE * left)
        with stages.clock("distances"):
            ways = None if left is None else NeighbourWays(problem)
            costs = _distances(problem, ways)
        routes = stages.routed(router, seconds, costs)
        with stages.clock("paths"):
            stops = [[0, *route, 0] for route in routes.routes]
            chains = [self._chains(stages, searcher, entry, ways) for entry in stops]
            margin = own["margin"] * problem.cell

            def corridors_within(reach: float) -> list[Corridor]:
                ends = (problem.places[entry] for entry in stops)
                return [
                    corridor(problem.map, *pair, reach) for pair in zip(ends, chains, strict=True)
                ]

            corridors = corridors_within(margin)
        counts["segments"] = sum(len(way.lower) for way in corridors)
        counts["polyline length"] = float(
            sum(np.hypot(*np.diff(way.knots, axis=0).T).sum() for way in corridors)
        )
        with stages.clock("trajectories"):
            flights = self._flights(stages, solver, corridors)
        counts["minimum-snap problems"] = sum(entry.programs for entry in flights)
        plan, result = self._put_together(stages, routes, flights)
        if not result.ok:  # a stop at every knot repairs violations by rounding
            flights = [Flight(resting(problem, way), 0, True, way.stops) for way in corridors]
            plan, result = self._put_together(stages, routes, flights)
        counts["robots that rest at knots"] = sum(entry.rests for entry in flights)
        counts["longest flight alone"] = max(entry.trajectory.duration for entry in flights)
        if self._is_late(stages, plan, result, flights):
            full = corridors_within(np.inf)
            lanes = [kept_right(way, problem.separation, margin) for way in full]
            wide = [lane or way for lane, way in zip(lanes, corridors, strict=True)]
            plan, result = self._shared(stages, solver, wide, flights, plan)
        if not result.ok:
            places = "; ".join(f"{check.name}: {check.where}" for check in result.violated)
            return Answer(Termination.NO_SOLUTION, stages.stopped(), message=places)
        return Answer(Termination.FEASIBLE, stages.stopped(), plan, result.objective)

    def _put_together(
        self, stages: Stages, routes: FleetPlan, flights: list[Flight]
    ) -> tuple[MissionPlan, Verification]:
        """Return the plan of flights with the better of two schedules, and its verification."""
        problem = stages.problem
        trajectories = [entry.trajectory for entry in flights]
        with stages.clock("departures"):
            moved = departures(problem, trajectories, stages.slack, stages.stopped)
        plan = planned(routes, moved, [entry.stops for entry in flights])
        return self._better(stages, whole_courses(problem, flights), plan)

    def _better(
        self, stages: Stages, courses: list[Course], plan: MissionPlan
    ) -> tuple[MissionPlan, Verification]:
        """Return `plan` or the plan of a schedule of the courses: the objective counts, then the makespan."""
        problem, request = stages.problem, stages.request
        plans = [plan]
        with stages.clock("schedule"):
            timed = schedule(problem, courses, request.seed or 0, stages.slack, stages.stopped)
        if timed is not None:
            trajectories, visits = zip(*timed, strict=True)
            plans.append(MissionPlan(plan.routes, trajectories, visits))
        with stages.clock("verification"):
            results = [problem.verify(entry, tolerance=request.tolerance) for entry in plans]

        def rank(pair: tuple[MissionPlan, Verification]) -> tuple[bool, float, float]:
            value = pair[1].objective or 0.0
            # Lengths of one curve at two speeds differ by rounding.
            return not pair[1].ok, float(f"{value:.9g}"), pair[0].end

        return min(zip(plans, results, strict=True), key=rank)

    def _is_late(
        self, stages: Stages, plan: MissionPlan, result: Verification, flights: list[Flight]
    ) -> bool:
        """Return whether lanes and rests may improve a plan, and the time suffices for them."""
        problem, left = stages.problem, stages.request.left()
        if stages.stopped() is not None or (not problem.moving and len(flights) < 2):
            return False
        seconds = LEGS * float(stages.statistics["trajectories seconds"])
        if left is not None and left < seconds:
            return False
        if not result.ok:
            return True
        longest = float(stages.statistics["longest flight alone"])
        return problem.objective is MissionObjective.MAKESPAN and plan.end > LATE * longest

    def _shared(
        self, stages: Stages, solver: Backend | None, ways: list[Corridor], flights: list[Flight],
        plan: MissionPlan,
    ) -> tuple[MissionPlan, Verification]:  # fmt: skip
        """Return a plan with lanes, and with rests at which robots may wait, if that is better."""
        with stages.clock("lanes and rests"):
            direct = whole_courses(stages.problem, flights)
            pieces = partial(self._flown, stages, solver)
            courses = list(courses_with_rests(stages.problem, direct, ways, pieces))
        alone = [entry.alone([leg.curve.duration for leg in entry.legs]) for entry in courses]
        stages.statistics["longest flight alone"] = max(alone)
        return self._better(stages, courses, plan)

    def _chains(
        self, stages: Stages, searcher: Backend, route: list[int], along: NeighbourWays | None
    ) -> list[list[Cell]]:
        """Return the cells of a robot's way over its stops (0 the depot, then the nodes).

        If the time does not suffice for `searcher`, the way leads along neighbours.
        """
        problem, grid = stages.problem, stages.problem.map
        same = 1e-7 * grid.cell
        chains: list[list[Cell]] = []
        for start, goal in itertools.pairwise(route):
            ends = problem.places[[start, goal]]
            if np.hypot(*(ends[1] - ends[0])) <= same:
                chains.append([])
                continue
            path = _path(stages, searcher, start, goal, along)
            chain = crossed(grid, np.concatenate([ends[:1], path, ends[1:]]))
            if chain is None:
                lost = Answer(Termination.NO_SOLUTION, message="a path leaves the free cells")
                raise Unanswered("corridors", lost)
            chains.append(chain)
        return chains

    def _flights(
        self, stages: Stages, solver: Backend | None, ways: list[Corridor]
    ) -> list[Flight]:
        threads = min(stages.request.available_threads, len(ways))
        flown = partial(self._flown, stages, solver)
        if threads == 1:
            return list(map(flown, ways))
        with ThreadPoolExecutor(threads) as pool:
            return list(pool.map(flown, ways))

    def _flown(self, stages: Stages, solver: Backend | None, way: Corridor) -> Flight:
        """Return the flight through a corridor, at rest at each knot if the time is over."""
        if stages.stopped() is not None:
            return Flight(resting(stages.problem, way), 0, True, way.stops)
        return fly(stages.problem, way, solver, stages.request, 1)


def _around_last_places(problem: FleetMission) -> Iterator[FleetMission]:
    """Yield the mission with an obstacle at the last place of each moving one, if nodes can be reached.

    Robots that depart after the last motion avoid all of them.
    """
    if not problem.moving:
        return
    corners = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
    ring = np.stack([np.cos(corners), np.sin(corners)], axis=1) / np.cos(np.pi / CORNERS)
    parts = [
        item.trajectory.at_ends()[1][-1] + max(item.radius, POINT * problem.cell) * ring
        for item in problem.moving
    ]
    with suppress(InvalidData):
        yield replace(problem, obstacles=[*problem.obstacles, *parts])


def _distances(problem: FleetMission, along: NeighbourWays | None) -> Floats:
    """Return the lengths between all places, by compiled loops or, if they take too long, by SciPy."""
    if along is None:
        return distances(problem.map, problem.cells)
    if along.are_many:
        return along.distances()
    try:
        return distances(problem.map, problem.cells)
    except OutOfTime:
        return along.distances()


def _path(
    stages: Stages, searcher: Backend, start: int, goal: int, along: NeighbourWays | None
) -> Floats:
    """Return a path between two places, along neighbours if the time does not suffice for `searcher`."""
    try:
        return stages.path(searcher, start, goal, Connectivity.ANY)
    except (Unanswered, OutOfTime):
        path = None if along is None else along.path(start, goal)
        if path is None:
            raise
        return path
