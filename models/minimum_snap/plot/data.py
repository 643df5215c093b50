"""Data of a trajectory figure: samples, bounds and locations of violations."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....errors import InvalidData
from ...fields import show
from ...plots import kit
from ...verification import Check, Verification
from ..bounds import Bound, Halfspaces, derivative_name
from ..polynomials import derived
from ..trajectory import Trajectory

__all__ = ["Scene", "Violation", "given_times", "scene_of"]

#: Approximate number of points of a curve, independent of the number of segments.
_POINTS = 8000
#: Smallest and largest number of points per segment. Fewer hide its shape, more are invisible.
_FEWEST, _MOST = 4, 240
#: Place of a violation in the text of a check.
_WHERE = re.compile(r"(?:knot (?P<knot>\d+), )?(?:axis (?P<axis>\d+) )?\(t = (?P<time>\S+) s\)")


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


@dataclass(frozen=True, eq=False)
class Scene:
    """Model and plan for a figure. A model without times uses those of the plan.

    The model has ``waypoints``; its times, bounds and half-spaces are optional. Waypoints (m), shape (knots,
    dimensions), and conditions, shape (knots, orders, dimensions), are infinite if free. Without a time for each
    knot (s), the knots are not `timed`, and `times` are their indices.
    """

    model: Any
    plan: Trajectory | None
    names: tuple[str, ...]
    waypoints: kit.Floats
    conditions: kit.Floats
    timed: bool
    times: kit.Floats
    bounds: tuple[Bound, ...]
    halfspaces: Halfspaces | None
    verification: Verification | None

    @property
    def dimensions(self) -> int:
        """Number of axes."""
        return int(self.waypoints.shape[1])

    @property
    def segments(self) -> int:
        """Number of segments."""
        return len(self.waypoints) - 1

    @property
    def flown(self) -> kit.Floats:
        """Times of the knots of the plan, s."""
        return self.times if self.plan is None else self.plan.times

    def bounds_of(self, order: int) -> list[Bound]:
        """Return the bounds on one derivative."""
        return [bound for bound in self.bounds if bound.derivative == order]

    # -- samples ---------------------------------------------------------------------------------

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

    # -- violations ------------------------------------------------------------------------------

    @property
    def violated(self) -> tuple[Check, ...]:
        """Failed checks of the plan."""
        return () if self.verification is None else tuple(self.verification.violated)

    @cached_property
    def marks(self) -> tuple[Violation, ...]:
        """Locations of the largest violation of each failed check that has a location."""
        result = ((check, _WHERE.search(check.where)) for check in self.violated)
        return tuple(self._located(check, place) for check, place in result if place is not None)

    def _located(self, check: Check, place: re.Match[str]) -> Violation:
        """Return the violation of a check at the place that it names."""
        plan = self._planned()
        axis = -1 if place["axis"] is None else int(place["axis"])
        order = self._order_of(check.name)
        if place["knot"] is None:
            time = float(place["time"])
            value = np.nan if axis < 0 else float(plan(time, order)[axis])
            return Violation(check, order, axis, time, value, plan(time))
        # The derivative may jump at a knot: choose the side that is farther from the fixed value.
        knot = int(place["knot"])
        begin, end = plan.at_ends(order)
        sides = np.concatenate([begin[knot : knot + 1, axis], end[max(knot - 1, 0) : knot, axis]])
        fixed = self.conditions[knot, order, axis] if order < self.conditions.shape[1] else np.inf
        farther = int(np.abs(sides - fixed).argmax()) if np.isfinite(fixed) else 0
        time = float(self.flown[knot])
        return Violation(check, order, axis, time, float(sides[farther]), plan(time))

    def _order_of(self, name: str) -> int:
        """Return the order of the derivative that a check restricts; 0 for positions."""
        count = max(self.conditions.shape[1], self._planned().degree + 1)
        words = {derivative_name(k): k for k in range(count)}
        orders = {bound.name: bound.derivative for bound in self.bounds}
        return orders.get(name, words.get(name.removeprefix("continuity of ").split(" at ")[0], 0))


def scene_of(model: Any, plan: Any, names: Any) -> Scene:
    """Return the scene of `model` and `plan`, or raise :class:`InvalidData`."""
    waypoints = np.asarray(model.waypoints)
    count, dimensions = len(waypoints) - 1, waypoints.shape[1]
    if plan is not None and not isinstance(plan, Trajectory):
        raise InvalidData(f"plan must be a Trajectory, got {show(plan)}", field="plan")
    if plan is not None and (plan.segments, plan.dimensions) != (count, dimensions):
        raise InvalidData(
            f"plan has {plan.segments} segments in {plan.dimensions}-D, the model {count} in "
            f"{dimensions}-D",
            field="plan",
        )
    times, bounds = given_times(model), getattr(model, "bounds", ())
    if times is None and plan is not None:
        times = plan.times
    conditions = getattr(model, "conditions", None)
    return Scene(
        model, plan, _names(names, dimensions), waypoints,
        conditions=waypoints[:, None] if conditions is None else np.asarray(conditions, float),
        timed=times is not None,
        times=np.asarray(np.arange(count + 1) if times is None else times, float),
        bounds=tuple(bounds() if callable(bounds) else bounds),
        halfspaces=getattr(model, "halfspaces", None),
        verification=None if plan is None else model.verify(plan),
    )  # fmt: skip


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
