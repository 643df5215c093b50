"""Re-integration of a plan: the motion that its control produces, independent of its states.

The control is integrated with the explicit Runge-Kutta method of order 8 of Dormand and Prince
(DOP853: Hairer, Nørsett and Wanner, "Solving Ordinary Differential Equations I", section II.5), or
with Radau IIA of order 5 if the motion is stiff. Both use the plan's mesh only to stop at knots, at
which a control may jump, and at the instants at which saturation limits it. An unstable motion is integrated in windows, which start from the plan.
Algebraic equations are solved by Newton's method at every evaluation of the rates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import casadi
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853, Radau

from ..programs.compiled import scalar_form
from .algebraic import solved_controls
from .definition import Phase
from .sampling import Course, Instants

__all__ = ["Reintegration", "integrate_anew"]

Floats = NDArray[np.float64]

#: Relative error of a step; the absolute error is the same share of the size of the states.
ERROR = 1e-12
#: Relative error for a stiff motion, integrated with order 5.
ERROR_STIFF = 1e-10
#: First step of a phase, as a share of its first interval.
FIRST = 1e-3
#: Largest number of steps in a phase, and number of steps of the explicit method in a part of an interval, at
#: least and per instant of the grid, after which a motion that has become stiff apart from the plan is continued
#: with the implicit method.
STEPS, EXPLICIT, EXPLICIT_PER_POINT = 50_000, 300, 10
#: Relative change of a state for differences of rates. The explicit method is stable for decays up to exp(-6) per
#: step; accurate steps have less than this one.
DIFFERENCE, DECAY = 1e-7, 2.0
#: Distances ahead of a failed step at which a non-finite rate is searched, as shares of an interval.
AHEAD = 10.0 ** np.arange(-12.0, -1.0)
#: Growth of a perturbation beyond which a re-integration restarts from the plan. Over a longer
#: window of an unstable motion, rounding errors would grow to the size of the states.
GROWTH = 1e3
#: Smallest number of linearisations per interval.
PIECES = 4
#: Decay within an interval, as a power of e, above which it is treated as stiff: stability limits
#: the steps of an explicit method of order 8 to about 6.
STIFF = 150.0


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


def integrate_anew(course: Course) -> Reintegration:
    """Return the re-integrated motion of one phase of a plan.

    The integrals are those of the integrands along that motion.
    """
    parts, growth = _stretches(course)
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
    scale = np.concatenate([course.sizes.states, course.sizes.integrals])
    scale = np.where(np.isfinite(scale), scale, 1.0)
    result = np.full((at.times.size, scale.size), np.inf)
    rate = _Rate(course)
    current, step, left = np.zeros(scale.size), 0.0, STEPS
    windows, failure, broken, begin = 0, "", False, 0
    with np.errstate(all="ignore"):
        kinks = course.plan.controls.saturations(course.sizes.controls)
        for part, count in zip(parts, counts, strict=True):
            rows = slice(begin, begin + count)
            if part.fresh or broken:
                windows += 1
                current[:size] = at.states[begin]
            result[begin] = current
            begin += count
            rate.enter(part.interval)
            times, stops = at.times[rows], kinks.get(part.interval, np.empty(0))
            stops = np.append(stops[(stops > times[0]) & (stops < times[-1])], times[-1])
            taken, step, reason = _advance(
                rate, part.stiff, times, stops, scale, step, result[rows], left
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


@lru_cache(maxsize=64)
def _motion(phase: Phase) -> tuple[casadi.Function, casadi.Function]:
    """Return functions of (t, x, u, p): rates and integrands in one column, and the rates' Jacobian by x.

    The algebraic equations are solved for the algebraic variables in u, which are only the start of
    Newton's method.
    """
    function, solved = phase.function, solved_controls(phase)
    arguments = [casadi.MX.sym(name, function.size1_in(name)) for name in function.name_in()]
    t, x, u, p = arguments
    rate, _, integrand, _ = function(t, x, u if solved is None else solved(t, x, u, p), p)
    results = {
        "motion": casadi.vertcat(rate, integrand),
        "slope": casadi.jacobian(rate, arguments[1]),
    }
    motion, slope = (
        scalar_form(casadi.Function(name, arguments, [casadi.densify(result)]))
        for name, result in results.items()
    )
    return motion, slope


class _Rate:
    """Right-hand side of states and integrals, with the control of one interval.

    It is evaluated some thousand times per second, so CasADi reads the arguments from buffers in
    place.
    """

    def __init__(self, course: Course) -> None:
        function = _motion(course.phase)[0]
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
        integrals = (f"integral {k + 1}" for k in range(course.phase.integrals))
        self._names = (*course.phase.state_names, *integrals)

    def enter(self, interval: int) -> None:
        """Select the interval of the control."""
        low, high = self.controls.knots[interval : interval + 2]
        self._interval, self._low, self._factor = interval, float(low), 2.0 / float(high - low)

    def __call__(self, t: float, y: Floats) -> Floats:
        if self._control.size:
            place = (t - self._low) * self._factor - 1.0
            self._control[:] = self.controls.value(self._interval, place)
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
    rate: _Rate, stiff: bool, times: Floats, stops: Floats, scale: Floats, step: float, out: Floats,
    left: int,
) -> tuple[int, float, str]:  # fmt: skip
    """Integrate from ``out[0]`` at ``times[0]`` and fill `out`. No step crosses one of the `stops`.

    Returns the number of steps, the next step size, and the reason of a breakdown or ``""``.
    """
    begin, ends = float(times[0]), [float(stop) for stop in stops]
    end = ends[-1]

    def solver_at(t: float, y: Floats, bound: float, ahead: float) -> Any:
        # SciPy's own estimate of the first step may be NaN, which it would then retry for ever.
        first = min(ahead, bound - t)
        if not stiff:
            atol = ERROR * scale
            return DOP853(rate, t, y, bound, rtol=ERROR, atol=atol, first_step=first)
        # Within a step, the implicit method interpolates with order 3: 2e-6 off if one step is a fifth of cos(t).
        most_step, atol = (end - begin) / times.size, ERROR_STIFF * scale
        first = min(first, most_step)
        return Radau(
            rate, t, y, bound, rtol=ERROR_STIFF, atol=atol, first_step=first, max_step=most_step
        )

    first = step if step > 0 else FIRST * (end - begin)
    solver = solver_at(begin, out[0].copy(), ends.pop(0), first)
    known, most = 1, max(EXPLICIT, EXPLICIT_PER_POINT * times.size)
    for taken in range(1, left + 1):
        if taken % most == 0 and not stiff and _decays_within_a_step(rate, solver, scale):
            stiff = True
            solver = solver_at(solver.t, solver.y, solver.t_bound, solver.h_abs)
        proposed = solver.h_abs
        try:
            solver.step()
            broken = solver.status == "failed" or not np.isfinite(solver.y).all()
        except ValueError:  # the implicit method encountered a matrix that is not finite
            broken = True
        if broken:
            return taken, 0.0, rate.breakdown(solver.t, solver.y, scale, end - begin)
        upto = int(np.searchsorted(times, solver.t, side="right"))
        if upto > known:
            if upto - known > 1 or times[known] != solver.t:
                out[known:upto] = solver.dense_output()(times[known:upto]).T
            if times[upto - 1] == solver.t:
                out[upto - 1] = solver.y
            known = upto
        if solver.status == "finished":
            # The stop shortens the last step, so the proposed step describes the motion better.
            solver.h_abs = float(max(proposed, solver.h_abs))
            if not ends:
                return taken, solver.h_abs, ""
            solver.t_bound, solver.status = ends.pop(0), "running"
    return left, 0.0, f"the integration is given up at t = {solver.t:.6g} after {STEPS} steps"


def _decays_within_a_step(rate: Callable[..., Floats], solver: Any, scale: Floats) -> bool:
    """Return whether stability limits the step of the explicit method, by the eigenvalues of the Jacobian."""
    changes = np.diag(DIFFERENCE * np.maximum(np.abs(solver.y), scale))
    now = rate(solver.t, solver.y)
    columns = [(rate(solver.t, solver.y + change) - now) / change.max() for change in changes]
    jacobian = np.column_stack(columns)
    if not np.isfinite(jacobian).all():
        return False
    return bool(np.linalg.eigvals(jacobian).real.min() * solver.h_abs < -DECAY)


# -- windows -----------------------------------------------------------------------------------------


class _Stretch(NamedTuple):
    """Part of one interval that is integrated in one go, from `low` to `high` in [-1, 1].

    A `fresh` one starts from the plan's state rather than from the previous stretch. A `stiff` one
    needs an implicit integrator.
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

    def __getitem__(self, index: Any) -> _Scaled:
        return _Scaled(self.part[index], self.log[index])

    def __matmul__(self, other: _Scaled) -> _Scaled:
        part = self.part @ other.part
        norm = np.maximum(np.abs(part).max(axis=(-2, -1), keepdims=True), 1e-300)
        return _Scaled(part / norm, self.log + other.log + np.log(norm[..., 0, 0]))


def _exponentials(matrices: Floats) -> _Scaled:
    """Return the matrix exponentials, by scaling and squaring with a Padé approximant."""
    identity = np.eye(matrices.shape[-1])
    norm = float(np.abs(matrices).sum(axis=-1).max(initial=0.0))
    squarings = max(0, int(np.ceil(np.log2(norm / 0.25)))) if norm > 0 else 0
    half = matrices * 0.5 ** (squarings + 1)
    square = half @ half / 3.0
    start = np.linalg.solve(identity - half + square, identity + half + square)
    result = _Scaled(np.asarray(start, float), np.zeros(matrices.shape[:-2]))
    for _ in range(squarings):
        result = result @ result
    return result


def _stretches(course: Course) -> tuple[list[_Stretch], float]:
    """Return the stretches to integrate one by one, and the growth over the whole phase.

    The motion is linearised along the plan. A window ends at the last knot before the accumulated growth of a
    perturbation, relative to the size of the states, exceeds :data:`GROWTH`. An interval that exceeds it alone is
    cut into equal parts.
    """
    plan, scale = course.plan.states, course.sizes.states
    count, size = plan.intervals, plan.size
    pieces = max(PIECES, *(nodes.size for nodes in plan.nodes))
    tau = (2.0 * np.arange(pieces) + 1.0) / pieces - 1.0
    at = course.at(np.repeat(np.arange(count), pieces), np.tile(tau, count))
    slope = _motion(course.phase)[1]
    table = slope(at.times[None, :], at.states.T, at.controls.T, course.parameters).full()
    with np.errstate(all="ignore"):
        linear = table.reshape(size, count, pieces, size).transpose(1, 2, 0, 3) * scale
        linear *= (np.diff(plan.knots) / pieces)[:, None, None, None] / scale[:, None]
    # The growth is unknown if a derivative does not exist, for example that of sqrt(x) at 0.
    linear = np.where(np.isfinite(linear), linear, 0.0)
    stiff = np.abs(linear).sum(axis=-1).max(axis=-1).sum(axis=-1) > STIFF
    stiff[stiff] = -np.linalg.eigvals(linear[stiff]).real.min(axis=-1).sum(axis=-1) > STIFF
    parts = _exponentials(linear)
    each = parts[:, 0]
    for k in range(1, pieces):
        each = parts[:, k] @ each
    limit, alone = np.log(GROWTH), each.size
    result: list[_Stretch] = []
    window = whole = _Scaled(np.eye(size), np.zeros(()))
    for k in range(count):
        whole, window = each[k] @ whole, each[k] @ window
        fresh = k == 0
        if alone[k] > limit:
            cuts = np.linspace(-1.0, 1.0, 1 + int(np.ceil(2.0 * alone[k] / limit))).tolist()
            result += [_Stretch(k, low, high, True, bool(stiff[k])) for low, high in pairwise(cuts)]
            window = _Scaled(np.eye(size), np.full((), np.inf))  # the next one starts afresh
            continue
        if not window.size <= limit:
            fresh, window = True, each[k]
        result.append(_Stretch(k, -1.0, 1.0, fresh, bool(stiff[k])))
    with np.errstate(over="ignore"):
        return result, float(np.exp(whole.size))
