"""How a small perturbation of a motion grows: where a re-integration has to start afresh."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import casadi
import numpy as np
from numpy.typing import NDArray

from ..programs.compiled import scalar_form
from .sampling import Course

__all__ = ["GROWTH", "Stretch", "stretches"]

Floats = NDArray[np.float64]

#: Growth of a perturbation beyond which a re-integration starts afresh from the plan. No one can
#: integrate an unstable motion over more: rounding alone would grow to the size of the states.
GROWTH = 1e3
#: Pieces of an interval on each of which the motion is linearised once, at least.
PIECES = 4
#: Decay within an interval, in powers of e, from which it is called stiff: an
#: explicit method of order 8 is held to steps of 6 or so by stability alone.
STIFF = 150.0


class Stretch(NamedTuple):
    """A stretch of one interval that is integrated in one go.

    Attributes
    ----------
    interval : int
        The interval of the plan.
    low, high : float
        The stretch of it, in [-1, 1].
    fresh : bool
        Whether it starts from the plan's state, not from where the stretch before ended.
    stiff : bool
        Whether it needs an implicit integrator.
    """

    interval: int
    low: float
    high: float
    fresh: bool
    stiff: bool


@dataclass(frozen=True, eq=False)
class _Scaled:
    """Matrices that may be too large or too small for floating point: exp(log) * part."""

    part: Floats
    log: Floats

    @property
    def size(self) -> Floats:
        """Logarithms of the spectral norms."""
        norms: Floats = np.linalg.norm(self.part, 2, axis=(-2, -1))
        return np.log(np.maximum(norms, 1e-300)) + self.log

    def __matmul__(self, other: _Scaled) -> _Scaled:
        part = self.part @ other.part
        norm = np.maximum(np.abs(part).max(axis=(-2, -1), keepdims=True), 1e-300)
        return _Scaled(part / norm, self.log + other.log + np.log(norm[..., 0, 0]))


@lru_cache(maxsize=64)
def _slope(function: casadi.Function) -> casadi.Function:
    """Return the function of (t, x, u, p) that gives ∂f/∂x, dense."""
    arguments = [casadi.MX.sym(name, function.size1_in(name)) for name in function.name_in()]
    rate = function.call(arguments)[0]
    slope = casadi.densify(casadi.jacobian(rate, arguments[1]))
    return scalar_form(casadi.Function("slope", arguments, [slope]))


def _exponentials(matrices: Floats) -> _Scaled:
    """Return the exponentials, by scaling and squaring with a small Padé approximant."""
    one = np.eye(matrices.shape[-1])
    norm = float(np.abs(matrices).sum(axis=-1).max(initial=0.0))
    squarings = max(0, int(np.ceil(np.log2(norm / 0.25)))) if norm > 0 else 0
    half = matrices * 0.5 ** (squarings + 1)
    square = half @ half / 3.0
    start = np.linalg.solve(one - half + square, one + half + square)
    found = _Scaled(np.asarray(start, float), np.zeros(len(half)))
    for _ in range(squarings):
        found = found @ found
    return found


def stretches(course: Course) -> tuple[tuple[Stretch, ...], float]:
    """Return the stretches to integrate one by one, and the growth over the whole phase.

    The motion is linearised along the plan and the largest growth of a perturbation, measured in
    the size of the states, is followed from the start of a window. A window ends at the last knot
    before it exceeds :data:`GROWTH`; an interval that exceeds it alone is cut into equal parts.
    """
    knots = course.plan.states.knots
    count, size = knots.size - 1, course.plan.states.size
    pieces = max(PIECES, *(nodes.size for nodes in course.plan.states.nodes))
    tau = (2.0 * np.arange(pieces) + 1.0) / pieces - 1.0
    at = course.at(np.repeat(np.arange(count), pieces), np.tile(tau, count))
    slope = _slope(course.phase.function)
    table = slope(at.times[None, :], at.states.T, at.controls.T, course.parameters).full()
    lengths = np.repeat(np.diff(knots) / pieces, pieces)
    with np.errstate(all="ignore"):
        linear = table.reshape(size, -1, size).transpose(1, 0, 2) * lengths[:, None, None]
        linear *= course.state_scale[None, None, :] / course.state_scale[None, :, None]
    # Where the motion has no derivative, such as sqrt(x) at 0, nothing is known of the growth.
    linear = np.where(np.isfinite(linear), linear, 0.0)
    linear = linear.reshape(count, pieces, size, size)
    stiff = np.zeros(count, bool)
    hard = np.abs(linear).sum(axis=-1).max(axis=-1).sum(axis=-1) > STIFF
    stiff[hard] = -np.linalg.eigvals(linear[hard]).real.min(axis=-1).sum(axis=-1) > STIFF
    parts = _exponentials(linear.reshape(-1, size, size))
    part, log = parts.part.reshape(linear.shape), parts.log.reshape(count, pieces)
    each = _Scaled(part[:, 0], log[:, 0])
    for k in range(1, pieces):
        each = _Scaled(part[:, k], log[:, k]) @ each
    limit, alone = np.log(GROWTH), each.size
    found: list[Stretch] = []
    window = whole = _Scaled(np.eye(size), np.zeros(()))
    for k in range(count):
        step = _Scaled(each.part[k], each.log[k])
        whole, window = step @ whole, step @ window
        fresh = k == 0
        if alone[k] > limit:
            cuts = np.linspace(-1.0, 1.0, 1 + int(np.ceil(2.0 * alone[k] / limit)))
            for low, high in pairwise(cuts):
                found.append(Stretch(k, float(low), float(high), True, bool(stiff[k])))
            window = _Scaled(np.eye(size), np.full((), np.inf))  # the next one starts afresh
            continue
        if not window.size <= limit:
            fresh, window = True, step
        found.append(Stretch(k, -1.0, 1.0, fresh, bool(stiff[k])))
    with np.errstate(over="ignore"):
        return tuple(found), float(np.exp(whole.size))
