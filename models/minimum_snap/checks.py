"""The checks of a trajectory model: of its data, and of any plan for it.

The check of a plan shares nothing with the solvers: it evaluates the polynomials, integrates the
square of their derivatives by quadrature, and finds their extremes from roots.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..verification import TOLERANCE, Check, Verification, check_tolerance
from .bounds import Bound, PathData, derivative_name, derivative_unit
from .polynomials import bernstein_matrix, derived, factorials
from .trajectory import Trajectory

__all__ = ["check_conditions", "verify_trajectory"]

Floats = NDArray[np.float64]

#: Units in the last place of the terms of a derivative at a knot that its rounding may reach.
_ULPS = 16 * float(np.finfo(float).eps)


# -- of the data -------------------------------------------------------------------------------------


def check_conditions(model: PathData) -> None:
    """Raise :class:`InvalidData` where what is fixed contradicts itself, corridor or limits."""
    for name, rows in (("start", model.start), ("end", model.end)):
        if len(rows) > model.degree:
            raise InvalidData(
                f"{name} fixes {len(rows)} derivatives of a polynomial of degree {model.degree}",
                field=name,
            )
    if model.derivatives is not None:
        if model.derivatives.shape[1] > model.degree:
            raise InvalidData(
                f"derivatives fixes {model.derivatives.shape[1]} derivatives of a polynomial of "
                f"degree {model.degree}",
                field="derivatives",
            )
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
    """Return the objective and every condition of `model`, measured on `plan`."""
    check_tolerance(tolerance)
    if not isinstance(plan, Trajectory):
        raise InvalidData(f"plan must be a Trajectory, got {type(plan).__name__}", field="plan")
    if plan.segments != model.segments or plan.dimensions != model.dimensions:
        raise InvalidData(
            f"plan has {plan.segments} segments in {plan.dimensions}-D, the model "
            f"{model.segments} in {model.dimensions}-D",
            field="plan",
        )
    checks = [_times(model, plan, tolerance)]
    checks += _degree(model, plan, tolerance)
    for order in range(max(model.conditions.shape[1], model.continuity + 1)):
        checks += _knots(model, plan, order, tolerance)
    for bound in model.bounds:
        checks.append(_bounded(model, plan, bound, tolerance))
    checks += _halfspaces(model, plan, tolerance)
    return Verification(model.objective(plan), tuple(checks), scale=model.objective_scale)


def _times(model: PathData, plan: Trajectory, tolerance: float) -> Check:
    off = np.abs(plan.times - model.times)
    at = int(off.argmax())
    # A knot that is off by a share of its segment is off by as much of the path.
    scale = float(min(1.0, model.durations.min()))
    return Check.scaled("times", "", off[at], "s", f"knot {at}", tolerance, scale)


def _degree(model: PathData, plan: Trajectory, tolerance: float) -> Iterator[Check]:
    """What a plan of a higher degree has beyond the model's, as Bernstein would see it."""
    if plan.degree <= model.degree:
        return
    extra = np.abs(plan.coefficients[:, model.degree + 1 :]).sum(axis=1)
    at = int(extra.max(axis=1).argmax())
    yield Check.scaled(
        f"degree at most {model.degree}", "", extra[at].max(), "m", f"segment {at}", tolerance,
        float(model.position_scale.max()),
    )  # fmt: skip


def _knots(model: PathData, plan: Trajectory, order: int, tolerance: float) -> Iterator[Check]:
    """Yield the fixed values and the continuity of one derivative."""
    word, unit = derivative_name(order), derivative_unit(order)
    begin, end = plan.at_ends(order)
    # What the coefficients can hold: a short segment multiplies their last digit.
    noise = np.zeros_like(begin)
    if order <= plan.degree:
        factors = factorials(plan.degree, order)
        noise = np.einsum("p,kpd->kd", factors, np.abs(plan.coefficients[:, order:]))
        noise *= _ULPS * (plan.durations**-order)[:, None]
    least = model.derivative_scale(order)
    size = np.broadcast_to(least, begin.shape)
    if order > 0:
        size = np.maximum(size, np.maximum(np.abs(begin), np.abs(end)))

    def check(
        name: str, equation: str, off: Floats, own: Floats, scale: Floats, knots: NDArray[np.int64]
    ) -> Check:
        allowed = scale * tolerance + own
        share = off / allowed
        row, axis = (int(k) for k in np.unravel_index(int(share.argmax()), share.shape))
        knot = int(knots[row])
        return Check.scaled(
            name, equation, off[row, axis], unit,
            f"knot {knot}, axis {axis} (t = {model.times[knot]:g} s)", tolerance,
            scale[row, axis], noise=own[row, axis],
        )  # fmt: skip

    if order < model.conditions.shape[1]:
        fixed = model.conditions[:, order]
        known = np.isfinite(fixed)
        wanted = np.where(known, fixed, 0.0)
        first = np.where(known[:-1], np.abs(begin - wanted[:-1]), 0.0)
        last = np.where(known[1:], np.abs(end - wanted[1:]), 0.0)
        knots = np.arange(model.segments)
        both = np.concatenate([first, last])
        numbers = np.concatenate([knots, knots + 1])
        twice = np.concatenate([noise, noise])
        scales = np.concatenate([size, size])
        if order == 0:
            yield check("waypoints", "24", both, twice, scales, numbers)
        elif known.any():
            ends = np.isin(numbers, (0, model.segments))
            if known[[0, -1]].any():
                off = np.where(ends[:, None], both, 0.0)
                yield check(f"{word} at the ends", "23", off, twice, scales, numbers)
            if known[1:-1].any():
                off = np.where(ends[:, None], 0.0, both)
                yield check(f"{word} at inner knots", "", off, twice, scales, numbers)
    if order <= model.continuity and model.segments > 1:
        jump = np.abs(end[:-1] - begin[1:])
        if order > 0:
            # The knot's own values, and little of the segments beside it: a wild segment must not
            # excuse a jump where the path is calm.
            size = 1e-3 * np.maximum(size[:-1], size[1:])
            scale = np.maximum(size, np.maximum(np.abs(end[:-1]), np.abs(begin[1:])))
            scale = np.maximum(scale, least)
        else:
            scale = size[1:]
        yield check(
            f"continuity of {word}", "25", jump, noise[:-1] + noise[1:], scale,
            np.arange(1, model.segments),
        )  # fmt: skip


def _bounded(model: PathData, plan: Trajectory, bound: Bound, tolerance: float) -> Check:
    """Measure a bound where it is nearest to being broken."""
    order = bound.derivative
    scale = (plan.durations**-order)[:, None]
    inner = derived(plan.coefficients, order)
    # The control polygon encloses the curve: only segments where it sticks out need their roots.
    control = np.einsum("bp,kpd->kbd", bernstein_matrix(inner.shape[1] - 1), inner)
    low, high = control.min(axis=1) * scale, control.max(axis=1) * scale
    rows = np.flatnonzero(((low < bound.lower) | (high > bound.upper)).any(axis=1))
    where, worst, noise, limit = "everywhere inside", 0.0, 0.0, None
    size = float(model.derivative_scale(order).max())
    if rows.size:
        found = plan.extremes(order, segments=rows)
        edges = np.stack([bound.lower, bound.upper])[:, rows]
        off = np.stack([edges[0] - found.least, found.largest - edges[1]])
        sizes = np.stack(model.bound_scale(bound))[:, rows]
        at = side, row, axis = np.unravel_index(int((off / sizes).argmax()), off.shape)
        worst, size, noise = float(off[at]), float(sizes[at]), _ULPS * abs(float(edges[at]))
        limit = float(bound.upper[rows[row], axis] - bound.lower[rows[row], axis])
        time = (found.least_time, found.largest_time)[int(side)][row, axis]
        where = f"segment {int(rows[row])}, axis {axis} (t = {time:.6g} s)"
    return Check.scaled(
        bound.name, "", max(worst, 0.0), derivative_unit(order), where, tolerance, size,
        noise=noise, limit=limit,
    )  # fmt: skip


def _halfspaces(model: PathData, plan: Trajectory, tolerance: float) -> Iterator[Check]:
    spaces = model.halfspaces
    if spaces is None:
        return
    found = plan.extremes(0, direction=spaces.normals, segments=spaces.segments)
    size = float(model.position_scale.max())
    off = found.largest[:, 0] - spaces.offsets
    at = int(off.argmax())
    noise = _ULPS * abs(float(spaces.offsets[at]))
    yield Check.scaled(
        "polytope", "", max(float(off[at]), 0.0), "m",
        f"segment {int(spaces.segments[at])}, half-space {at} "
        f"(t = {found.largest_time[at, 0]:.6g} s)",
        tolerance, size, noise=noise,
    )  # fmt: skip
