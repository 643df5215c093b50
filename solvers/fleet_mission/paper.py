"""``paper-pipeline``: the stages as the paper has them, which do not ensure that a curve is free."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from ...jit import clock
from ...models.fleet.model import FleetRouting
from ...models.fleet_mission.model import FleetMission
from ...models.grid_path.model import Connectivity
from ...models.minimum_snap.model import MinimumSnap
from ...models.minimum_snap.trajectory import Trajectory
from ..backend import Answer, Backend, Feature, Guarantee, Option, Request, Termination
from ..registry import find_backend
from .corridor import Corridor
from .flight import programmed, resting, slowed, times_along
from .stages import Stages, Unanswered, planned, taking

__all__ = ["PaperPipeline"]


class PaperPipeline(Backend):
    """A* over four neighbours, PSO-AC, Algorithm 4, and minimum snap through the points that remain.

    Energies are Manhattan distances, which eq. 17 cancels to, so that obstacles do not count for the
    routes. Between its points a curve is free to enter obstacles; such a plan is rejected, and its
    check says where. What the paper leaves open is ours: times follow a trapezoid of speed, and the
    curve is slowed down until it keeps the limits.
    """

    name = "paper-pipeline"
    accepts = FleetMission
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.SEED, Feature.INTERRUPT})
    single_threaded = True
    options: ClassVar[Mapping[str, Option]] = {
        "routing": Option("pso-ac", "Backend for the routes.", str),
    }
    summary = "the paper's stages: A*, PSO-AC, Algorithm 4, minimum snap; may collide"

    def run(self, problem: FleetMission, request: Request) -> Answer:
        """Carry out the stages; the plan is not checked here, for it is the paper's."""
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

    def _carried_out(self, stages: Stages) -> object:
        from ..grid_path.smoothing import smooth

        problem, grid = stages.problem, stages.problem.map
        router = taking("routing", stages.request.options["routing"], FleetRouting)
        routes = stages.routed(router, None, manhattan=True)
        searcher = find_backend("a-star", problem="grid_path")
        solver = find_backend("banded")
        flights: list[Trajectory] = []
        stops = []
        for route in routes.routes:
            points, knots = [problem.depot[None]], [0]
            for start, goal in itertools.pairwise([0, *route, 0]):
                with stages.clock("paths"):
                    path = stages.path(searcher, start, goal, Connectivity.FOUR)
                    ends = problem.places[[start, goal]]
                    full = np.concatenate([ends[:1], path, ends[1:]])
                    kept = smooth(grid, full, "greedy")[1:]
                apart = np.hypot(*np.diff(np.concatenate([points[-1][-1:], kept]), axis=0).T)
                points.append(kept[apart > 1e-7 * grid.cell])
                knots.append(knots[-1] + len(points[-1]))
            way = np.concatenate(points)
            empty = np.empty((0, 2))
            with stages.clock("trajectories"):
                flights.append(
                    self._flown(stages, Corridor(empty, empty, way, np.array(knots)), solver)
                )
            stops.append(np.array(knots))
        return planned(routes, flights, stops)

    def _flown(self, stages: Stages, way: Corridor, solver: Backend) -> Trajectory:
        problem = stages.problem
        if len(way.knots) < 2:
            return resting(problem, way)
        times = np.concatenate([[0.0], np.cumsum(times_along(problem, way))])
        answer = programmed(solver, MinimumSnap(way.knots, times), stages.request, 1)
        if answer.point is None:
            raise Unanswered("trajectories", answer)
        return slowed(problem, answer.point)
