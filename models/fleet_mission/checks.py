"""Independent check of a mission: the curves over time against the polygons.

The check shares no code with the planners and uses no grid. Distances are computed by shapely. Each
property is proven for the whole curve by convex hulls of pieces, which are bisected until decided.
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

#: Relative rounding error of positions.
DIGITS = 1e-13
#: Accuracy of the search for the least distance, as a share of the distance tolerance.
SEARCHED = 0.01
#: Relative rounding error of a derivative at a knot, with respect to its terms.
ULPS = 16 * float(np.finfo(float).eps)
#: Largest derivatives of the unit rest-to-rest step, a polynomial of degree 7 on a unit of time.
STEPS = (1.0, 35.0 / 16.0, 7.52, 52.5)


class Worst:
    """Largest violation of one check, relative to its tolerance."""

    def __init__(self, name: str, unit: str, tolerance: float, equation: str = "") -> None:
        self.name, self.unit, self.tolerance, self.equation = name, unit, tolerance, equation
        self.found: tuple[float, float, float, str, float | None] = (0.0, 0.0, 0.0, "", None)
        self.share = -1.0

    def add(
        self, values: Any, where: Any, scale: Any, noise: Any = 0.0, limit: float | None = None
    ) -> None:
        """Add violations; `where` is a text or a function of the index."""
        value, scales, noises = np.broadcast_arrays(
            np.atleast_1d(np.asarray(values, float)), scale, noise
        )
        if not value.size:
            return
        share = np.maximum(value, 0.0) / np.maximum(self.tolerance * scales + noises, 1e-300)
        share = np.where(np.isnan(share), np.inf, share)  # NaN is the largest violation
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
        """Return the check of the largest violation."""
        worst, scale, noise, where, limit = self.found
        return Check.scaled(
            self.name, self.equation, worst, self.unit, where, self.tolerance, scale, noise=noise,
            limit=limit,
        )  # fmt: skip


def verify_mission(model: MissionData, plan: MissionPlan, tolerance: float) -> Verification:
    """Compute the objective of `plan` and check every constraint of `model`."""
    check_tolerance(tolerance)
    required("plan", plan, MissionPlan)
    for k, route in enumerate(plan.routes):
        for stop, node in enumerate(route):
            if not 0 <= node < len(model.nodes):
                raise InvalidData(
                    f"routes[{k}][{stop}] must be in 0 … {len(model.nodes) - 1}, got {node}",
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
    # The range of nearly equal lengths is almost 0: compare it with the mean length instead.
    scale = float(loads.mean()) if model.objective == "range" else 0.0
    # Only objective, q and deviation are read, which are fields of both models.
    objective = objective_of(model, loads)  # type: ignore[arg-type]
    return Verification(objective, tuple(checks), scale=scale)


def _counts(model: MissionData, plan: MissionPlan) -> Iterator[Check]:
    def count(name: str, number: int, where: str) -> Check:
        return Check(name, "", float(number), "", 0.0, where, 0.0)

    visits = np.bincount(
        np.array([node for route in plan.routes for node in route], int),
        minlength=len(model.nodes),
    )
    wrong = np.flatnonzero(visits != 1)
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
    """Return the rounding error of a position, m."""
    return DIGITS * float(np.abs(model.bounds).max())


def _places(
    model: MissionData, plan: MissionPlan, flown: list[tuple[int, Trajectory]], tolerance: float
) -> Iterator[Check]:
    """Yield the checks of visit times and positions, and of both ends."""
    noise = _digits(model)
    # Time scale: one cell at the velocity scale of the other checks.
    pause = _scale(model, 0) / _scale(model, 1)
    passed = Worst("nodes passed at their times", "m", tolerance, "24")
    late = Worst("visits in order", "s", tolerance)
    ends = Worst("begins and ends at the depot", "m", tolerance)
    rest = [
        Worst(
            f"{derivative_name(j)} 0 at both ends",
            derivative_unit(j),
            tolerance,
            _equation_number("23", j),
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


def _equation_number(equation: str, order: int) -> str:
    """Return the equation number, empty for the jerk, which the paper does not constrain."""
    return equation if order <= 2 else ""


def _scale(model: MissionData, order: int) -> float:
    """Return the scale of a derivative: cell, velocity limit, acceleration limit, or derived jerk."""
    speed, push = float(model.velocity_limit.min()), float(model.acceleration_limit.min())
    return (model.cell, speed, push, push * push / speed)[order]


def _noise(one: Trajectory, order: int) -> Floats:
    """Return the rounding error of a derivative at knots, shape (segments, 2)."""
    if order > one.degree:
        return np.zeros((one.segments, 2))
    sizes = np.einsum(
        "p,kpd->kd", factorials(one.degree, order), np.abs(one.coefficients[:, order:])
    )
    # Rounding steps in positions cause derivatives of smooth curves.
    sizes += STEPS[order] * np.abs(one.coefficients[:, 0])
    return np.asarray(ULPS * sizes * (one.durations**-order)[:, None])


def _knots(
    model: MissionData, flown: list[tuple[int, Trajectory]], tolerance: float
) -> Iterator[Check]:
    """Yield the checks of jumps at knots, from the position to the derivative `continuity`."""
    for order in range(model.continuity + 1):
        name, unit = f"continuity of {derivative_name(order)}", derivative_unit(order)
        worst = Worst(name, unit, tolerance, _equation_number("25", order))
        for k, one in flown:
            begin, end = one.at_ends(order)
            own = _noise(one, order)
            jump = np.abs(end[:-1] - begin[1:])
            scale: Any = _scale(model, order)
            if order == 3:
                # Jerk has no limit: its scale is the value at the knot, and 1 % of the largest value.
                at_knot = np.maximum(np.abs(end[:-1]), np.abs(begin[1:]))
                scale = np.maximum(at_knot, 1e-2 * np.abs(begin).max(axis=0))
                scale = np.broadcast_to(np.minimum(scale, _scale(model, 3) * 1e3), jump.shape)
                scale = scale.ravel()
            worst.add(
                jump.ravel(),
                lambda s, k=k, one=one: (
                    f"robot {k}, knot {s // 2 + 1} (t = {one.times[s // 2 + 1]:.6g} s)"
                ),
                scale,
                (own[:-1] + own[1:]).ravel() + (_digits(model) if order == 0 else 0.0),
            )
        yield worst.check()


def _limits(
    model: MissionData, flown: list[tuple[int, Trajectory]], tolerance: float
) -> Iterator[Check]:
    """Yield the checks of the velocity and acceleration limits at exact extremes."""
    for order, limits in ((1, model.velocity_limit), (2, model.acceleration_limit)):
        name = derivative_name(order)
        worst = Worst(f"{name} within its limit", derivative_unit(order), tolerance)
        for k, one in flown:
            extremes = one.extremes(order)
            sizes = np.maximum(-extremes.least, extremes.largest)
            late = extremes.largest >= -extremes.least
            times = np.where(late, extremes.largest_time, extremes.least_time)
            excess = sizes - limits
            row = np.nanargmax(excess / limits, axis=0) if np.isfinite(excess).any() else [0, 0]
            for axis in (0, 1):
                s = int(row[axis])
                worst.add(
                    excess[s, axis], f"robot {k}, axis {axis} (t = {times[s, axis]:.6g} s)",
                    float(limits[axis]), 0.0, float(limits[axis]),
                )  # fmt: skip
        yield worst.check()


def _inside(model: MissionData, flown: list[tuple[int, Trajectory]], tolerance: float) -> Check:
    """Return the check that the curves stay inside the bounds, at exact extremes."""
    worst = Worst("inside the bounds", "m", tolerance)
    low, high = model.bounds[:2], model.bounds[2:]
    for k, one in flown:
        extremes = one.extremes(0)
        excess = np.maximum(low - extremes.least, extremes.largest - high)
        worst.add(
            excess.ravel(),
            lambda s, k=k: f"robot {k}, segment {s // 2}",
            model.cell,
            _digits(model),
        )
    return worst.check()


def _collision(model: MissionData, flown: list[tuple[int, Trajectory]], tolerance: float) -> Check:
    """Return the check of the distance between curves and obstacles."""
    worst = Worst("radius away from obstacles", "m", tolerance)
    slack = tolerance * model.cell + _digits(model)
    if not flown:
        return worst.check()
    depth, robot, time, place = deepest(
        [pieces_of(one, k) for k, one in flown], model.solids, model.radius, slack, model.cell
    )
    where = (
        f"robot {robot} (t = {time:.6g} s), x {place[0]:.6g}, y {place[1]:.6g} m"
        if depth > 0
        else ""
    )
    worst.add(depth, where, model.cell, _digits(model), model.radius or None)
    return worst.check()


def _separation(model: MissionData, flown: list[tuple[int, Trajectory]], tolerance: float) -> Check:
    """Return the check of the distance between robots under way; a report only for separation 0.

    Before its departure and after its return a robot waits in the depot's queue, off the map. This
    is the only exemption.
    """
    required_ = model.separation > 0
    name = "distance between robots" if required_ else "separation not required"
    worst = Worst(name, "m", tolerance)
    # The search error adds to the tolerance, so it must be much smaller.
    slack = SEARCHED * (tolerance * model.cell + _digits(model))
    closest = nearest([one for _, one in flown], slack)
    where = "never two under way at one time"
    if np.isfinite(closest.distance):
        a, b = (flown[k][0] for k in closest.pair)
        where = f"robots {a} and {b} (t = {closest.time:.6g} s), {closest.distance:.6g} m apart"
    where += "; before departure and after return robots wait in the depot's queue"
    excess = max(model.separation - closest.distance, 0.0)
    worst.add(excess, where, model.cell, 2 * _digits(model), model.separation or None)
    return worst.check()
