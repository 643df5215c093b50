"""Checks of laps, of the yaw and of the limits of a vehicle, for models and for plans."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import InvalidData
from ..verification import Check
from .bounds import derivative_name, derivative_unit
from .jets import Jet
from .motion import Motion, heading_jumps
from .polynomials import derived
from .yaw import yaw_waypoints

if TYPE_CHECKING:
    from .bounds import PathData
    from .motion import Yaw
    from .trajectory import Trajectory

__all__ = ["check_flight", "check_vehicle", "yaw_of"]


#: Rounding error of a derivative at the joint, relative to the sum of the sizes of its terms.
ULPS = 16 * float(np.finfo(float).eps)
#: Excess of a limit by fixed derivatives that is attributed to rounding, relative to the limit.
_ROUNDING = 1e-9


def check_vehicle(model: PathData) -> None:
    """Raise :class:`InvalidData` for laps that do not close and for states beyond the vehicle's limits."""
    if model.periodic:
        _check_lap(model)
    if isinstance(model.yaw, str) and model.dimensions < 2:
        raise InvalidData('yaw "tangent" needs at least 2 axes', field="yaw")
    if model.vehicle is None:
        return
    model.vehicle.require_axes(model.dimensions, "waypoints")
    # The body rate depends on the rate of the yaw, which is not known at single knots.
    known = {"speed", "acceleration", "thrust", "lowest thrust", "tilt"}
    if model.yaw is None:
        known.add("body rate")
    names = [f"derivatives[{knot}]" for knot in range(model.times.size)]
    names[0], names[-1] = "start", "end"
    for name, table in zip(names, model.conditions, strict=True):
        rows = table[1:]
        count = int(np.append(np.isfinite(rows).all(axis=1), False).argmin())
        motion = Motion(
            [
                Jet([0.0, *(rows[k, axis] / math.factorial(k + 1) for k in range(count))])
                for axis in range(model.dimensions)
            ],
            None, None, None, False,
        )  # fmt: skip
        for measure in model.vehicle.measures:
            if measure.name not in known:
                continue
            with np.errstate(all="ignore"):
                try:
                    reached = measure.function(motion).terms[0]
                except IndexError:  # a derivative that the quantity needs is free
                    continue
            if not reached <= measure.level + _ROUNDING * abs(measure.level):
                word, side = measure.name, "above" if measure.is_upper else "below"
                raise InvalidData(
                    f"{name}: the {word} {measure.value(reached):g} {measure.unit} of the fixed "
                    f"derivatives is {side} the vehicle's limit {measure.limit:g} {measure.unit}",
                    field=name.partition("[")[0],
                )


def _check_lap(model: PathData) -> None:
    first, last = model.conditions[0], model.conditions[-1]
    both = np.isfinite(first) & np.isfinite(last) & (first != last)
    if both.any():
        order, axis = (int(k) for k in np.argwhere(both)[0])
        what = "waypoints[-1]" if order == 0 else f"end[{order - 1}]"
        raise InvalidData(
            f"{what} must equal the value at the first knot, {first[order, axis]:g} on axis {axis}, for "
            f"a periodic path, got {last[order, axis]:g}",
            field=what.partition("[")[0],
        )
    if isinstance(model.yaw, np.ndarray) and not np.isfinite(model.yaw[0]):
        raise InvalidData("yaw[0] must be given for a periodic path", field="yaw")


def yaw_of(model: PathData, plan: Trajectory) -> Yaw:
    """Return the yaw of a plan: along the path, its own curve, or the constant of the model."""
    if model.yaw is None or isinstance(model.yaw, str):
        return "tangent" if model.yaw is not None else None
    if plan.yaw is not None and np.array_equal(plan.yaw.times, plan.times):
        return plan.yaw
    return None if isinstance(model.yaw, np.ndarray) else model.yaw


def check_flight(model: PathData, plan: Trajectory, tolerance: float) -> Iterator[Check]:
    """Yield the checks of the joint of a lap, of the yaw and of the vehicle's limits."""
    for order in range(model.joint_order + 1):
        yield _joint(model, plan, order, tolerance)
    if isinstance(model.yaw, str) or (model.vehicle is not None and model.vehicle.follows_path):
        yield _heading(model, plan, tolerance)
    if model.yaw is not None and not isinstance(model.yaw, str):
        yield from _yaw(model, plan, tolerance)
    if model.vehicle is None:
        return
    for extreme in model.vehicle.check_curve(plan, yaw_of(model, plan), exact=False):
        yield Check.scaled(
            f"{extreme.name} limit", extreme.equation, max(extreme.amount, 0.0), extreme.unit,
            f"t = {extreme.time:.6g} s", tolerance, extreme.limit, limit=extreme.limit,
        )  # fmt: skip


def _joint(model: PathData, plan: Trajectory, order: int, tolerance: float) -> Check:
    """Return the check of a derivative at the joint of a lap."""
    begin, end = plan.at_ends(order)
    before, after, least = end[-1], begin[0], model.derivative_scale(order)
    # As at inner knots, a plan's own values justify a limited scale.
    size = np.maximum(np.abs(before), np.abs(after))
    scale = least if order == 0 else np.clip(size, least, 1e3 * least)
    terms = np.abs(derived(plan.coefficients[-1:], order)[0]).sum(axis=0)
    noise = np.minimum(ULPS * terms * plan.durations[-1] ** -float(order), tolerance * scale)
    name, unit = f"{derivative_name(order)} at the joint of the lap", derivative_unit(order)
    off = np.abs(before - after)
    return Check.largest(name, off, scale, unit, lambda k: f"axis {k}", tolerance, noise=noise)


def _heading(model: PathData, plan: Trajectory, tolerance: float) -> Check:
    """Return the check that the direction of the path in the plane has no jump at a knot."""
    where = _at(model, 1) if model.segments > 1 else ""
    return Check.largest("continuity of heading", heading_jumps(plan), 1.0, "rad", where, tolerance)


def _yaw(model: PathData, plan: Trajectory, tolerance: float) -> Iterator[Check]:
    """Yield the checks of the yaw of a plan: its angles, its continuity and its ends."""
    curve = plan.yaw
    if curve is None:
        if isinstance(model.yaw, np.ndarray):
            yield Check.count("plan has a yaw", 1)
        return
    if curve.dimensions != 1 or not np.array_equal(curve.times, plan.times):
        yield Check.count("yaw has one axis and the times of the plan", 1)
        return
    angles = yaw_waypoints(model.yaw, model.times.size, model.periodic)  # type: ignore[arg-type]
    begin, end = (side[:, 0] for side in curve.at_ends(0))
    off = np.fmax(
        np.append(np.abs(begin - angles[:-1]), np.nan), np.append(np.nan, np.abs(end - angles[1:]))
    )
    yield Check.largest("yaw at knots", np.nan_to_num(off), 1.0, "rad", _at(model, 0), tolerance)
    speed = np.pi / float(model.durations.mean())
    first, last = (side[:, 0] for side in curve.at_ends(1))
    jumps = np.stack([np.abs(end[:-1] - begin[1:]), np.abs(last[:-1] - first[1:])])
    for jump, name, unit, scale in zip(
        jumps, ("yaw", "yaw rate"), ("rad", "rad/s"), (1.0, speed), strict=True
    ):
        yield Check.largest(f"continuity of {name}", jump, scale, unit, _at(model, 1), tolerance)
    joint = [abs(first[0] - last[-1])] if model.periodic else [abs(first[0]), abs(last[-1])]
    yield Check.largest("yaw rate at the ends", joint, speed, "rad/s", "", tolerance)


def _at(model: PathData, first: int) -> Any:
    return lambda k: f"knot {k + first} (t = {model.times[k + first]:g} s)"
