"""The independent check of a mission, end to end: of the curves in time, against the polygons.

It shares nothing with planners: no grid is used. Distances are shapely's, and what is said of a
curve is proven for all of it, by the hulls of pieces that are halved until they are decided.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import required
from ..fleet.checks import objective_of
from ..minimum_snap.bounds import derivative_name, derivative_unit
from ..minimum_snap.polynomials import factorials
from ..minimum_snap.trajectory import Trajectory
from ..verification import Check, Verification, check_tolerance
from .collision import deepest
from .curves import lengths_of, nearest, pieces_of
from .data import MissionData
from .plan import MissionPlan

__all__ = ["verify_mission"]

Floats = NDArray[np.float64]

#: Digits that coordinates leave of a position.
DIGITS = 1e-13
#: Share of the tolerance of a distance that the search for the least distance may leave open.
SEARCHED = 0.01
#: Units in the last place of the terms of a derivative at a knot that its rounding may reach.
ULPS = 16 * float(np.finfo(float).eps)
#: Greatest derivatives of the polynomial of degree 7 that steps from rest to rest in a unit of time.
STEPS = (1.0, 35.0 / 16.0, 7.52, 52.5)


class Worst:
    """The violation that uses up most of its tolerance, of many that one check is about."""

    def __init__(self, name: str, unit: str, tolerance: float, equation: str = "") -> None:
        self.name, self.unit, self.tolerance, self.equation = name, unit, tolerance, equation
        self.found: tuple[float, float, float, str, float | None] = (0.0, 0.0, 0.0, "", None)
        self.share = -1.0

    def add(
        self, values: Any, where: Any, scale: Any, noise: Any = 0.0, limit: float | None = None
    ) -> None:
        """Take note of violations; `where` is a function of an index, or a text."""
        value, scales, noises = np.broadcast_arrays(
            np.atleast_1d(np.asarray(values, float)), scale, noise
        )
        if not value.size:
            return
        share = np.maximum(value, 0.0) / np.maximum(self.tolerance * scales + noises, 1e-300)
        share = np.where(np.isnan(share), np.inf, share)  # what is no number is worst of all
        k = int(np.argmax(share))
        if share[k] > self.share:
            worst = float(value[k])
            self.share = float(share[k])
            self.found = (
                worst if np.isnan(worst) else max(worst, 0.0),
                float(scales[k]), float(noises[k]), where if isinstance(where, str) else where(k),
                limit,
            )  # fmt: skip

    def check(self) -> Check:
        """Return the check."""
        worst, scale, noise, where, limit = self.found
        return Check.scaled(
            self.name, self.equation, worst, self.unit, where, self.tolerance, scale, noise=noise,
            limit=limit,
        )  # fmt: skip


def verify_mission(model: MissionData, plan: MissionPlan, tolerance: float) -> Verification:
    """Return the objective of `plan` and every constraint of `model`."""
    check_tolerance(tolerance)
    required("plan", plan, MissionPlan)
    for k, route in enumerate(plan.routes):
        for stop, node in enumerate(route):
            if not 0 <= node < len(model.nodes):
                raise InvalidData(
                    f"routes[{k}][{stop}] must lie in 0 … {len(model.nodes) - 1}, got {node}",
                    field="routes",
                )
    flown = [(k, one) for k, one in enumerate(plan.trajectories) if one is not None]
    checks = [
        *_counts(model, plan),
        *_places(model, plan, flown, tolerance),
        *_knots(model, flown, tolerance),
        *_limits(model, flown, tolerance),
        _inside(model, flown, tolerance),
        _collision(model, flown, tolerance),
        _separation(model, flown, tolerance),
    ]
    if len(plan.routes) != model.vehicles:
        return Verification(None, tuple(checks))
    loads = np.zeros(model.vehicles)
    for k, one in flown:
        loads[k] = lengths_of(one).sum()
    # A range of nearly equal lengths is held against the lengths.
    scale = float(loads.mean()) if model.objective == "range" else 0.0
    # Objective, q and deviation are fields of both models, and no more is read.
    objective = objective_of(model, loads)  # type: ignore[arg-type]
    return Verification(objective, tuple(checks), scale=scale)


def _counts(model: MissionData, plan: MissionPlan) -> Iterator[Check]:
    def count(name: str, number: int, where: str) -> Check:
        return Check(name, "", float(number), "", 0.0, where, 0.0)

    met = np.bincount(
        np.array([node for route in plan.routes for node in route], int),
        minlength=len(model.nodes),
    )
    wrong = np.flatnonzero(met != 1)
    empty = [k for k, route in enumerate(plan.routes) if not route]
    lacking = [
        k for k, (r, t) in enumerate(zip(plan.routes, plan.trajectories, strict=True))
        if bool(r) == (t is None)
    ]  # fmt: skip
    where = f"node {model.label(int(wrong[0]))}" if wrong.size else ""
    yield count("one route for each robot", abs(len(plan.routes) - model.vehicles), "")
    yield count("each node visited once", wrong.size, where)
    yield count("every robot used", len(empty), f"robot {empty[0]}" if empty else "")
    where = f"robot {lacking[0]}" if lacking else ""
    yield count("a trajectory for each route", len(lacking), where)


def _digits(model: MissionData) -> float:
    """Return what rounding leaves of a position, m."""
    return DIGITS * float(np.abs(model.bounds).max())


def _places(
    model: MissionData, plan: MissionPlan, flown: list[tuple[int, Trajectory]], tolerance: float
) -> Iterator[Check]:
    """Yield the checks of nodes passed in their order, and of both ends."""
    noise = _digits(model)
    # The time for a cell at the lower limit of velocity.
    pause = _scale(model, 0) / _scale(model, 1)
    passed = Worst("nodes passed at their times", "m", tolerance, "24")
    late = Worst("visits in order", "s", tolerance)
    ends = Worst("begins and ends at the depot", "m", tolerance)
    rest = [
        Worst(
            f"{derivative_name(j)} 0 at both ends", derivative_unit(j), tolerance, _printed("23", j)
        )
        for j in range(1, model.continuity + 1)
    ]
    for k, one in flown:
        times = plan.visits[k]
        allowed = np.clip(times, one.times[0], one.times[-1])
        stops = np.concatenate([one.times[:1], times, one.times[-1:]])
        late.add(
            -np.diff(stops), lambda s, k=k: f"robot {k}, stop {s}", pause,
            ULPS * float(np.abs(one.times).max()),
        )  # fmt: skip
        if len(times):
            nodes = np.array(plan.routes[k], int)
            off = np.hypot(*(one(allowed) - model.nodes[nodes]).T)

            def place(s: int, nodes: Any = nodes, times: Any = times, k: int = k) -> str:
                return f"robot {k}, node {model.label(int(nodes[s]))} (t = {times[s]:.6g} s)"

            passed.add(off, place, model.cell, noise)
        begin, end = (side[row] for side, row in zip(one.at_ends(), (0, -1), strict=True))
        gaps = np.hypot(*(np.stack([begin, end]) - model.depot).T)
        ends.add(gaps, lambda s, k=k: f"robot {k}, {('start', 'end')[s]}", model.cell, noise)
        for order, check in enumerate(rest, start=1):
            first, last = one.at_ends(order)
            own = _noise(one, order)
            values = np.abs(np.stack([first[0], last[-1]])).max(axis=1)
            scale = _scale(model, order)
            check.add(
                values, lambda s, k=k: f"robot {k}, {('start', 'end')[s]}", scale,
                np.stack([own[0], own[-1]]).max(axis=1),
            )  # fmt: skip
    yield from (one.check() for one in (passed, late, ends, *rest))


def _printed(equation: str, order: int) -> str:
    """Return the number of an equation of the paper, empty for the jerk, which the paper leaves free."""
    return equation if order <= 2 else ""


def _scale(model: MissionData, order: int) -> float:
    """Return what a derivative is held against: the limits, and for a jerk what follows from them."""
    speed, push = float(model.velocity_limit.min()), float(model.acceleration_limit.min())
    return (model.cell, speed, push, push * push / speed)[order]


def _noise(one: Trajectory, order: int) -> Floats:
    """Return what the coefficients can hold of a derivative at knots, shape (segments, 2)."""
    if order > one.degree:
        return np.zeros((one.segments, 2))
    sizes = np.einsum(
        "p,kpd->kd", factorials(one.degree, order), np.abs(one.coefficients[:, order:])
    )
    # The last digits of positions are steps, which smooth curves follow.
    sizes += STEPS[order] * np.abs(one.coefficients[:, 0])
    return np.asarray(ULPS * sizes * (one.durations**-order)[:, None])


def _knots(
    model: MissionData, flown: list[tuple[int, Trajectory]], tolerance: float
) -> Iterator[Check]:
    """Yield the checks of jumps at knots, from the position to the derivative `continuity`."""
    for order in range(model.continuity + 1):
        name, unit = f"continuity of {derivative_name(order)}", derivative_unit(order)
        found = Worst(name, unit, tolerance, _printed("25", order))
        for k, one in flown:
            begin, end = one.at_ends(order)
            own = _noise(one, order)
            jump = np.abs(end[:-1] - begin[1:])
            scale: Any = _scale(model, order)
            if order == 3:
                # Jerk has no limit: what it is at the knot counts, and little of what it is elsewhere.
                at_knot = np.maximum(np.abs(end[:-1]), np.abs(begin[1:]))
                scale = np.maximum(at_knot, 1e-2 * np.abs(begin).max(axis=0))
                scale = np.broadcast_to(np.minimum(scale, _scale(model, 3) * 1e3), jump.shape)
                scale = scale.ravel()
            found.add(
                jump.ravel(),
                lambda s, k=k, one=one: (
                    f"robot {k}, knot {s // 2 + 1} (t = {one.times[s // 2 + 1]:.6g} s)"
                ),
                scale,
                (own[:-1] + own[1:]).ravel() + (_digits(model) if order == 0 else 0.0),
            )
        yield found.check()


def _limits(
    model: MissionData, flown: list[tuple[int, Trajectory]], tolerance: float
) -> Iterator[Check]:
    """Yield the checks of velocity and acceleration, at their exact extremes."""
    for order, limits in ((1, model.velocity_limit), (2, model.acceleration_limit)):
        name = derivative_name(order)
        found = Worst(f"{name} within its limit", derivative_unit(order), tolerance)
        for k, one in flown:
            extremes = one.extremes(order)
            sizes = np.maximum(-extremes.least, extremes.largest)
            late = extremes.largest >= -extremes.least
            times = np.where(late, extremes.largest_time, extremes.least_time)
            over = sizes - limits
            row = np.nanargmax(over / limits, axis=0) if np.isfinite(over).any() else [0, 0]
            for axis in (0, 1):
                s = int(row[axis])
                found.add(
                    over[s, axis], f"robot {k}, axis {axis} (t = {times[s, axis]:.6g} s)",
                    float(limits[axis]), 0.0, float(limits[axis]),
                )  # fmt: skip
        yield found.check()


def _inside(model: MissionData, flown: list[tuple[int, Trajectory]], tolerance: float) -> Check:
    """Return the check that the curves keep to the bounds, at their exact extremes."""
    found = Worst("inside the bounds", "m", tolerance)
    low, high = model.bounds[:2], model.bounds[2:]
    for k, one in flown:
        extremes = one.extremes(0)
        over = np.maximum(low - extremes.least, extremes.largest - high)
        found.add(
            over.ravel(), lambda s, k=k: f"robot {k}, segment {s // 2}", model.cell, _digits(model)
        )
    return found.check()


def _collision(model: MissionData, flown: list[tuple[int, Trajectory]], tolerance: float) -> Check:
    """Return the check of the distance that the curves keep from the obstacles."""
    found = Worst("radius away from obstacles", "m", tolerance)
    slack = tolerance * model.cell + _digits(model)
    if not flown:
        return found.check()
    depth, robot, time, place = deepest(
        [pieces_of(one, k) for k, one in flown], model.solids, model.radius, slack, model.cell
    )
    where = (
        f"robot {robot} (t = {time:.6g} s), x {place[0]:.6g}, y {place[1]:.6g} m"
        if depth > 0
        else ""
    )
    found.add(depth, where, model.cell, _digits(model), model.radius or None)
    return found.check()


def _separation(model: MissionData, flown: list[tuple[int, Trajectory]], tolerance: float) -> Check:
    """Return the check of the distances of robots under way; only reported if none is required.

    A robot waits in the depot's queue before its departure and after its return, off the map. There
    is no other exemption.
    """
    required_ = model.separation > 0
    name = "distance between robots" if required_ else "separation not required"
    found = Worst(name, "m", tolerance)
    # The search may overestimate the distance by its slack, which adds to the tolerance.
    slack = SEARCHED * (tolerance * model.cell + _digits(model))
    near = nearest([one for _, one in flown], slack)
    where = "never two under way at one time"
    if np.isfinite(near.distance):
        a, b = (flown[k][0] for k in near.pair)
        where = f"robots {a} and {b} (t = {near.time:.6g} s), {near.distance:.6g} m apart"
    where += "; before departure and after return robots wait in the depot's queue"
    over = max(model.separation - near.distance, 0.0)
    found.add(over, where, model.cell, 2 * _digits(model), model.separation or None)
    return found.check()
