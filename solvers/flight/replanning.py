"""Flights that are planned again in the air: a warm start in the corridor of an earlier plan."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ... import jit
from ...errors import InvalidData, UnsupportedFormulation, UnsupportedOption
from ...models.fields import Array, show
from ...models.flight.model import Flight
from ...models.flight.plan import FlightPlan
from ...models.minimum_snap.trajectory import Trajectory
from ...models.verification import Verification
from ..contract.solution import Solution
from ..minimum_snap.minco import INSTANTS, Rows, Search, coefficients_of
from ..minimum_snap.minco_limits import Task
from ..minimum_snap.minco_task import posed
from ..run.dispatch import solve
from .course import Course, course_of
from .minco import ends_of, engine, limits_within

__all__ = ["PreparedFlight", "Replan", "prepare_flight"]

Floats = NDArray[np.float64]

#: Reduction of the limits, relative to them, so that a few steps keep the true ones.
RESERVE = 0.03
#: Inset of the polytopes, and length of an excess 1, in cells. A few steps do not converge completely.
INSET, SIZE = 0.1, 0.3
#: Share of the effort in the objective, which conditions the search.
EFFORT = 1e-3
#: Rounds of a warm search, and evaluations per round.
ROUNDS, EVALUATIONS = 12, 8
#: Rounds of the first search in a corridor.
FIRST = 24
#: Least duration of the first segment, relative to the mean.
SHORTEST = 0.05
#: Share of the inset that a curve may use, and least excess that it may have, in cells.
PART, LEAST = 0.99, 1e-7
#: Samples of the last curve per segment, to find the position on it.
SAMPLES = 32


@dataclass(frozen=True)
class Replan:
    """Flight from a state in the air to the goal.

    Parameters
    ----------
    trajectory : Trajectory
        Curve from the state, which is at time 0.
    ok : bool
        Whether no violation of limits and corridor was found. After a warm start they are checked at 128
        instants per segment, with parabolas in between, which is no proof. :meth:`verification` proves it for
        all instants. A plan from the map is verified.
    warm : bool
        Whether the search started from the last plan in its corridor. Otherwise the flight was planned
        from its map, which takes longer.
    seconds : float
        Time of the call, s.
    evaluations : int
        Evaluations of the objective.
    model : Flight
        Flight whose rest this is.
    """

    trajectory: Trajectory
    ok: bool
    warm: bool
    seconds: float
    evaluations: int
    model: Flight

    def verification(self) -> Verification:
        """Verify the curve at every instant as a flight from its first state, without waypoints."""
        curve = self.trajectory
        position, velocity, push = (curve(curve.times[0], order) for order in range(3))
        rest = replace(
            self.model,
            start=position,
            start_velocity=velocity,
            start_acceleration=push,
            waypoints=(),
        )
        return rest.verify(FlightPlan(curve))


class PreparedFlight:
    """Flight with its plan and corridor, to plan it again from states in the air.

    Parameters
    ----------
    model : Flight
        The flight.

    Attributes
    ----------
    solution : Solution
        Solution of the whole flight.

    Raises
    ------
    UnsupportedFormulation
        The flight has moving obstacles, no plan, coinciding places or no corridor, because its path
        touches an obstacle.
    """

    def __init__(self, model: Flight) -> None:
        if model.moving:
            raise UnsupportedFormulation("prepare takes flights without moving obstacles")
        jit.compile_always()
        self.model = model
        self.solution: Solution[FlightPlan] = solve(model, backend="minco")
        plan = self.solution.plan
        if plan is None or plan.path is None or not np.ptp(plan.path, axis=0).any():
            raise UnsupportedFormulation(
                f"prepare takes flights with a plan between different places, got "
                f"{self.solution.termination}: {self.solution.message}"
            )
        try:
            self._begin(model, plan.path)
        except InvalidData as error:
            raise UnsupportedFormulation(
                f"prepare takes flights with a corridor: {error}"
            ) from None

    def _begin(self, model: Flight, path: Floats) -> None:
        """Compute the corridor along a path, and a first curve within tightened limits."""
        apart = np.linalg.norm(path[:, None] - model.places, axis=2)
        stops = np.maximum.accumulate(np.argmin(apart, axis=0))
        whole = course_of(model, path, stops, 0.0)
        self.course: Course = whole.narrowed(model, INSET)
        pairs = zip(whole.polytopes, self.course.polytopes, strict=True)
        # Faces at the places of the flight have a smaller inset.
        inset = np.concatenate([outer - inner for (_, outer), (_, inner) in pairs])
        self._allowed = np.maximum(PART * inset, LEAST * model.cell)
        result = engine(model, self.course, limits=limits_within(model.vehicle, RESERVE))
        knots = np.concatenate([result.coefficients[:, 0], result.coefficients[-1:].sum(axis=1)])
        regions, jets = ends_of(model, self.course)
        rows = Rows.of_polytopes(self.course.polytopes, SIZE * model.cell)
        limits = limits_within(model.vehicle, RESERVE)
        weights = np.eye(model.order)[-1]
        task = posed(regions, jets, rows, limits, weights, False, INSTANTS)
        free = [region.unknowns(knot) for region, knot in zip(regions, knots, strict=True)]
        flag = np.zeros(1, np.int8)
        search = Search(task, np.concatenate([np.log(result.durations), *free]), flag)
        self._keep(search, FIRST)

    def _keep(self, search: Any, rounds: int) -> bool:
        """Continue a search and store it for the next one; return whether all limits are kept."""
        total, effort = float(search.durations.sum()), search.jets()[1]
        prices = 1.0 / total, EFFORT / effort if effort > 0.0 else 0.0
        true = limits_within(self.model.vehicle)
        for _ in range(rounds):
            search.descend(*prices, EVALUATIONS, 0.0)
            search.update()
            kept = self._is_kept(search, true)
            if kept:
                break
        self._last = search
        return kept

    def _is_kept(self, search: Any, limits: Floats) -> bool:
        """Return whether the true limits and polytopes are kept at all instants of the fine grid."""
        fine = search.fine
        search.fine = fine._replace(limits=limits)
        vehicle, rows = search.peaks()
        search.fine = fine
        excess = rows * SIZE * self.model.cell - self._allowed[-len(rows) :]
        return bool(vehicle.max() <= 0.0 and excess.max() <= 0.0)

    def replan(
        self,
        position: ArrayLike,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> Replan:
        """Plan the rest of the flight from a state in the air.

        The search starts from the last plan, in the rest of its corridor. A state outside the corridor
        is planned from the map.

        Parameters
        ----------
        position : array_like, shape (axes,)
            Position in metres.
        velocity, acceleration : array_like, shape (axes,), optional
            Velocity (m/s) and acceleration (m/s²); 0 by default.

        Returns
        -------
        Replan
            Curve to the goal, and whether it keeps all limits.

        Raises
        ------
        InvalidData
            A value is not finite or has another shape, or the state is not allowed: in an obstacle, out
            of bounds, or beyond the limits of the vehicle.
        UnsupportedFormulation
            The state is outside the corridor, and no plan from it was found on the map.
        """
        begin = time.perf_counter()
        spec, zero = Array((self.model.dimensions,)), np.zeros(self.model.dimensions)
        given = {"position": position, "velocity": velocity, "acceleration": acceleration}
        state = np.stack(
            [spec.coerce(name, zero if x is None else x, {}) for name, x in given.items()]
        )
        former = self._last
        search = self._tail(state)
        kept = warm = search is not None and self._keep(search, ROUNDS)
        if not kept:
            self._last = former  # a failed search is no start for the next one
            curve = self._planned(state)
            if curve is not None:
                seconds = time.perf_counter() - begin
                return Replan(curve, True, False, seconds, self._last.evaluations, self.model)
        if search is None:
            raise UnsupportedFormulation(
                f"position must be in the corridor or have a way to the goal, got {show(position)}"
            )
        times = np.concatenate([[0.0], np.cumsum(search.durations)])
        curve = Trajectory(times, coefficients_of(search, search.jets()[0]))
        seconds = time.perf_counter() - begin
        return Replan(curve, kept, warm, seconds, search.evaluations, self.model)

    def _planned(self, state: Floats) -> Trajectory | None:
        """Plan the rest of the flight from its map; None without a verified plan."""
        passed = len(self.course.knots) - len(self._last.task.kind)
        rest = self.course.stops[1:-1] > passed
        model = replace(
            self.model, start=state[0], start_velocity=state[1], start_acceleration=state[2],
            waypoints=self.model.waypoints[rest],
        )  # fmt: skip
        solution = solve(model, backend="minco")
        plan = solution.plan
        if plan is None:
            return None
        if plan.path is not None and np.ptp(plan.path, axis=0).any():
            with suppress(InvalidData):  # a path that touches an obstacle has no corridor
                self._begin(model, plan.path)
                self.model = model
        return plan.trajectory

    def _tail(self, state: Floats) -> Any:
        """Return the search for the rest of the last one; None if the state is outside its corridor."""
        search = self._last
        k, share = self._place(state[0], search)
        result = _tail(search, k, share, state)
        task = result.task
        rows = slice(0, int(task.start[1]))
        allowed = task.offset[rows] + self._allowed[-len(task.offset) :][rows]
        return result if (task.normal[rows] @ state[0] <= allowed).all() else None

    def _place(self, position: Floats, search: Any) -> tuple[int, float]:
        """Return the segment of the last curve next to a position, and the share of it that is flown."""
        powers = coefficients_of(search, search.jets()[0])
        s = np.linspace(0.0, 1.0, SAMPLES, endpoint=False)
        places = np.einsum("sp,kpd->ksd", s[:, None] ** np.arange(powers.shape[1]), powers)
        apart = ((places - position) ** 2).sum(axis=2)
        k, n = (int(index) for index in np.unravel_index(int(apart.argmin()), apart.shape))
        slope = (
            np.arange(1.0, powers.shape[1])
            * s[n] ** np.arange(powers.shape[1] - 1.0)
            @ powers[k, 1:]
        )
        step = float((position - places[k, n]) @ slope) / max(float(slope @ slope), 1e-300)
        return k, float(np.clip(s[n] + np.clip(step, -1.0 / SAMPLES, 1.0 / SAMPLES), 0.0, 1.0))


def _tail(search: Any, k: int, share: float, state: Floats) -> Any:
    """Return the search for the segments from number k, whose first knot has a given state."""
    task: Task = search.task
    segments = len(task.nodes)
    durations = search.durations[k:]
    left = (1.0 - share) * float(durations[0])
    if left < SHORTEST * float(durations.mean()):
        rows = slice(int(task.start[k + 1]), int(task.start[min(k + 2, segments)]))
        passes = k + 1 < segments and task.first[k + 2] > task.first[k + 1]  # no waypoint
        if passes and (task.normal[rows] @ state[0] <= task.offset[rows]).all():
            k, left = k + 1, left + float(durations[1])  # the rest is part of the next segment
        else:
            left = SHORTEST * float(durations.mean())
    first, row = int(task.first[k + 1]), int(task.start[k])
    jets, free = task.jets[k:].copy(), task.free[k:].copy()
    jets[0, :3], free[0] = state[: jets.shape[1]], False
    if jets.shape[1] > 3:
        jets[0, 3:] = 0.0
        free[0, 3:] = True
    kind, centre = task.kind[k:].copy(), task.centre[k:].copy()
    kind[0], centre[0] = 0, state[0]
    rest = task._replace(
        nodes=task.nodes[: segments - k], place=task.place[: segments - k + 1], jets=jets, free=free,
        kind=kind, first=np.append(0, task.first[k + 1 :] - first), centre=centre,
        reach=task.reach[first:], start=task.start[k:] - row, order=task.order[row:],
        normal=task.normal[row:], offset=task.offset[row:], size=task.size[row:],
    )  # fmt: skip
    x = np.concatenate([search.x[k:segments], search.x[segments + first :]])
    x[0] = np.log(left)
    result = Search(rest, x, search.flag)
    result.vehicle, result.rows = search.vehicle[k:].copy(), search.rows[row:].copy()
    result.margins = search.margins[0][k:].copy(), search.margins[1][row:].copy()
    return result


def prepare_flight(model: Flight, **options: Any) -> PreparedFlight:
    """Plan a flight and prepare it for replanning; options are refused."""
    if options:
        raise UnsupportedOption(
            f"prepare accepts no options for a flight, got {', '.join(options)}"
        )
    return PreparedFlight(model)
