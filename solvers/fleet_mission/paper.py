"""Algorithm 1 of the paper, whose curves may collide with obstacles."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from ...jit import clock
from ...models.fleet.model import FleetRouting
from ...models.fleet_mission.model import FleetMission
from ...models.fleet_mission.plan import MissionPlan
from ...models.grid_path.model import Connectivity
from ...models.minimum_snap.model import MinimumSnap
from ...models.minimum_snap.trajectory import Trajectory
from ..contract.backend import Answer, Backend, Feature, Guarantee, Option, Request, Termination
from ..contract.registry import find_backend
from .corridor import Corridor
from .delays import departures
from .energies import READINGS, leg_energies
from .flight import programmed, resting, slowed, times_along
from .stages import Stages, Unanswered, planned, taking

__all__ = ["PaperPipeline"]


class PaperPipeline(Backend):
    """Algorithm 1: energies, PSO-AC, A* over four neighbours, Algorithm 4 and minimum snap.

    Unit energies (eq. 17) apply to the pairs of places that do not see each other. The curves are
    continuous up to the derivative `continuity` of the model; 2 is the paper's (eq. 23-25). A curve
    may enter obstacles between its points. The check of the model then rejects the plan and names
    the place. The paper gives neither times nor limits: here times follow a trapezoidal speed
    profile, and each curve is slowed down until it keeps the limits.

    The statistics hold the length of each robot's grid path and smoothed path, as in Table 3.
    """

    name = "paper-pipeline"
    accepts = FleetMission
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.SEED, Feature.INTERRUPT})
    single_threaded = True
    options: ClassVar[Mapping[str, Option]] = {
        "routing": Option("pso-ac", "Backend for the routes.", str),
        "energies": Option(
            "direct",
            "Energies of legs: eq. 17 for pairs that do not see each other (direct) or for all pairs "
            "(manhattan), or lengths of grid paths (paths).",
            str,
            choices=READINGS,
        ),
    }
    summary = (
        "the paper's Algorithm 1: energies, PSO-AC, A*, Algorithm 4, minimum snap; may collide"
    )

    def run(self, problem: FleetMission, request: Request) -> Answer:
        """Run the stages and return the plan unchecked, so that collisions become visible."""
        begin = clock()
        stages = Stages(problem, request)
        try:
            plan = self._carried_out(stages)
        except Unanswered as fault:
            return fault.ended(request, stages.statistics)
        return Answer(
            Termination.FEASIBLE, stages.stopped(), plan,
            seconds={"solve": clock() - begin}, statistics=stages.statistics,
        )  # fmt: skip

    def _carried_out(self, stages: Stages) -> MissionPlan:
        from ..grid_path.smoothing import smooth

        problem, grid, options = stages.problem, stages.problem.map, stages.request.options
        router = taking("routing", options["routing"], FleetRouting)
        with stages.clock("energies"):
            energies = leg_energies(problem, options["energies"])
        routes = stages.routed(router, None, energies)
        searcher = find_backend("a-star", problem="grid_path")
        solver = find_backend("banded")
        flights: list[Trajectory] = []
        stops = []
        for robot, route in enumerate(routes.routes):
            points, knots, length = [problem.depot[None]], [0], 0.0
            for start, goal in itertools.pairwise([0, *route, 0]):
                with stages.clock("paths"):
                    path = stages.path(searcher, start, goal, Connectivity.FOUR)
                    ends = problem.places[[start, goal]]
                    full = np.concatenate([ends[:1], path, ends[1:]])
                    kept = smooth(grid, full, "greedy")[1:]
                length += float(np.hypot(*np.diff(full, axis=0).T).sum())
                apart = np.hypot(*np.diff(np.concatenate([points[-1][-1:], kept]), axis=0).T)
                points.append(kept[apart > 1e-7 * grid.cell])
                knots.append(knots[-1] + len(points[-1]))
            way = np.concatenate(points)
            stages.statistics[f"grid path of robot {robot}"] = length
            smoothed = float(np.hypot(*np.diff(way, axis=0).T).sum())
            stages.statistics[f"smoothed path of robot {robot}"] = smoothed
            empty = np.empty((0, 2))
            with stages.clock("trajectories"):
                flights.append(
                    self._flown(stages, Corridor(empty, empty, way, np.array(knots)), solver)
                )
            stops.append(np.array(knots))
        with stages.clock("departures"):
            # The paper's robots depart at once; with a separation they depart one by one.
            flights = departures(problem, flights, stages.slack)
        return planned(routes, flights, stops)

    def _flown(self, stages: Stages, way: Corridor, solver: Backend) -> Trajectory:
        """Return the minimum-snap curve through the knots, slowed down to satisfy the limits."""
        problem = stages.problem
        if len(way.knots) < 2:
            return resting(problem, way)
        times = np.concatenate([[0.0], np.cumsum(times_along(problem, way))])
        rest = np.zeros((problem.continuity, 2))
        model = MinimumSnap(way.knots, times, continuity=problem.continuity, start=rest, end=rest)
        answer = programmed(solver, model, stages.request, 1)
        if answer.point is None:
            raise Unanswered("trajectories", answer)
        return slowed(problem, answer.point)
