"""Simulation of a plan's control with another initial state or with disturbed rates."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from ...errors import InvalidData
from ..fields import Array, Real, show
from .algebraic import algebraic_entries, solved_controls
from .definition import entry_names, entry_slices

__all__ = ["Breach", "Simulation", "checked_function", "simulate"]

Floats = NDArray[np.float64]

#: Relative error of a step; the absolute error is the same share of the size of each state.
ERROR = 1e-10
#: Equidistant samples per interval of the plan.
SAMPLES = 33


class Breach(NamedTuple):
    """First violation of a limit.

    Parameters
    ----------
    name : str
        Limited state, control or path constraint, with the entry of a vector.
    time : float
        Time at which the limit is crossed.
    value, limit : float
        First sampled value beyond the limit, and the limit.
    """

    name: str
    time: float
    value: float
    limit: float


@dataclass(frozen=True, eq=False)
class Simulation:
    """Simulated motion of one phase, compared with its plan.

    Parameters
    ----------
    times : ndarray, shape (points,)
        Times from the plan's start; a knot appears twice, as the control may jump there.
    states, controls : ndarray, shape (points, size)
        States and controls of the motion.
    deviation : ndarray, shape (points, states)
        Difference between the states and those of the plan.
    observed : mapping of str to ndarray, shape (points, entries)
        Path constraints, invariants and outputs along the motion.
    breach : Breach, optional
        First violation of a bound of a state or control or of a path constraint; None without one.
    failure : str
        Reason of an early end of the integration; empty if it is complete.
    """

    times: Floats
    states: Floats
    controls: Floats
    deviation: Floats
    observed: Mapping[str, Floats]
    breach: Breach | None
    failure: str


def checked_function(name: str, source: Any, size: int) -> Callable[..., Floats]:
    """Return a function that returns checked values: finite vectors of `size`."""

    def checked(*arguments: Any) -> Floats:
        value = source(*arguments) if callable(source) else source
        return Array((size,)).coerce(name, np.atleast_1d(value), {})

    if not callable(source):
        constant = checked()
        return lambda *_: constant
    return checked


def simulate(
    plan: Any,
    *,
    initial: ArrayLike | Mapping[str, float] | None = None,
    disturbance: Any = None,
    feedback: Callable[[float, Floats, Any], ArrayLike] | None = None,
    tolerance: float = 1e-6,
) -> Simulation:
    """Return the motion of the declared dynamics with a plan's control, over the plan's times.

    Parameters
    ----------
    plan : PhasePlan
        Plan with its declaration.
    initial : array_like, shape (states,), or mapping of str to float, optional
        Initial state. The plan's values are used for names that a mapping omits, and for None.
    disturbance : array_like, shape (states,), or callable, optional
        Addition to the rates: a constant, or a function of time and states.
    feedback : callable, optional
        ``(t, x, plan) -> u`` in place of the plan's control; it saturates at the control's bounds.
        Its entries for algebraic variables are ignored: the equations determine them.
    tolerance : float
        Excess over a limit that is not reported as a breach, relative to the larger of the limit
        and the size of the limited value.

    Returns
    -------
    Simulation
        The motion.

    Raises
    ------
    InvalidData
        The plan lacks its declaration, or an argument has a wrong size or is not finite.

    Notes
    -----
    SciPy's LSODA integrates, with a restart at each knot, where the control may jump. Breaches are
    searched on a grid of 33 points per interval, so shorter ones may be missed.
    """
    if plan.declared is None or plan.values is None:
        plan.observed(plan.start)  # raises with the reason
    phase, p = plan.declared, plan.values
    assert phase is not None and p is not None
    Real(0.0).coerce("tolerance", tolerance, {})
    names, size = plan.state_names, plan.states.size
    current = plan.states(plan.start).copy()
    if isinstance(initial, Mapping):
        for name, value in initial.items():
            if name not in names:
                raise InvalidData(
                    f"initial must name states ({', '.join(names)}), got {show(name)}",
                    field="initial",
                )
            current[names.index(name)] = Real().coerce(f"initial[{name!r}]", value, {})
    elif initial is not None:
        current = checked_function("initial", initial, size)()
    added = checked_function(
        "disturbance", np.zeros(size) if disturbance is None else disturbance, size
    )
    low, high = phase.bounds("controls")
    steer = None if feedback is None else checked_function("feedback", feedback, plan.controls.size)
    solved, algebraic = solved_controls(phase), algebraic_entries(phase.controls)
    knots = plan.states.knots
    scale = np.maximum(phase.stacked("states", "scale"), np.abs(current))
    parts: list[tuple[Floats, Floats, Floats]] = []
    failure = ""
    for k in range(plan.states.intervals):
        begin, end = knots[k], knots[k + 1]

        def control(t: Any, x: Floats, k: int = k, begin: Any = begin, end: Any = end) -> Floats:
            planned: Floats = plan.controls.on(k, [2.0 * (t - begin) / (end - begin) - 1.0])[0]
            if steer is not None:
                steered = np.clip(steer(float(t), x, plan), low, high)
                steered[algebraic] = planned[algebraic]
                planned = steered
            return planned if solved is None else solved(t, x, planned, p).full()[:, 0]

        def rate(t: float, x: Floats, control: Callable[..., Floats] = control) -> Floats:
            rates: Floats = phase.function(t, x, control(t, x), p)[0].full()[:, 0] + added(t, x)
            return rates

        times = np.linspace(begin, end, SAMPLES)
        try:
            solution = solve_ivp(
                rate, (begin, end), current, "LSODA", times, rtol=ERROR, atol=ERROR * scale
            )
        except ValueError as error:
            raise InvalidData(f"the flight cannot be integrated: {error}", field="plan") from None
        x = solution.y.T
        sound = np.isfinite(x).all(axis=1)
        if not solution.success or not sound.all():
            x = x[: int(np.argmin(sound))] if not sound.all() else x
            last = times[len(x) - 1] if len(x) else begin
            failure = f"the integration breaks down after t = {last:.6g}"
        if len(x):
            current, times = x[-1], times[: len(x)]
            parts.append(
                (times, x, np.array([control(*point) for point in zip(times, x, strict=True)]))
            )
        if failure:
            break
    t, x, u = (np.concatenate(column) for column in zip(*parts, strict=True))
    path, invariant, output = phase.observe(t, x, u, p)
    table = np.concatenate([path, invariant, output], axis=1)
    observed = {item.name: table[:, entries] for item, entries in entry_slices(phase.observed)}
    return Simulation(
        times=t,
        states=x,
        controls=u,
        deviation=x - plan.states(t),
        observed=observed,
        breach=_first_breach(plan, t, (x, u, path), tolerance),
        failure=failure,
    )


def _first_breach(
    plan: Any, times: Floats, tables: tuple[Floats, ...], tolerance: float
) -> Breach | None:
    """Return the first violated limit; its time is that at which the chord crosses the limit."""
    breaches: list[Breach] = []
    for what, table in zip(("states", "controls", "paths"), tables, strict=True):
        for item, entries in entry_slices(getattr(plan.declared, what)):
            for k, name in enumerate(entry_names([item])):
                values = table[:, entries.start + k]
                for limit, sign in ((item.lower[k], -1.0), (item.upper[k], 1.0)):
                    if not np.isfinite(limit):
                        continue
                    allowed = tolerance * max(abs(limit), item.scale[k])
                    excess = sign * (values - limit) - allowed
                    rows = np.flatnonzero(~(excess <= 0))
                    if not rows.size:
                        continue
                    j = int(rows[0])
                    time = times[j]
                    if j and np.isfinite(excess[j]):
                        share = excess[j - 1] / (excess[j - 1] - excess[j])
                        time = times[j - 1] + share * (times[j] - times[j - 1])
                    breaches.append(Breach(name, float(time), float(values[j]), float(limit)))
    return min(breaches, key=lambda item: item.time, default=None)
