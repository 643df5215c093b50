"""What a trajectory has at the knots against what a model asks: fixed values, and continuity."""

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

#: Units in the last place of the terms of a derivative at a knot that its rounding may reach.
ULPS = 16 * float(np.finfo(float).eps)
#: What the values of a plan may add to the unit of a derivative, as a multiple of the model's own: an
#: optimum may swing far out, and is exact to a share of its values; a plan must not excuse itself.
_SWING = 1e3
#: Segments checked at a time: the numbers of more do not fit into a processor's cache.
SEGMENTS = 1024
#: What is checked of a derivative at knots: the name of each check, and its equation.
_KINDS = (("{} at the ends", "23"), ("{} at inner knots", ""), ("continuity of {}", "25"))
_ENDS, _INNER, _SHARED = range(3)


class _Worst(NamedTuple):
    """Where a condition is broken most, as a share of what is allowed.

    Parameters
    ----------
    share, off, noise, scale : float
        The share, the violation, what is excused of it as rounding, and what it is held against.
    knot, axis : int
        The place.
    unclear : bool
        Whether rounding may be more than what is excused.
    """

    share: float
    off: float
    noise: float
    scale: float
    knot: int
    axis: int
    unclear: bool


class _Part(NamedTuple):
    """Some segments, what is known of their ends, and what is wanted.

    Parameters
    ----------
    first : int
        The first of the segments.
    begin, end : ndarray, shape (orders, dimensions, segments)
        The derivatives 0, 1, … at both ends of each.
    noise : ndarray, shape (orders, dimensions, segments)
        What the coefficients can hold of them: a short segment multiplies their last digit.
    usual : ndarray, shape (orders, dimensions, segments)
        What the model's own data lead to: half a wave over the step and the duration of the segment,
        what is fixed at its ends, and :meth:`~.bounds.PathData.derivative_scale` at least.
    size : ndarray, shape (orders, dimensions, segments)
        What a violation is held against.
    wanted : ndarray, shape (rows, dimensions, segments + 1)
        What is fixed at the knots, else not finite.
    """

    first: int
    begin: Floats
    end: Floats
    noise: Floats
    usual: Floats
    size: Floats
    wanted: Floats

    @classmethod
    def of(cls, model: PathData, plan: Trajectory, part: slice, least: Floats) -> Self:
        """Return some segments of a plan; `least` is the least of what violations are held against."""
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
        self,
        off: Floats,
        noise: Floats,
        usual: Floats,
        scale: Floats,
        knot: int,
        tolerance: float,
    ) -> list[_Worst]:
        """Return where each row of what is `off` from a knot on is worst of what is allowed."""
        # Digits that are missing are excused up to what a tolerance is, and no further.
        excused = np.minimum(noise, tolerance * usual)
        share = off / (scale * tolerance + excused)
        found = []
        # What is no number is the largest.
        for row, place in enumerate(share.reshape(len(share), -1).argmax(axis=1).tolist()):
            axis, column = divmod(place, share.shape[2])
            at = row, axis, column
            found.append(
                _Worst(
                    share[at], off[at], excused[at], scale[at], self.first + knot + column, axis,
                    bool(noise[at] > excused[at]),
                )
            )  # fmt: skip
        return found

    def fixed(self, rows: int, side: int, own: slice, tolerance: float) -> list[_Worst]:
        """Return how far off fixed values are at the starts (0) or ends (1) of some segments."""
        values = self.end if side else self.begin
        at, here = slice(own.start + side, own.stop + side), (slice(rows), slice(None), own)
        wanted = self.wanted[:rows, :, at]
        off = np.where(np.isfinite(wanted), np.abs(values[here] - wanted), 0.0)
        return self.worst(
            off, self.noise[here], self.usual[here], self.size[here], at.start, tolerance
        )

    def jumps(self, least: Floats, tolerance: float) -> list[_Worst]:
        """Return how far off neighbours are from each other in as many orders as `least` has."""
        rows = slice(len(least))
        before, after = self.end[rows, :, :-1], self.begin[rows, :, 1:]
        # The knot's own values, and little of the segments beside it: a wild segment must not
        # excuse a jump where the path is calm.
        scale = 1e-3 * np.maximum(self.size[rows, :, :-1], self.size[rows, :, 1:])
        np.maximum(scale, np.maximum(np.abs(before), np.abs(after)), out=scale)
        usual = np.maximum(self.usual[rows, :, :-1], self.usual[rows, :, 1:])
        np.minimum(scale, _SWING * usual, out=scale)
        np.maximum(scale, least, out=scale)
        scale[0] = least[0]
        noise = self.noise[rows, :, :-1] + self.noise[rows, :, 1:]
        return self.worst(np.abs(before - after), noise, usual, scale, 1, tolerance)


def check_knots(model: PathData, plan: Trajectory, tolerance: float) -> Iterator[Check]:
    """Yield the fixed values and the continuity of every derivative, from the lowest."""
    shared, count = model.continuity + 1, model.segments
    orders = max(model.conditions.shape[1], shared)
    least = np.stack([model.derivative_scale(order) for order in range(orders)])[:, :, None]
    worst: dict[tuple[int, int], _Worst] = {}

    def keep(kind: int, rows: Iterable[int], found: list[_Worst]) -> None:
        for order in rows:
            one = found[order]
            key = order, _ENDS if order == 0 and kind == _INNER else kind
            old = worst.setdefault(key, one)
            if not one.share <= old.share and not np.isnan(old.share):
                worst[key] = one

    for first in range(0, count, SEGMENTS):
        # The last segment of a part is the first of the next one, for the jump between them.
        last = min(first + SEGMENTS + 1, count)
        part = _Part.of(model, plan, slice(first, last), least)
        known: NDArray[np.bool_] = np.any(np.isfinite(part.wanted), axis=1)
        own = last - first
        for side, knot, here in ((0, 0, first == 0), (1, own, last == count)):
            if here:
                rows = [0, *(np.flatnonzero(known[1:, knot]) + 1).tolist()]
                place = slice(knot - side, knot - side + 1)
                keep(_ENDS, rows, part.fixed(rows[-1] + 1, side, place, tolerance))
        if own > 1:
            rows = np.flatnonzero(known[:, 1:-1].any(axis=1)).tolist()
            if rows:
                for side in (0, 1):
                    place = slice(1 - side, own - side)
                    keep(_INNER, rows, part.fixed(rows[-1] + 1, side, place, tolerance))
            keep(_SHARED, range(shared), part.jumps(least[:shared], tolerance))

    for (order, kind), one in sorted(worst.items()):
        name, equation = ("waypoints", "24") if (order, kind) == (0, _ENDS) else _KINDS[kind]
        where = f"knot {one.knot}, axis {one.axis} (t = {model.times[one.knot]:g} s)"
        if one.unclear and one.share > 1.0:
            where += ", where the digits of the coefficients end: the durations differ too much"
        yield Check.scaled(
            name.format(derivative_name(order)), equation, one.off, derivative_unit(order), where,
            tolerance, one.scale, noise=one.noise,
        )  # fmt: skip
