"""Flights that are planned again in the air: a warm start in the corridor of an earlier plan."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval
from numpy.typing import ArrayLike, NDArray

from ... import jit
from ...errors import InvalidData, UnsupportedFormulation, UnsupportedOption
from ...models.fields import Array, show
from ...models.flight.model import Flight
from ...models.flight.plan import FlightPlan
from ...models.minimum_snap.trajectory import Trajectory
from ...models.verification import Verification
from ..contract.solution import Solution
from ..minimum_snap.minco import INSTANTS, Rows, Search, peak, powers_between
from ..minimum_snap.minco_limits import measure
from ..minimum_snap.minco_task import posed
from ..run.dispatch import solve
from .course import Course, course_of
from .minco import ends_of, engine, limits_within
from .tails import SHORTEST, curve_of, tail_of

__all__ = ["PreparedFlight", "Replan", "prepare_flight"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Reduction of the limits, relative to them, so that a few steps keep the true ones.
RESERVE = 0.03
#: Inset of the polytopes, and length of an excess 1, in cells. A few steps do not converge completely.
INSET, SIZE = 0.1, 0.3
#: Share of the effort in the objective, which conditions the search.
EFFORT = 1e-3
#: Rounds of a warm search, and evaluations per round. A search that takes longer mostly fails.
ROUNDS, EVALUATIONS = 4, 8
#: Rounds of the first search in a corridor.
FIRST = 24
#: Shares of the remaining time after which a corrected curve is on the last one again, in turn.
WINDOWS = (0.125, 0.25, 0.06, 0.5, 0.03, 1.0, 0.015)
#: Time of a search, relative to the rest of the last curve, above which a return is tried as well.
SLOW = 1.1
#: Multiples of the remaining time of a segment, which one polynomial covers if no correction fits.
SLOWER = (1.0, 1.25, 1.6, 2.2, 3.0, 5.0)
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
        Whether the curve follows the last plan in its corridor: by a search that started from it, or by a
        correction that returns to it. Otherwise the flight was planned from its map, which takes longer.
    seconds : float
        Time of the call, s.
    evaluations : int
        Evaluations of the objective.
    model : Flight
        Flight whose rest this is.
    returns : bool
        Whether the curve returns to the last plan, because the search did not keep all limits in time.
    """

    trajectory: Trajectory
    ok: bool
    warm: bool
    seconds: float
    evaluations: int
    model: Flight
    returns: bool = False

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
        allowed = np.maximum(PART * inset, LEAST * model.cell)
        limits = limits_within(model.vehicle, RESERVE)
        result = engine(model, self.course, limits=limits)
        knots = np.concatenate([result.coefficients[:, 0], result.coefficients[-1:].sum(axis=1)])
        regions, jets = ends_of(model, self.course)
        rows = Rows.of_polytopes(self.course.polytopes, SIZE * model.cell)
        weights = np.eye(model.order)[-1]
        task = posed(regions, jets, rows, limits, weights, False, INSTANTS)
        free = [region.unknowns(knot) for region, knot in zip(regions, knots, strict=True)]
        x = np.concatenate([np.log(result.durations), *free])
        search = Search(task, x, np.zeros(1, np.int8))
        true = limits_within(model.vehicle)
        self._coarse = task._replace(offset=task.offset + allowed, limits=true)
        self._fine = self._coarse._replace(basis=search.fine.basis)
        sound = self._keep(search, FIRST)
        self._store(search, sound)

    def _store(self, search: Any, sound: bool = True) -> None:
        """Keep a search, and its curve with the polytope of each segment; `sound` if it keeps all limits."""
        self._last, self._begun, self._sound = search, 0.0, sound
        self._curve = curve_of(search)
        count = len(self._coarse.nodes)
        self._owners = np.arange(count - self._curve.segments, count)

    def _keep(self, search: Any, rounds: int) -> bool:
        """Continue a search; return True as soon as it keeps all limits."""
        total, effort = float(search.durations.sum()), search.jets()[1]
        prices = 1.0 / total, EFFORT / effort if effort > 0.0 else 0.0
        owners = np.arange(len(self._coarse.nodes) - search.segments, len(self._coarse.nodes))
        for _ in range(rounds):
            search.descend(*prices, EVALUATIONS, 0.0)
            search.update()
            if self._keeps(search.durations, search.jets()[0], owners):
                return True
        return False

    def _keeps(self, durations: Floats, jets: Floats, owners: Ints) -> bool:
        """Return whether a curve keeps the limits and the polytopes `owners` at all instants."""
        task, count = self._coarse, len(durations)
        rows = np.concatenate([np.arange(*task.start[k : k + 2]) for k in owners])
        sizes = task.start[owners + 1] - task.start[owners]
        part: dict[str, Any] = {
            "nodes": np.stack([np.arange(count), np.arange(1, count + 1)], axis=1),
            "start": np.concatenate([[0], np.cumsum(sizes)]),
        }
        part |= {name: getattr(task, name)[rows] for name in ("order", "normal", "offset", "size")}
        for basis in (self._coarse, self._fine):  # most violations are found at few instants
            instants = basis.basis.shape[1]
            vehicle, excess = np.empty((count, instants, 6)), np.empty((len(rows), instants))
            measure(basis._replace(**part), durations, jets, vehicle, excess)
            if not (vehicle.max() <= 0.0 and excess.max() <= 0.0):
                return False
        values = np.concatenate([vehicle.swapaxes(1, 2).reshape(-1, instants), excess])
        # A parabola rises above its highest instant by at most 1/8 of the difference of the others.
        near = 9.0 * values.max(axis=1) > values.min(axis=1)
        return bool((peak(values[near]) <= 0.0).all())

    def replan(
        self,
        position: ArrayLike,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> Replan:
        """Plan the rest of the flight from a state in the air.

        The search starts from the last plan, in the rest of its corridor. If it does not keep all limits in
        a few rounds, the curve returns to the last plan by a correction of the state. If no correction fits,
        or the state is outside the corridor, the flight is planned from the map.

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
        at = self._nearest(state[0])
        search, kept, returns = None, False, False
        if at is not None:
            search = self._tail(state, at)
            kept = self._keep(search, ROUNDS)
            total = float(search.durations.sum()) if kept else np.inf
            if total > SLOW * (self._curve.times[-1] - at):
                returns = self._returned(state, at, total)
            if kept and not returns:
                self._store(search)
        warm = kept or returns
        curve = self._curve if warm else self._planned(state)
        kept = curve is not None
        if curve is None:
            if search is None:
                raise UnsupportedFormulation(
                    f"position must be in the corridor or have a way to the goal, got {show(position)}"
                )
            warm, curve = True, curve_of(search)
        seconds = time.perf_counter() - begin
        count = self._last.evaluations if search is None else search.evaluations
        return Replan(curve, kept, warm, seconds, count, self.model, returns)

    def _planned(self, state: Floats) -> Trajectory | None:
        """Plan the rest of the flight from its map; None without a verified plan."""
        passed = int(self._owners[0])
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

    def _nearest(self, position: Floats) -> float | None:
        """Return the time of the last curve next to a position, over segments whose polytope contains it."""
        task, curve = self._coarse, self._curve
        excess = task.normal @ position - task.offset
        inside = np.maximum.reduceat(excess, task.start[:-1])[self._owners] <= 0.0
        if not inside.any():
            return None
        segments = np.flatnonzero(inside)
        powers = curve.coefficients[segments]
        s = np.linspace(0.0, 1.0, SAMPLES, endpoint=False)
        places = np.einsum("sp,kpd->ksd", s[:, None] ** np.arange(powers.shape[1]), powers)
        apart = ((places - position) ** 2).sum(axis=2)
        k, n = (int(index) for index in np.unravel_index(int(apart.argmin()), apart.shape))
        slope = (
            np.arange(powers.shape[1]) * s[n] ** np.maximum(np.arange(powers.shape[1]) - 1, 0)
        ) @ powers[k]
        step = float((position - places[k, n]) @ slope) / max(float(slope @ slope), 1e-300)
        share = float(np.clip(s[n] + np.clip(step, -1.0 / SAMPLES, 1.0 / SAMPLES), 0.0, 1.0))
        return float(curve.times[segments[k]] + share * curve.durations[segments[k]])

    def _tail(self, state: Floats, at: float) -> Any:
        """Return the search for the rest of the last one after a time of the last curve."""
        search = self._last
        piece = min(int(np.searchsorted(self._curve.times, at, "right")), self._curve.segments) - 1
        k = int(self._owners[piece]) - (len(self._coarse.nodes) - search.segments)
        begin = at + self._begun - float(search.durations[:k].sum())
        return tail_of(search, k, float(np.clip(begin / search.durations[k], 0.0, 1.0)), state)

    def _returned(self, state: Floats, at: float, most: float) -> bool:
        """Store the last curve with a correction of its state at a time; return False without one.

        It lasts at most `most` seconds.

        The correction is the polynomial that vanishes with its derivatives after a window of time.
        """
        last, order = self._curve, self.model.order
        left, first = float(last.times[-1]) - at, int(np.searchsorted(last.times, at, "right"))
        knots = np.append(at, last.times[first:])
        course = np.stack([last(knots, i) for i in range(order)], axis=1)
        gap = np.zeros((1, 2, order, len(state[0])))
        gap[0, 0, :3] = state[:order] - course[0, :3]
        for share in WINDOWS if self._sound and left > 0.0 else ():
            # The window ends at a knot, or at a new one that is not next to it.
            times, jets, end = knots, course.copy(), at + share * left
            count = min(int(np.searchsorted(times, end)), len(times) - 1)
            if times[count] - end > SHORTEST * share * left:
                times = np.insert(times, count, end)
                jets = np.insert(jets, count, [last(end, i) for i in range(order)], axis=0)
            pieces = np.searchsorted(last.times, times[:-1], "right") - 1
            durations, owners = np.diff(times), self._owners[pieces]
            begun = owners[1:count][np.diff(owners[:count]) > 0]
            if np.isin(begun, self.course.stops[1:-1]).any():
                continue  # the correction would move the curve away from a waypoint
            length = times[count] - at
            powers = powers_between(np.array([length]), gap)[0]
            s = (times[: count + 1] - at) / length
            for i in range(order):
                jets[: count + 1, i] += polyval(s, polyder(powers, i)).T / length**i
            if self._keeps(durations[:count], jets[: count + 1], owners[:count]):
                return self._follow(durations, jets, owners, at)
        durations, owners, jets = np.diff(knots), self._owners[first - 1 :], course
        jets[0] += gap[0, 0]
        for factor in SLOWER if self._sound and left > 0.0 else ():
            durations[0] = factor * (knots[1] - at)
            if durations.sum() <= most and self._keeps(durations[:1], jets[:2], owners[:1]):
                return self._follow(durations, jets, owners, at - (factor - 1.0) * (knots[1] - at))
        return False

    def _follow(self, durations: Floats, jets: Floats, owners: Ints, skipped: float) -> bool:
        """Store a curve that meets the last one, whose time is later by `skipped`; return True."""
        times = np.concatenate([[0.0], np.cumsum(durations)])
        ends = np.stack([jets[:-1], jets[1:]], axis=1)
        self._curve, self._owners = Trajectory(times, powers_between(durations, ends)), owners
        self._begun += skipped
        return True


def prepare_flight(model: Flight, **options: Any) -> PreparedFlight:
    """Plan a flight and prepare it for replanning; options are refused."""
    if options:
        raise UnsupportedOption(
            f"prepare accepts no options for a flight, got {', '.join(options)}"
        )
    return PreparedFlight(model)
