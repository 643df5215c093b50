"""Shared stages of the mission pipelines, up to the curves, with their times."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import jit
from ...errors import CrosstrackError, UnsupportedOption
from ...models.fleet.data import Objective
from ...models.fleet.model import FleetRouting
from ...models.fleet.plan import FleetPlan
from ...models.fleet_mission.data import MissionObjective
from ...models.fleet_mission.model import FleetMission
from ...models.fleet_mission.plan import MissionPlan
from ...models.grid_path.model import Connectivity, GridPath
from ...models.minimum_snap.trajectory import Trajectory
from ...models.model import Model
from ...models.problems import problem_of
from ..contract.backend import Answer, Backend, Limit, Request, Termination
from ..contract.registry import find_backend

__all__ = ["Stages", "Unanswered", "planned", "taking"]

Floats = NDArray[np.float64]


class Unanswered(CrosstrackError):
    """Internal exception of a stage without an answer, which ends the run."""

    def __init__(self, stage: str, answer: Answer) -> None:
        super().__init__(stage)
        self.stage, self.answer = stage, answer

    def ended(self, request: Request, statistics: Mapping[str, Any]) -> Answer:
        """Return the answer of the whole run."""
        limit = self.answer.limit or request.control.reason
        message = f"{self.stage}: {self.answer.message or self.answer.termination}"
        return Answer(Termination.NO_SOLUTION, limit, statistics=dict(statistics), message=message)


def taking(option: str, name: str, kind: type[Model[Any]], *programs: type[Model[Any]]) -> Backend:
    """Return the backend named by an option, for models of type `kind` or of one of `programs`.

    Raises
    ------
    UnsupportedOption
        The backend accepts none of these types.
    """
    backend = find_backend(name, problem=problem_of(kind.kind))
    accepted = backend.accepts if isinstance(backend.accepts, tuple) else (backend.accepts,)
    kinds = [entry for entry in (kind, *programs) if entry.kind not in backend.integral_only]
    if not any(issubclass(entry, accepted) for entry in kinds):
        raise UnsupportedOption(
            f"option {option!r} must name a backend for {kind.kind}, got {name!r}, which takes "
            f"{backend.accepted_kinds()}"
        )
    return backend


@dataclass
class Stages:
    """State of a pipeline run: its statistics and the times of its stages."""

    problem: FleetMission
    request: Request
    statistics: dict[str, float | int | str] = field(default_factory=dict)
    paths: dict[tuple[int, int], Floats] = field(default_factory=dict)

    @contextmanager
    def clock(self, stage: str) -> Iterator[None]:
        """Add the time of a stage, s, to the statistics."""
        begin = jit.clock()
        try:
            yield
        finally:
            name = f"{stage} seconds"
            spent = float(self.statistics.get(name, 0.0)) + jit.clock() - begin
            self.statistics[name] = spent

    def routed(self, backend: Backend, seconds: float | None, costs: Floats) -> FleetPlan:
        """Return routes over the places (0 the depot, then the nodes), within `seconds` if given.

        `costs`, shape (n + 1, n + 1), is the length or energy of each leg, m. Raise `Unanswered` without
        feasible routes.
        """
        problem = self.problem
        q = problem.q if problem.objective.startswith("sum-") else 0.0
        # The return of the last robot depends on the longest route.
        is_time = problem.objective is MissionObjective.MAKESPAN
        objective = Objective.LEXICOGRAPHIC if is_time else Objective(problem.objective)
        routing = FleetRouting(
            problem.vehicles, costs=costs, depots=np.zeros(1, np.int64), objective=objective, q=q,
            deviation=problem.deviation,
        )  # fmt: skip
        with self.clock("routing"):
            answer = self.request.within(backend, routing, time_limit=seconds)
        routes = answer.point
        if routes is None and seconds is not None and answer.limit is not None:
            routes = _split(costs, problem.vehicles)
        checked = None if routes is None else routing.verify(routes)
        if checked is None or not checked.ok:
            raise Unanswered("routing", answer)
        self.statistics["routing objective"] = float(checked.objective or 0.0)
        assert isinstance(routes, FleetPlan)
        return routes

    def path(self, backend: Backend, start: int, goal: int, connectivity: Connectivity) -> Floats:
        """Return a path between two places (0 the depot, then the nodes), from cell to cell, m."""
        key, back = (start, goal), (goal, start)
        if back in self.paths:
            return self.paths[back][::-1]
        if key not in self.paths:
            grid = self.problem.map
            cells = self.problem.cells
            leg = GridPath(grid, cells[start], cells[goal], connectivity=connectivity)
            answer = self.request.within(backend, leg)
            if answer.point is None or not leg.verify(answer.point).ok:
                raise Unanswered("paths", answer)
            self.paths[key] = answer.point.paths[0]
        return self.paths[key]

    @property
    def slack(self) -> float:
        """Accuracy of proven distances between robots, m."""
        return 1e-3 * self.request.tolerance * self.problem.cell

    def stopped(self) -> Limit | None:
        """Return the limit that ends the run, or None while it may continue."""
        return self.request.control.limit


def _split(costs: Floats, vehicles: int) -> FleetPlan:
    """Return a nearest-neighbour tour cut into routes of equal numbers of nodes, for a run without time."""
    left, at, tour = set(range(1, len(costs))), 0, []
    while left:
        at = min(left, key=lambda node: (costs[at, node], node))
        left.remove(at)
        tour.append(at)
    return FleetPlan(tuple(tuple(part.tolist()) for part in np.array_split(tour, vehicles)))


def planned(
    routes: FleetPlan, flights: list[Trajectory], stops: list[NDArray[np.int64]]
) -> MissionPlan:
    """Return the mission plan of routes over places (nodes from 1, 0 is the depot), one trajectory per robot.

    `stops` are the knots at the depot, the nodes and the depot again.
    """
    return MissionPlan(
        tuple(tuple(node - 1 for node in route) for route in routes.routes),
        tuple(flights),
        tuple(entry.times[knots[1:-1]] for entry, knots in zip(flights, stops, strict=True)),
    )
