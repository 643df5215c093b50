"""Checks of a trajectory at the knots: fixed values and continuity."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ..verification import Check
from .bounds import PathData, derivative_name, derivative_unit
from .polynomials import by_power, derivative_matrix
from .trajectory import Trajectory

__all__ = ["SEGMENTS", "ULPS", "check_knots"]

Floats = NDArray[np.float64]

#: Rounding error allowed in a derivative at a knot, relative to the sum of the sizes of its terms.
ULPS = 16 * float(np.finfo(float).eps)
#: Largest scale of a derivative that a plan's own values may justify, as a multiple of the scale
#: that the model implies. Values of an optimum may be large, and are exact relative to their size.
#: The cap prevents a plan from relaxing its own checks.
_SWING = 1e3
#: Segments checked per batch. The arrays of more segments exceed a processor's cache.
SEGMENTS = 1024
#: Name and equation of each kind of check at the knots.
_KINDS = (("{} at the ends", "23"), ("{} at inner knots", ""), ("continuity of {}", "25"))
_ENDS, _INNER, _SHARED = range(3)


class _Worst(NamedTuple):
    """Largest violation of a condition, relative to its allowance."""

    #: Violation divided by the allowance.
    share: float
    #: Violation, rounding allowance and scale of the violation, in the unit of the derivative.
    off: float
    noise: float
    scale: float
    #: Location of the violation.
    knot: int
    axis: int
    #: Whether rounding may exceed the rounding allowance.
    unclear: bool


class _Part(NamedTuple):
    """Batch of consecutive segments: derivatives at their ends, scales and fixed values.

    Without another shape, arrays have the shape (orders, dimensions, segments).
    """

    #: Index of the first segment.
    first: int
    #: Derivatives 0, 1, … at the start and at the end of each segment.
    begin: Floats
    end: Floats
    #: Rounding error of `begin` and `end`. Short segments magnify that of the coefficients.
    noise: Floats
    #: Size implied by the model's data: the largest of half a sine wave over the step and duration of
    #: the segment, the fixed values at its ends and :meth:`~.bounds.PathData.derivative_scale`.
    usual: Floats
    #: Scale of a violation.
    size: Floats
    #: Fixed values at the knots, shape (rows, dimensions, segments + 1); infinite if free.
    wanted: Floats

    @classmethod
    def of(cls, model: PathData, plan: Trajectory, part: slice, least: Floats) -> Self:
        """Return a batch of segments of a plan; `least` is the minimum scale of each order."""
        orders = len(least)
        powers, factors = by_power(plan.coefficients[part]), derivative_matrix(plan.degree, orders)
        shape = orders, *powers.shape[1:]
        units = np.ones((orders, 1, shape[2]))
        units[1:] = 1.0 / plan.durations[part]
        np.multiply.accumulate(units, axis=0, out=units)
        flat = powers.reshape(len(powers), -1)
        begin, known = np.zeros(shape), min(orders, len(powers))
        begin[:known] = np.diagonal(factors)[:known, None, None] * powers[:known]
        begin *= units
        end = (factors @ flat).reshape(shape) * units
        noise = (factors @ np.abs(flat)).reshape(shape) * (ULPS * units)
        wanted = model.conditions[part.start : part.stop + 1].transpose(1, 2, 0)
        fixed = np.where(np.isfinite(wanted), np.abs(wanted), 0.0)[:orders]
        step = np.abs(np.diff(wanted[0]))
        step = np.where(np.isfinite(step), step, model.position_scale[:, None])
        usual = np.maximum((0.5 * np.pi ** np.arange(orders))[:, None, None] * units * step, least)
        np.maximum(
            usual[: len(fixed)],
            np.maximum(fixed[..., :-1], fixed[..., 1:]),
            out=usual[: len(fixed)],
        )
        usual[0] = least[0]
        size = np.maximum(np.maximum(np.abs(begin), np.abs(end)), least)
        np.minimum(size, _SWING * usual, out=size)
        size[0] = least[0]
        return cls(part.start, begin, end, noise, usual, size, wanted)

    def worst(
        self, off: Floats, noise: Floats, usual: Floats, scale: Floats, knot: int, tolerance: float
    ) -> list[_Worst]:
        """Return the largest relative violation in each row of `off`, whose first knot is `knot`."""
        # The tolerance caps the rounding allowance.
        allowance = np.minimum(noise, tolerance * usual)
        share = off / (scale * tolerance + allowance)
        result = []
        # argmax treats NaN as the largest violation.
        for row, position in enumerate(share.reshape(len(share), -1).argmax(axis=1).tolist()):
            axis, column = divmod(position, share.shape[2])
            index = row, axis, column
            result.append(
                _Worst(
                    share[index], off[index], allowance[index], scale[index],
                    self.first + knot + column, axis, bool(noise[index] > allowance[index]),
                )
            )  # fmt: skip
        return result

    def fixed(self, rows: int, side: int, part: slice, tolerance: float) -> list[_Worst]:
        """Return the worst deviations from fixed values at the starts (0) or ends (1) of `part`."""
        values = self.end if side else self.begin
        knots = slice(part.start + side, part.stop + side)
        index = (slice(rows), slice(None), part)
        wanted = self.wanted[:rows, :, knots]
        off = np.where(np.isfinite(wanted), np.abs(values[index] - wanted), 0.0)
        return self.worst(
            off, self.noise[index], self.usual[index], self.size[index], knots.start, tolerance
        )

    def jumps(self, least: Floats, tolerance: float) -> list[_Worst]:
        """Return the worst jumps between neighbouring segments, for each order in `least`."""
        rows = slice(len(least))
        before, after = self.end[rows, :, :-1], self.begin[rows, :, 1:]
        # Values at the knot set the scale. The neighbouring segments contribute only 1e-3, because
        # a segment with large derivatives must not hide a jump at a knot with small ones.
        scale = 1e-3 * np.maximum(self.size[rows, :, :-1], self.size[rows, :, 1:])
        np.maximum(scale, np.maximum(np.abs(before), np.abs(after)), out=scale)
        usual = np.maximum(self.usual[rows, :, :-1], self.usual[rows, :, 1:])
        np.minimum(scale, _SWING * usual, out=scale)
        np.maximum(scale, least, out=scale)
        scale[0] = least[0]
        noise = self.noise[rows, :, :-1] + self.noise[rows, :, 1:]
        return self.worst(np.abs(before - after), noise, usual, scale, 1, tolerance)


def check_knots(model: PathData, plan: Trajectory, tolerance: float) -> Iterator[Check]:
    """Yield the checks of the fixed values and of the continuity, by order of the derivative."""
    shared, count = model.continuity + 1, model.segments
    orders = max(model.conditions.shape[1], shared)
    least = np.stack([model.derivative_scale(order) for order in range(orders)])[:, :, None]
    worst: dict[tuple[int, int], _Worst] = {}

    def update(kind: int, rows: Iterable[int], candidates: list[_Worst]) -> None:
        for order in rows:
            candidate = candidates[order]
            key = order, _ENDS if order == 0 and kind == _INNER else kind
            previous = worst.setdefault(key, candidate)
            if not candidate.share <= previous.share and not np.isnan(previous.share):
                worst[key] = candidate

    for first in range(0, count, SEGMENTS):
        # Consecutive batches share a segment, so that the jump between them is checked too.
        last = min(first + SEGMENTS + 1, count)
        part = _Part.of(model, plan, slice(first, last), least)
        known: NDArray[np.bool_] = np.any(np.isfinite(part.wanted), axis=1)
        size = last - first
        for side, knot, is_end in ((0, 0, first == 0), (1, size, last == count)):
            if is_end:
                rows = [0, *(np.flatnonzero(known[1:, knot]) + 1).tolist()]
                segment = slice(knot - side, knot - side + 1)
                update(_ENDS, rows, part.fixed(rows[-1] + 1, side, segment, tolerance))
        if size > 1:
            rows = np.flatnonzero(known[:, 1:-1].any(axis=1)).tolist()
            if rows:
                for side in (0, 1):
                    inner = slice(1 - side, size - side)
                    update(_INNER, rows, part.fixed(rows[-1] + 1, side, inner, tolerance))
            update(_SHARED, range(shared), part.jumps(least[:shared], tolerance))

    for (order, kind), entry in sorted(worst.items()):
        name, equation = ("waypoints", "24") if (order, kind) == (0, _ENDS) else _KINDS[kind]
        where = f"knot {entry.knot}, axis {entry.axis} (t = {model.times[entry.knot]:g} s)"
        if entry.unclear and entry.share > 1.0:
            where += ", where the digits of the coefficients end: the durations differ too much"
        yield Check.scaled(
            name.format(derivative_name(order)), equation, entry.off, derivative_unit(order),
            where, tolerance, entry.scale, noise=entry.noise,
        )  # fmt: skip
