"""Growth of perturbations of a motion, and the windows of its re-integration."""

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

#: Growth of a perturbation beyond which a re-integration restarts from the plan. Over a longer
#: window of an unstable motion, rounding errors would grow to the size of the states.
GROWTH = 1e3
#: Smallest number of linearisations per interval.
PIECES = 4
#: Decay within an interval, as a power of e, above which it is treated as stiff: stability limits
#: the steps of an explicit method of order 8 to about 6.
STIFF = 150.0


class Stretch(NamedTuple):
    """Part of one interval that is integrated in one go.

    Attributes
    ----------
    interval : int
        Index of the plan's interval.
    low, high : float
        Range within the interval, in [-1, 1].
    fresh : bool
        Whether the integration starts from the plan's state rather than from the previous stretch.
    stiff : bool
        Whether an implicit integrator is needed.
    """

    interval: int
    low: float
    high: float
    fresh: bool
    stiff: bool


@dataclass(frozen=True, eq=False)
class _Scaled:
    """Matrices ``exp(log) * part``, whose entries may exceed the range of floats."""

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
    """Return the dense Jacobian ∂f/∂x as a function of (t, x, u, p)."""
    arguments = [casadi.MX.sym(name, function.size1_in(name)) for name in function.name_in()]
    rate = function.call(arguments)[0]
    slope = casadi.densify(casadi.jacobian(rate, arguments[1]))
    return scalar_form(casadi.Function("slope", arguments, [slope]))


def _exponentials(matrices: Floats) -> _Scaled:
    """Return the matrix exponentials, by scaling and squaring with a Padé approximant."""
    identity = np.eye(matrices.shape[-1])
    norm = float(np.abs(matrices).sum(axis=-1).max(initial=0.0))
    squarings = max(0, int(np.ceil(np.log2(norm / 0.25)))) if norm > 0 else 0
    half = matrices * 0.5 ** (squarings + 1)
    square = half @ half / 3.0
    start = np.linalg.solve(identity - half + square, identity + half + square)
    result = _Scaled(np.asarray(start, float), np.zeros(len(half)))
    for _ in range(squarings):
        result = result @ result
    return result


def stretches(course: Course) -> tuple[tuple[Stretch, ...], float]:
    """Return the stretches to integrate one by one, and the growth over the whole phase.

    The motion is linearised along the plan. The largest growth of a perturbation, relative to the
    size of the states, is accumulated from the start of a window. A window ends at the last knot
    before the growth exceeds :data:`GROWTH`. An interval that exceeds it alone is cut into equal
    parts.

    Returns
    -------
    stretches : tuple of Stretch
        Stretches in order.
    growth : float
        Upper estimate of the growth of a perturbation of the first state over the phase.
    """
    knots = course.plan.states.knots
    count, size = knots.size - 1, course.plan.states.size
    pieces = max(PIECES, *(nodes.size for nodes in course.plan.states.nodes))
    tau = (2.0 * np.arange(pieces) + 1.0) / pieces - 1.0
    instants = course.at(np.repeat(np.arange(count), pieces), np.tile(tau, count))
    slope = _slope(course.phase.function)
    table = slope(
        instants.times[None, :], instants.states.T, instants.controls.T, course.parameters
    ).full()
    lengths = np.repeat(np.diff(knots) / pieces, pieces)
    with np.errstate(all="ignore"):
        linear = table.reshape(size, -1, size).transpose(1, 0, 2) * lengths[:, None, None]
        linear *= course.state_scale[None, None, :] / course.state_scale[None, :, None]
    # The growth is unknown if a derivative does not exist, for example that of sqrt(x) at 0.
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
    result: list[Stretch] = []
    window = whole = _Scaled(np.eye(size), np.zeros(()))
    for k in range(count):
        step = _Scaled(each.part[k], each.log[k])
        whole, window = step @ whole, step @ window
        fresh = k == 0
        if alone[k] > limit:
            cuts = np.linspace(-1.0, 1.0, 1 + int(np.ceil(2.0 * alone[k] / limit)))
            for low, high in pairwise(cuts):
                result.append(Stretch(k, float(low), float(high), True, bool(stiff[k])))
            window = _Scaled(np.eye(size), np.full((), np.inf))  # the next one starts afresh
            continue
        if not window.size <= limit:
            fresh, window = True, step
        result.append(Stretch(k, -1.0, 1.0, fresh, bool(stiff[k])))
    with np.errstate(over="ignore"):
        return tuple(result), float(np.exp(whole.size))
