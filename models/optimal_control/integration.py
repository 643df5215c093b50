"""Re-integration of a plan: the motion that its control produces, independent of its states.

The control is integrated with the explicit Runge-Kutta method of order 8 of Dormand and Prince
(DOP853: Hairer, Nørsett and Wanner, "Solving Ordinary Differential Equations I", section II.5), or
with Radau IIA of order 5 if the motion is stiff. Both use the plan's mesh only to stop at knots, at
which a control may jump.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853, Radau

from ..programs.compiled import scalar_form
from .growth import stretches
from .lagrange import barycentric_weights
from .sampling import Course, Instants

__all__ = ["Reintegration", "integrate_anew"]

Floats = NDArray[np.float64]

#: Relative error of a step; the absolute error is the same share of the size of the states.
ERROR = 1e-12
#: Relative error for a stiff motion, integrated with order 5.
ERROR_STIFF = 1e-10
#: First step of a phase, as a share of its first interval.
FIRST = 1e-3
#: Largest number of steps in a phase.
STEPS = 50_000
#: Distances ahead of a failed step at which a non-finite rate is searched, as shares of an interval.
AHEAD = 10.0 ** np.arange(-12.0, -1.0)


@dataclass(frozen=True, eq=False)
class Reintegration:
    """Motion that a plan's control produces from the plan's initial state.

    Parameters
    ----------
    times : ndarray, shape (points,)
        Times on a dense grid; a knot appears twice, as the end and the start of an interval.
    states : ndarray, shape (points, states)
        Integrated states; not finite between a breakdown of the integration and the next restart.
    deviation : ndarray, shape (points, states)
        Difference from the plan's states.
    windows : int
        Number of integrations that start from a state of the plan: more than 1 if the motion is too
        unstable to be integrated from end to end, or after a breakdown.
    growth : float
        Upper estimate of the growth of a perturbation of the initial state over the phase.
    integrals : ndarray, shape (integrals,)
        Integrals over the phase along the integrated motion; NaN after a breakdown.
    failure : str
        Reason of a breakdown of the integration; empty if there was none.
    at : Instants
        Grid in terms of the plan's intervals.
    """

    times: Floats
    states: Floats
    deviation: Floats
    windows: int
    growth: float
    integrals: Floats
    failure: str
    at: Instants


@lru_cache(maxsize=64)
def _flat(function: casadi.Function) -> casadi.Function:
    """Return rates and integrands as a function of (t, x, u, p) with one dense column."""
    arguments = [casadi.MX.sym(name, function.size1_in(name)) for name in function.name_in()]
    rate, _, integrand, _ = function.call(arguments)
    rates = casadi.densify(casadi.vertcat(rate, integrand))
    return scalar_form(casadi.Function("motion", arguments, [rates]))


class _Rate:
    """Right-hand side of states and integrals, with the control of one interval.

    It is evaluated some thousand times per second, so CasADi reads the arguments from buffers in
    place.
    """

    def __init__(self, course: Course) -> None:
        function = _flat(course.phase.function)
        self.controls = course.plan.controls
        self._time, self._state = np.zeros(1), np.zeros(course.plan.states.size)
        self._control = np.zeros(self.controls.size)
        self._parameters = np.array(course.parameters)
        self._result = np.zeros(function.size1_out(0))
        buffer: Any
        buffer, self._evaluate = function.buffer()
        arguments_of = (self._time, self._state, self._control, self._parameters)
        for k, array in enumerate(arguments_of):
            if array.size:
                buffer.set_arg(k, array.data)
        buffer.set_res(0, self._result.data)
        self._buffer = buffer  # the evaluation uses the buffer without holding a reference
        self._known: dict[int, Floats] = {}
        integrals = (f"integral {k + 1}" for k in range(course.phase.integrals))
        self._names = (*course.phase.state_names, *integrals)

    def enter(self, interval: int) -> None:
        """Select the interval of the control."""
        low, high = self.controls.knots[interval : interval + 2]
        self._nodes = self.controls.nodes[interval]
        self._table = self.controls.values[interval]
        if id(self._nodes) not in self._known:
            self._known[id(self._nodes)] = barycentric_weights(self._nodes)
        self._weights = self._known[id(self._nodes)]
        self._low, self._factor = float(low), 2.0 / float(high - low)

    def __call__(self, t: float, y: Floats) -> Floats:
        if self._control.size:
            distance = ((t - self._low) * self._factor - 1.0) - self._nodes
            if distance.all():
                share = self._weights / distance
                value = share @ self._table / share.sum()
            else:
                value = self._table[int(np.flatnonzero(distance == 0.0)[0])]
            if self.controls.lower is not None:
                value = np.maximum(value, self.controls.lower)
            if self.controls.upper is not None:
                value = np.minimum(value, self.controls.upper)
            self._control[:] = value
        self._time[0] = t
        self._state[:] = y[: self._state.size]
        self._evaluate()
        return self._result.copy()

    def breakdown(self, t: float, y: Floats, scale: Floats, length: float) -> str:
        """Return the time, the state and the reason of a breakdown of the integration."""
        now = self(t, y)
        for ahead in (0.0, *(length * AHEAD)):  # a rate may cease to exist slightly later
            bad = np.flatnonzero(~np.isfinite(self(t + ahead, y + ahead * now) if ahead else now))
            if bad.size:
                why = f"the rate of {self._names[bad[0]]} is not finite"
                break
        else:
            k = int(np.abs(now / scale).argmax())
            why = f"{self._names[k]} is {y[k]:.3g} and changes at a rate of {now[k]:.3g}"
        return f"the integration breaks down at t = {t:.6g}: {why}"


def _advance(
    rate: _Rate, stiff: bool, times: Floats, scale: Floats, step: float, out: Floats, left: int
) -> tuple[int, float, str]:
    """Integrate from ``out[0]`` at ``times[0]`` and fill `out`.

    Returns the number of steps, the next step size, and the reason of a breakdown or ``""``.
    """
    method, error = (Radau, ERROR_STIFF) if stiff else (DOP853, ERROR)
    begin, end = float(times[0]), float(times[-1])
    # SciPy's own estimate of the first step may be NaN, which it would then retry for ever.
    first = min(step if step > 0 else FIRST * (end - begin), end - begin)
    solver = method(
        rate, begin, out[0].copy(), end, rtol=error, atol=error * scale, first_step=first
    )
    known = 1
    for taken in range(1, left + 1):
        proposed = solver.h_abs
        try:
            solver.step()
        except ValueError:  # the implicit method encountered a matrix that is not finite
            return taken, 0.0, rate.breakdown(solver.t, solver.y, scale, end - begin)
        if solver.status == "failed" or not np.isfinite(solver.y).all():
            return taken, 0.0, rate.breakdown(solver.t, solver.y, scale, end - begin)
        upto = int(np.searchsorted(times, solver.t, side="right"))
        if upto > known:
            if upto - known > 1 or times[known] != solver.t:
                out[known:upto] = solver.dense_output()(times[known:upto]).T
            if times[upto - 1] == solver.t:
                out[upto - 1] = solver.y
            known = upto
        if solver.status == "finished":
            # The knot shortens the last step, so the proposed step describes the motion better.
            return taken, float(max(proposed, solver.h_abs)), ""
    return left, 0.0, f"the integration is given up at t = {solver.t:.6g} after {STEPS} steps"


def integrate_anew(course: Course) -> Reintegration:
    """Return the re-integrated motion of one phase of a plan.

    The integrals are those of the integrands along that motion.
    """
    parts, growth = stretches(course)
    places = []
    for part in parts:
        grid = course.places[part.interval]
        inner = grid[(grid > part.low) & (grid < part.high)]
        places.append(np.concatenate([[part.low], inner, [part.high]]))
    counts = [tau.size for tau in places]
    at = course.dense
    if len(parts) > course.plan.states.intervals:  # cut intervals: the cuts are grid points, too
        intervals = np.repeat(np.array([part.interval for part in parts]), counts)
        at = course.at(intervals, np.concatenate(places))
    size = course.plan.states.size
    scale = np.concatenate([course.state_scale, course.sizes.integrals])
    scale = np.where(np.isfinite(scale), scale, 1.0)
    result = np.full((at.times.size, scale.size), np.inf)
    rate = _Rate(course)
    current, step, left = np.zeros(scale.size), 0.0, STEPS
    windows, failure, broken, begin = 0, "", False, 0
    with np.errstate(all="ignore"):
        for part, count in zip(parts, counts, strict=True):
            rows = slice(begin, begin + count)
            if part.fresh or broken:
                windows += 1
                current[:size] = at.states[begin]
            result[begin] = current
            begin += count
            rate.enter(part.interval)
            taken, step, reason = _advance(
                rate, part.stiff, at.times[rows], scale, step, result[rows], left
            )
            left, broken, failure = left - taken, bool(reason), failure or reason
            if not reason:
                current = result[begin - 1].copy()
    states = result[:, :size]
    return Reintegration(
        times=at.times,
        states=states,
        deviation=states - at.states,
        windows=windows,
        growth=growth,
        integrals=np.full(scale.size - size, np.nan) if failure else current[size:],
        failure=failure,
        at=at,
    )
