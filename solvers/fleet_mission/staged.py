"""``staged``: from polygons to verified trajectories, a stage after the other."""

from __future__ import annotations

import itertools
import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...jit import OutOfTime, clock
from ...models.fleet.model import FleetRouting
from ...models.fleet.plan import FleetPlan
from ...models.fleet_mission.model import FleetMission
from ...models.fleet_mission.plan import MissionPlan
from ...models.grid_path import distances
from ...models.grid_path.model import Connectivity, GridPath
from ...models.minimum_snap.model import MinimumSnap
from ...models.programs.linear import QuadraticProgram
from ...models.verification import Verification
from ..contract.backend import Answer, Backend, Feature, Guarantee, Option, Request, Termination
from .corridor import Cell, Corridor, corridor, crossed
from .delays import departures
from .flight import Flight, fly, resting
from .neighbours import NeighbourWays
from .stages import Stages, Unanswered, planned, taking

__all__ = ["Staged"]

Floats = NDArray[np.float64]

#: Default seconds for the routing, per node.
SECONDS_A_NODE = 0.04
#: Largest share of the remaining time for the routing.
ROUTING_SHARE = 0.4


class Staged(Backend):
    """Distances on the map, routes, paths, corridors of free cells, minimum snap, departures.

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
        "trajectories": Option("interior-point", "Backend for the minimum-snap problems.", str),
        "margin": Option(
            1.0, "How far corridors reach beyond the shortest polyline, in cells.", lower=0.01
        ),
    }
    summary = "distances, routes, paths, corridors and minimum snap, each checked; ours"

    def run(self, problem: FleetMission, request: Request) -> Answer:
        """Carry out the stages."""
        begin = clock()
        stages = Stages(problem, request)
        try:
            answer = self._carried_out(stages)
        except Unanswered as fault:
            answer = fault.ended(request, stages.statistics)
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
            corridors = self._corridors(stages, searcher, stops, ways)
        counts["segments"] = sum(len(way.lower) for way in corridors)
        counts["polyline length"] = float(
            sum(np.hypot(*np.diff(way.knots, axis=0).T).sum() for way in corridors)
        )
        with stages.clock("trajectories"):
            flights = self._flights(stages, solver, corridors)
        counts["minimum-snap problems"] = sum(entry.programs for entry in flights)
        plan, result = self._put_together(stages, routes, corridors, flights)
        if not result.ok:  # a stop at every knot repairs violations by rounding
            flights = [Flight(resting(problem, way), 0, True) for way in corridors]
            plan, result = self._put_together(stages, routes, corridors, flights)
        counts["robots that rest at knots"] = sum(entry.rests for entry in flights)
        if not result.ok:
            return Answer(Termination.NO_SOLUTION, stages.stopped(), message=result.summary())
        return Answer(Termination.FEASIBLE, stages.stopped(), plan, result.objective)

    def _put_together(
        self, stages: Stages, routes: FleetPlan, ways: list[Corridor], flights: list[Flight]
    ) -> tuple[MissionPlan, Verification]:
        """Return the plan of flights with their departures, and what its check says."""
        problem, tolerance = stages.problem, stages.request.tolerance
        with stages.clock("departures"):
            slack = 1e-3 * tolerance * problem.cell
            moved = departures(problem, [entry.trajectory for entry in flights], slack)
        plan = planned(routes, moved, [way.stops for way in ways])
        with stages.clock("verification"):
            return plan, problem.verify(plan, tolerance=tolerance)

    def _corridors(
        self,
        stages: Stages,
        searcher: Backend,
        stops: list[list[int]],
        along: NeighbourWays | None,
    ) -> list[Corridor]:
        """Return the corridor of each robot's way over its stops (0 the depot, then the nodes).

        A way that `searcher` has no time for leads along neighbours.
        """
        problem, grid = stages.problem, stages.problem.map
        margin = stages.request.options["margin"] * grid.cell
        same = 1e-7 * grid.cell
        ways = []
        for route in stops:
            places = problem.places[route]
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
            ways.append(corridor(grid, places, chains, margin))
        return ways

    def _flights(self, stages: Stages, solver: Backend, ways: list[Corridor]) -> list[Flight]:
        problem, request = stages.problem, stages.request
        threads = min(request.threads or os.cpu_count() or 1, len(ways))

        def flown(way: Corridor) -> Flight:
            return fly(problem, way, solver, request, 1)

        if threads == 1:
            return [flown(way) for way in ways]
        with ThreadPoolExecutor(threads) as pool:
            return list(pool.map(flown, ways))


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
