"""Checks of the data of a trajectory model and of any plan for it.

The check of a plan shares no code with the solvers. It evaluates the polynomials, integrates the
squares of their derivatives by quadrature, and computes their extremes from roots.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import required
from ..verification import TOLERANCE, Check, Verification, check_tolerance
from .bounds import Bound, PathData, derivative_name, derivative_unit
from .gate_checks import check_gates
from .knots import SEGMENTS, ULPS, check_knots
from .polynomials import bernstein_matrix, by_power
from .trajectory import Trajectory
from .vehicle_checks import check_flight

__all__ = ["check_conditions", "verify_trajectory"]

Floats = NDArray[np.float64]

#: Parts of a segment with a control polygon each. A single polygon is too far from the curve.
_PIECES = 4


# -- of the data -------------------------------------------------------------------------------------


def check_conditions(model: PathData) -> None:
    """Raise :class:`InvalidData` if fixed values contradict each other, the corridor or limits."""
    inner = 0 if model.derivatives is None else model.derivatives.shape[1]
    for name, count in (
        ("start", len(model.start)),
        ("end", len(model.end)),
        ("derivatives", inner),
    ):
        if count > model.degree:
            raise InvalidData(
                f"{name} fixes {count} derivatives of a polynomial of degree {model.degree}",
                field=name,
            )
    if model.derivatives is not None:
        for knot, name, rows in ((0, "start", model.start), (-1, "end", model.end)):
            _agree(model.derivatives[knot], rows, name, model.times.size - 1 if knot else 0)
    _check_polytopes(model)
    conditions = model.conditions
    for bound in model.bounds:
        crossed = np.argwhere(bound.lower > bound.upper)
        if crossed.size:
            segment, axis = (int(k) for k in crossed[0])
            raise InvalidData(
                f"corridor_lower[{segment}, {axis}] must be <= corridor_upper[{segment}, {axis}] = "
                f"{bound.upper[segment, axis]:g}, got {bound.lower[segment, axis]:g}",
                field="corridor_lower",
            )
        if bound.derivative >= conditions.shape[1]:
            continue
        fixed = conditions[:, bound.derivative]
        word = derivative_name(bound.derivative)
        for side, knots in (("before", fixed[1:]), ("after", fixed[:-1])):
            off = np.isfinite(knots) & ((knots < bound.lower) | (knots > bound.upper))
            if off.any():
                segment, axis = (int(k) for k in np.argwhere(off)[0])
                knot = segment + (side == "before")
                field = _field(model, knot, bound.derivative)
                raise InvalidData(
                    f"{field}: the {word} {knots[segment, axis]:g} of knot {knot}, axis {axis} lies "
                    f"outside the {bound.name} of segment {segment}: "
                    f"[{bound.lower[segment, axis]:g}, {bound.upper[segment, axis]:g}]",
                    field=field.partition("[")[0],
                )


def _field(model: PathData, knot: int, derivative: int) -> str:
    if derivative == 0:
        return f"waypoints[{knot}]"
    for at, name, rows in ((0, "start", model.start), (model.segments, "end", model.end)):
        if knot == at and len(rows) >= derivative and np.isfinite(rows[derivative - 1]).any():
            return f"{name}[{derivative - 1}]"
    return f"derivatives[{knot}, {derivative - 1}]"


def _agree(given: Floats, rows: Floats, name: str, knot: int) -> None:
    count = min(len(given), len(rows))
    both = np.isfinite(given[:count]) & np.isfinite(rows[:count])
    off = both & (given[:count] != rows[:count])
    if off.any():
        row, axis = (int(k) for k in np.argwhere(off)[0])
        raise InvalidData(
            f"derivatives[{knot}, {row}, {axis}] is {given[row, axis]:g}, but "
            f"{name}[{row}, {axis}] is {rows[row, axis]:g} (without {name}, that end is at rest)",
            field="derivatives",
        )


def _check_polytopes(model: PathData) -> None:
    parts = (model.polytope_segments, model.polytope_normals, model.polytope_offsets)
    if all(part is None for part in parts):
        return
    for name, part in zip(("segments", "normals", "offsets"), parts, strict=True):
        if part is None:
            raise InvalidData(
                f"polytope_{name} is missing: segments, normals and offsets go together",
                field=f"polytope_{name}",
            )
    segments, normals = model.polytope_segments, model.polytope_normals
    assert segments is not None and normals is not None
    beyond = np.flatnonzero(segments >= model.segments)
    if beyond.size:
        at = int(beyond[0])
        raise InvalidData(
            f"polytope_segments[{at}] must be < {model.segments} (segments), got {segments[at]}",
            field="polytope_segments",
        )
    flat = np.flatnonzero(np.linalg.norm(normals, axis=1) < 1e-12)
    if flat.size:
        raise InvalidData(
            f"polytope_normals[{int(flat[0])}] must not be zero", field="polytope_normals"
        )
    spaces = model.halfspaces
    if spaces is None:
        return
    for side in (0, 1):
        knots = spaces.segments + side
        points = model.waypoints[knots]
        known = np.asarray(np.isfinite(points).all(axis=1))
        reach = np.einsum("hd,hd->h", np.where(known[:, None], points, 0.0), spaces.normals)
        over = np.where(known, reach - spaces.offsets, 0.0)
        off = over > 1e-12 * np.maximum(1.0, np.abs(spaces.offsets))
        if off.any():
            at = int(np.flatnonzero(off)[0])
            raise InvalidData(
                f"waypoints[{knots[at]}] = {points[at].tolist()} lies {over[at]:g} m outside "
                f"half-space {at} of segment {spaces.segments[at]}",
                field="waypoints",
            )


# -- of a plan ---------------------------------------------------------------------------------------


def verify_trajectory(
    model: PathData, plan: Trajectory, tolerance: float = TOLERANCE
) -> Verification:
    """Evaluate the objective and every condition of `model` on `plan`."""
    check_tolerance(tolerance)
    required("plan", plan, Trajectory)
    model.require_shape(plan)
    checks = [_times(model, plan, tolerance)]
    checks += _degree(model, plan, tolerance)
    checks += check_knots(model, plan, tolerance)
    checks += (_bounded(model, plan, bound, tolerance) for bound in model.bounds)
    checks += _halfspaces(model, plan, tolerance)
    checks += check_gates(model, plan, tolerance)
    checks += check_flight(model, plan, tolerance)
    return Verification(model.objective(plan), tuple(checks), scale=model.objective_scale)


def _times(model: PathData, plan: Trajectory, tolerance: float) -> Check:
    off = np.abs(plan.times - model.times)
    # A time error relative to the shortest segment is a position error of the same relative size.
    scale = float(min(1.0, model.durations.min()))
    return Check.largest("times", off, scale, "s", lambda knot: f"knot {knot}", tolerance)


def _degree(model: PathData, plan: Trajectory, tolerance: float) -> Iterator[Check]:
    """Yield a bound on the contribution of powers above the model's degree, in metres."""
    if plan.degree <= model.degree:
        return
    extra = np.abs(plan.coefficients[:, model.degree + 1 :]).sum(axis=1)
    yield Check.largest(
        f"degree at most {model.degree}", extra, float(model.position_scale.max()), "m",
        lambda segment, axis: f"segment {segment}", tolerance,
    )  # fmt: skip


def _control(coefficients: Floats, order: int) -> Floats:
    """Return the Bézier control points of a derivative in s, shape (points, dimensions, segments).

    The curve is in their convex hull. Exact extremes are needed only if control points violate a
    bound.
    """
    count, powers, dimensions = coefficients.shape
    if order >= powers:
        return np.zeros((1, dimensions, count))
    inner = by_power(coefficients, order)
    matrix = bernstein_matrix(len(inner) - 1, _PIECES)
    return (matrix @ inner.reshape(len(inner), -1)).reshape(-1, dimensions, count)


def _bounded(model: PathData, plan: Trajectory, bound: Bound, tolerance: float) -> Check:
    """Return the check of a bound at its largest relative violation."""
    order = bound.derivative
    out = np.empty(bound.lower.shape, bool)
    for first in range(0, model.segments, SEGMENTS):
        part = slice(first, first + SEGMENTS)
        control = _control(plan.coefficients[part], order) * plan.durations[part] ** -order
        low, high = control.min(axis=0), control.max(axis=0)
        out[part] = ~((bound.lower[part] <= low.T) & (bound.upper[part] >= high.T))
    rows, axes = np.nonzero(out)
    if not rows.size:
        size = float(model.derivative_scale(order).max())
        unit = derivative_unit(order)
        return Check.largest(bound.name, [], size, unit, "everywhere inside", tolerance)
    extremes = plan.extremes(order, direction=np.eye(plan.dimensions)[axes], segments=rows)
    edges = np.stack([bound.lower[out], bound.upper[out]])
    off = np.stack([edges[0] - extremes.least[:, 0], extremes.largest[:, 0] - edges[1]])
    times = np.stack([extremes.least_time[:, 0], extremes.largest_time[:, 0]])

    def place(side: int, row: int) -> str:
        return f"segment {rows[row]}, axis {axes[row]} (t = {times[side, row]:.6g} s)"

    return Check.largest(
        bound.name, off, np.stack([size[out] for size in model.bound_scale(bound)]),
        derivative_unit(order), place, tolerance, noise=ULPS * np.abs(edges),
        limit=edges[1] - edges[0],
    )  # fmt: skip


def _halfspaces(model: PathData, plan: Trajectory, tolerance: float) -> Iterator[Check]:
    spaces = model.halfspaces
    if spaces is None:
        return
    out = np.empty(spaces.segments.size, bool)
    for first in range(0, out.size, SEGMENTS):
        part = slice(first, first + SEGMENTS)
        control = _control(plan.coefficients[spaces.segments[part]], 0)
        reach = (control * spaces.normals[part].T).sum(axis=1).max(axis=0)
        out[part] = ~(reach <= spaces.offsets[part])
    rows = np.flatnonzero(out)
    size = float(model.position_scale.max())
    if not rows.size:
        yield Check.largest("polytope", [], size, "m", "everywhere inside", tolerance)
        return
    segments, offsets = spaces.segments[rows], spaces.offsets[rows]
    extremes = plan.extremes(0, direction=spaces.normals[rows], segments=segments)

    def place(at: int) -> str:
        time = extremes.largest_time[at, 0]
        return f"segment {segments[at]}, half-space {rows[at]} (t = {time:.6g} s)"

    off, noise = extremes.largest[:, 0] - offsets, ULPS * np.abs(offsets)
    yield Check.largest("polytope", off, size, "m", place, tolerance, noise=noise)
