"""Data of a trajectory figure: samples, bounds, locations of violations and regions of a corridor."""

from __future__ import annotations

import re
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from ....errors import InvalidData
from ...fields import show
from ...plots import kit
from ...verification import Check, Verification
from ..bounds import Bound, Halfspaces, derivative_name
from ..polynomials import derived
from ..trajectory import Trajectory

__all__ = ["Scene", "Violation", "given_times", "regions"]

#: Approximate number of points of a curve, independent of the number of segments.
_POINTS = 8000
#: Smallest and largest number of points per segment. Fewer hide its shape, more are invisible.
_FEWEST, _MOST = 4, 240
#: Components of normals of length 1 below this value are treated as 0.
_TILT = 1e-9
#: Place of a violation in the text of a check.
_WHERE = re.compile(
    r"(?:knot (?P<knot>\d+), |segment (?P<segment>\d+), )(?:axis (?P<axis>\d+) )?(?:half-space \d+ )?"
    r"\(t = (?P<time>\S+) s\)"
)
#: Place of a check of times or durations.
_PART = re.compile(r"(knot|segment) (\d+)(?: \(|$)")


class Violation(NamedTuple):
    """Location of the largest violation of one condition.

    Order and axis of the derivative, axis -1 if several are involved; time (s), value (NaN without a
    single axis), and position on the path (m).
    """

    check: Check
    order: int
    axis: int
    time: float
    value: float
    position: kit.Floats


def given_times(model: Any) -> Any:
    """Return the times of a model's knots, or None if they are free."""
    times = getattr(model, "times", None)
    return None if callable(times) else times


class Scene:
    """Model and plan for a figure. A model without times uses those of the plan.

    The model has ``waypoints``; its times, bounds and half-spaces are optional. Waypoints (m), shape (knots,
    dimensions), and conditions, shape (knots, orders, dimensions), are infinite if free. Without a time for each
    knot (s), the knots are not `timed`, and `times` are their indices; `flown` are those of the plan.
    """

    def __init__(self, model: Any, plan: Any, names: Any) -> None:
        self.model, self.waypoints = model, np.asarray(model.waypoints)
        self.segments, self.dimensions = len(self.waypoints) - 1, int(self.waypoints.shape[1])
        if plan is not None and not isinstance(plan, Trajectory):
            raise InvalidData(f"plan must be a Trajectory, got {show(plan)}", field="plan")
        if plan is not None and (plan.segments, plan.dimensions) != self.waypoints[1:].shape:
            raise InvalidData(
                f"plan has {plan.segments} segments in {plan.dimensions}-D, the model {self.segments} "
                f"in {self.dimensions}-D",
                field="plan",
            )
        self.plan: Trajectory | None = plan
        self.names = _names(names, self.dimensions)
        conditions, bounds = getattr(model, "conditions", None), getattr(model, "bounds", ())
        fixed = self.waypoints[:, None] if conditions is None else np.asarray(conditions, float)
        self.conditions: kit.Floats = fixed
        times = given_times(model)
        if times is None and plan is not None:
            times = plan.times
        self.timed = times is not None
        self.times = np.asarray(np.arange(self.segments + 1) if times is None else times, float)
        self.flown = self.times if plan is None else plan.times
        self.bounds: tuple[Bound, ...] = tuple(bounds() if callable(bounds) else bounds)
        self.halfspaces: Halfspaces | None = getattr(model, "halfspaces", None)
        self.verification: Verification | None = None if plan is None else model.verify(plan)

    def bounds_of(self, order: int) -> list[Bound]:
        """Return the bounds on one derivative."""
        return [bound for bound in self.bounds if bound.derivative == order]

    @cached_property
    def _rows(self) -> NDArray[np.int64]:
        """Indices of the drawn segments: all, or a subset at equal steps."""
        most = min(self.segments, _POINTS // _FEWEST)
        return np.linspace(0, self.segments - 1, most).round().astype(np.int64)

    @cached_property
    def _grid(self) -> kit.Floats:
        return np.linspace(0.0, 1.0, int(np.clip(_POINTS // len(self._rows), _FEWEST, _MOST)))

    @cached_property
    def sample_times(self) -> kit.Floats:
        """Times of the samples, s, shape (samples,). Knots occur twice, to show jumps."""
        plan = self._planned()
        starts, lengths = plan.times[self._rows], plan.durations[self._rows]
        times: kit.Floats = (starts[:, None] + lengths[:, None] * self._grid).ravel()
        return times

    def samples(self, order: int) -> kit.Floats:
        """Return a derivative at :attr:`sample_times`, shape (samples, dimensions)."""
        plan = self._planned()
        inner = derived(plan.coefficients[self._rows], order)
        powers = np.vander(self._grid, inner.shape[1], increasing=True)
        values = np.einsum("np,kpd->knd", powers, inner)
        values *= (plan.durations[self._rows] ** -order)[:, None, None]
        return np.asarray(values.reshape(-1, self.dimensions))

    def _planned(self) -> Trajectory:
        assert self.plan is not None
        return self.plan

    @cached_property
    def marks(self) -> tuple[Violation, ...]:
        """Locations of the largest violation of each failed check that has a location."""
        return tuple(mark for mark in self.pins if not mark.check.ok and mark.order >= 0)

    @cached_property
    def pins(self) -> tuple[Violation, ...]:
        """Locations of all checks that have one; those of times and durations have the order -1."""
        places, plan = [], self.plan
        for check in () if self.verification is None else self.verification.checks:
            place, part = _WHERE.search(check.where), _PART.match(check.where)
            if place is not None:
                places.append(self._located(check, place))
            elif part is not None and plan is not None:
                ends = plan.times[int(part[2]) :][: 1 + (part[1] == "segment")]
                time = float(ends.mean())
                places.append(Violation(check, -1, -1, time, np.nan, plan(time)))
        return tuple(places)

    def _located(self, check: Check, place: re.Match[str]) -> Violation:
        """Return the violation of a check at the place that it names."""
        plan = self._planned()
        axis = -1 if place["axis"] is None else int(place["axis"])
        order = self._order_of(check.name)
        if place["knot"] is None:
            time, segment = float(place["time"]), int(place["segment"])
            value = np.nan if axis < 0 else float(self._within(segment, time, order)[axis])
            return Violation(check, order, axis, time, value, self._within(segment, time, 0))
        # The derivative may jump at a knot: choose the side that is farther from the fixed value.
        knot = int(place["knot"])
        begin, end = plan.at_ends(order)
        sides = np.concatenate([begin[knot : knot + 1, axis], end[max(knot - 1, 0) : knot, axis]])
        fixed = self.conditions[knot, order, axis] if order < self.conditions.shape[1] else np.inf
        farther = int(np.abs(sides - fixed).argmax()) if np.isfinite(fixed) else 0
        time = float(self.flown[knot])
        return Violation(check, order, axis, time, float(sides[farther]), plan(time))

    def _within(self, segment: int, time: float, order: int) -> kit.Floats:
        """Return a derivative in a segment, which may jump at its ends."""
        plan = self._planned()
        duration = plan.durations[segment]
        part = np.clip((time - plan.times[segment]) / duration, 0.0, 1.0)
        inner = derived(plan.coefficients[[segment]], order)[0]
        return np.asarray(part ** np.arange(len(inner)) @ inner * duration**-order)

    def _order_of(self, name: str) -> int:
        """Return the order of the derivative that a check restricts; 0 for positions."""
        count = max(self.conditions.shape[1], self._planned().degree + 1)
        words = {derivative_name(k): k for k in range(count)}
        orders = {bound.name: bound.derivative for bound in self.bounds}
        return orders.get(name, words.get(name.removeprefix("continuity of ").split(" at ")[0], 0))


def _names(names: Any, dimensions: int) -> tuple[str, ...]:
    if names is None:
        # Above three axes, use the axis numbers of the checks.
        return tuple("xyz"[k] if k < 3 else f"axis {k}" for k in range(dimensions))
    allowed = f"hold {dimensions} different word{'s' if dimensions > 1 else ''}, one an axis"
    return tuple(
        kit.check_list(
            "names", names, lambda name: isinstance(name, str) and name != "", allowed,
            least=dimensions, most=dimensions,
        )
    )  # fmt: skip


# -- the regions of a corridor: polygons in a plane, bodies in space ------------------------------


def regions(
    scene: Scene, shown: tuple[int, ...], low: kit.Floats, high: kit.Floats, most: int | None = None
) -> tuple[list[list[kit.Floats]], int, bool]:
    """Return the regions of the corridor in two or three axes, clipped at a box over all axes.

    `most` is the largest number of regions, selected at equal steps; all by default.

    Returns
    -------
    list of lists of ndarray, each of shape (corners, shown axes)
        Faces of each nonempty region: one polygon in a plane, the faces of a body in space.
    int
        Number of distinct regions.
    bool
        Whether half-spaces were omitted because they depend on an axis that is not shown.
    """
    boxes, spaces = scene.bounds_of(0), scene.halfspaces
    lower = np.broadcast_to(low, (scene.segments, low.size)).copy()
    upper = np.broadcast_to(high, lower.shape).copy()
    bounded = np.zeros(scene.segments, bool)
    for box in boxes:
        lower, upper = np.maximum(lower, box.lower), np.minimum(upper, box.upper)
        bounded |= (np.isfinite(box.lower) | np.isfinite(box.upper))[:, shown].any(axis=1)
    # Rows of the half-spaces of each segment.
    members: dict[int, list[int]] = {}
    for row, segment in enumerate([] if spaces is None else spaces.segments.tolist()):
        members.setdefault(segment, []).append(row)
        bounded[segment] = True
    # Segments with equal boxes share one region.
    selection: list[int] = []
    keys: set[bytes] = set()
    for segment in np.flatnonzero(bounded).tolist():
        key = lower[segment].tobytes() + upper[segment].tobytes()
        if segment in members or key not in keys:
            selection.append(segment)
        if segment not in members:
            keys.add(key)
    total = len(selection)
    if most is not None and total > most:
        selection = [selection[k] for k in np.linspace(0, total - 1, most).round().astype(int)]
    result, omitted = [], False
    axes = list(shown)
    for segment in selection:
        normals, offsets = np.zeros((0, low.size)), np.zeros(0)
        if spaces is not None and segment in members:
            normals, offsets = spaces.normals[members[segment]], spaces.offsets[members[segment]]
        tilted = (np.abs(np.delete(normals, axes, axis=1)) > _TILT).any(axis=1)
        if tilted.any() and low.size == 3:
            faces = _body(lower[segment], upper[segment], normals, offsets)
            faces = _hull(np.concatenate(faces)[:, axes]) if faces else []
        else:
            omitted |= bool((tilted & (np.abs(normals[:, axes]) > _TILT).any(axis=1)).any())
            part = normals[~tilted][:, axes]
            ends = lower[segment, axes], upper[segment, axes]
            faces = (_body if len(axes) == 3 else _polygon)(*ends, part, offsets[~tilted])
        if faces:
            result.append(faces)
    return result, total, omitted


def _polygon(
    lower: kit.Floats, upper: kit.Floats, normals: kit.Floats, offsets: kit.Floats
) -> list[kit.Floats]:
    """Return the intersection of a rectangle and half-planes as one polygon, or an empty list."""
    if (lower > upper).any():
        return []
    (left, bottom), (right, top) = lower, upper
    corners = np.array([[left, bottom], [right, bottom], [right, top], [left, top]])
    for normal, offset in zip(normals, offsets, strict=True):
        corners = _clip(corners, normal, offset)
    return [corners] if len(corners) else []


def _body(
    lower: kit.Floats, upper: kit.Floats, normals: kit.Floats, offsets: kit.Floats
) -> list[kit.Floats]:
    """Return the faces of a box cut by half-spaces, or an empty list."""
    if (lower > upper).any():
        return []
    normals = np.vstack([np.eye(3), -np.eye(3), normals])
    offsets = np.concatenate([upper, -lower, offsets])
    middle, reach = (lower + upper) / 2, 2 * float(np.linalg.norm(upper - lower)) + 1e-9
    faces = []
    for row, (normal, offset) in enumerate(zip(normals, offsets, strict=True)):
        # A square in the plane of the face, larger than the box, clipped by all other planes.
        u = np.cross(normal, np.eye(3)[int(np.abs(normal).argmin())])
        u /= np.linalg.norm(u)
        v = np.cross(normal, u)
        centre = middle + (offset - middle @ normal) * normal
        face = centre + reach * np.array([u + v, v - u, -u - v, u - v])
        for k in range(len(normals)):
            if k != row and len(face):
                face = _clip(face, normals[k], offsets[k])
        if len(face) >= 3:
            faces.append(face)
    return faces


def _clip(corners: kit.Floats, normal: kit.Floats, offset: float) -> kit.Floats:
    """Return the part of a convex polygon in ``normal @ x <= offset`` (Sutherland, Hodgman)."""
    if not len(corners):
        return corners
    slack = offset - corners @ normal
    inside = slack >= -1e-12 * max(1.0, abs(offset))
    if inside.all():
        return corners
    clipped = []
    for k in range(len(corners)):
        if inside[k - 1] != inside[k]:
            share = slack[k - 1] / (slack[k - 1] - slack[k])
            clipped.append(corners[k - 1] + share * (corners[k] - corners[k - 1]))
        if inside[k]:
            clipped.append(corners[k])
    return np.array(clipped).reshape(-1, corners.shape[1])


def _hull(points: kit.Floats) -> list[kit.Floats]:
    """Return the convex hull of points in a plane, or an empty list if they are collinear."""
    ordered = np.unique(points.round(12), axis=0)
    size = np.abs(ordered).max(initial=1.0)
    if np.linalg.matrix_rank(ordered[1:] - ordered[:1], tol=1e-9 * size) < 2:
        return []
    return [ordered[ConvexHull(ordered).vertices]]
