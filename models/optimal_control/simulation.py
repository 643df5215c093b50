"""What a plan's control makes of the motion when the start or the rates are not those of the plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from ...errors import InvalidData
from ..fields import Array, Real, show

__all__ = ["Breach", "Simulation", "simulate"]

Floats = NDArray[np.float64]

#: Relative error of a step; the absolute one is as much of the size of each state.
ERROR = 1e-10
#: Samples in an interval of the plan, evenly spread.
SAMPLES = 33


class Breach(NamedTuple):
    """Where a limit is first broken: whose, when, the value there and the limit."""

    name: str
    time: float
    value: float
    limit: float


@dataclass(frozen=True, eq=False)
class Simulation:
    """A flight of one phase beside its plan.

    Parameters
    ----------
    times : ndarray, shape (points,)
        Times from the plan's start; a knot appears twice, where the control may jump.
    states, controls : ndarray, shape (points, size)
        The motion, and what moved it.
    deviation : ndarray, shape (points, states)
        What the motion differs by from the plan's.
    observed : mapping of str to ndarray, shape (points, entries)
        Path constraints, invariants and outputs along the motion.
    breach : Breach, optional
        Which state's or control's bound or path constraint is broken first; None where none is.
    failure : str
        Why the flight ended before the plan; empty where it did not.
    """

    times: Floats
    states: Floats
    controls: Floats
    deviation: Floats
    observed: Mapping[str, Floats]
    breach: Breach | None
    failure: str


def _callable(name: str, given: Any, size: int) -> Callable[..., Floats]:
    """Return a function whose values are checked: finite vectors of `size`."""

    def checked(*arguments: Any) -> Floats:
        value = given(*arguments) if callable(given) else given
        found: Floats = Array(("size",)).coerce(
            name, np.atleast_1d(value), {"size": (size, "the plan")}
        )
        return found

    if not callable(given):
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
    """Return the flight of the declared dynamics with a plan's control, over the plan's times.

    Parameters
    ----------
    plan : PhasePlan
        A plan that knows its declaration.
    initial : array_like, shape (states,), or mapping of str to float, optional
        The first state; names that a mapping leaves out, and all without one, are the plan's.
    disturbance : array_like, shape (states,), or callable, optional
        What is added to the rates: a constant, or a function of time and states.
    feedback : callable, optional
        ``(t, x, plan) -> u`` in place of the plan's control; it saturates at the control's bounds.
    tolerance : float
        Excess over a limit that is no breach, relative to the larger of the limit and the size of
        what is limited.

    Raises
    ------
    InvalidData
        The plan does not know its declaration, or an argument has a wrong size or is not finite.

    Notes
    -----
    LSODA of SciPy integrates, anew from each knot, where the control may jump. A breach is looked
    for on a grid of 33 points an interval, so one that is shorter may pass unseen.
    """
    if plan.declared is None or plan.values is None:
        plan.observed(plan.start)  # says what is missing
    phase, p = plan.declared, plan.values
    assert phase is not None and p is not None
    Real(0.0).coerce("tolerance", tolerance, {})
    names, size = plan.state_names, plan.states.size
    here = plan.states(plan.start).copy()
    if isinstance(initial, Mapping):
        for name, value in initial.items():
            if name not in names:
                raise InvalidData(
                    f"initial must name states ({', '.join(names)}), got {show(name)}",
                    field="initial",
                )
            here[names.index(name)] = Real().coerce(f"initial[{name!r}]", value, {})
    elif initial is not None:
        here = _callable("initial", initial, size)()
    added = _callable("disturbance", np.zeros(size) if disturbance is None else disturbance, size)
    low, high = phase.bounds("controls")
    steer = None if feedback is None else _callable("feedback", feedback, plan.controls.size)
    knots = plan.states.knots
    scale = np.maximum(phase.stacked("states", "scale"), np.abs(here))
    parts: list[tuple[Floats, Floats, Floats]] = []
    failure = ""
    for k in range(plan.states.intervals):
        begin, end = knots[k], knots[k + 1]

        def control(t: Any, x: Floats, k: int = k, begin: Any = begin, end: Any = end) -> Floats:
            if steer is not None:
                return np.clip(steer(float(t), x, plan), low, high)
            planned: Floats = plan.controls.on(k, [2.0 * (t - begin) / (end - begin) - 1.0])[0]
            return planned

        def rate(t: float, x: Floats, control: Callable[..., Floats] = control) -> Floats:
            found: Floats = phase.function(t, x, control(t, x), p)[0].full()[:, 0] + added(t, x)
            return found

        times = np.linspace(begin, end, SAMPLES)
        try:
            flown = solve_ivp(
                rate, (begin, end), here, "LSODA", times, rtol=ERROR, atol=ERROR * scale
            )
        except ValueError as error:
            raise InvalidData(f"the flight cannot be integrated: {error}", field="plan") from None
        x = flown.y.T
        sound = np.isfinite(x).all(axis=1)
        if not flown.success or not sound.all():
            x = x[: int(np.argmin(sound))] if not sound.all() else x
            at = times[len(x) - 1] if len(x) else begin
            failure = f"the integration breaks down after t = {at:.6g}"
        if len(x):
            here, times = x[-1], times[: len(x)]
            parts.append(
                (times, x, np.array([control(*one) for one in zip(times, x, strict=True)]))
            )
        if failure:
            break
    t, x, u = (np.concatenate(column) for column in zip(*parts, strict=True))
    path, invariant, output = phase.observe(t, x, u, p)
    observed, at = {}, 0
    table = np.concatenate([path, invariant, output], axis=1)
    for one in phase.observed:
        observed[one.name] = table[:, at : at + one.size]
        at += one.size
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
    """Return the first limit that is broken; its instant is where the chord crosses the limit."""
    found: list[Breach] = []
    for what, table in zip(("states", "controls", "paths"), tables, strict=True):
        at = 0
        for one in getattr(plan.declared, what):
            for k in range(one.size):
                values = table[:, at]
                at += 1
                name = one.name if one.size == 1 else f"{one.name}[{k}]"
                for limit, sign in ((one.lower[k], -1.0), (one.upper[k], 1.0)):
                    if not np.isfinite(limit):
                        continue
                    allowed = tolerance * max(abs(limit), one.scale[k])
                    excess = sign * (values - limit) - allowed
                    rows = np.flatnonzero(~(excess <= 0))
                    if not rows.size:
                        continue
                    j = int(rows[0])
                    time = times[j]
                    if j and np.isfinite(excess[j]):
                        share = excess[j - 1] / (excess[j - 1] - excess[j])
                        time = times[j - 1] + share * (times[j] - times[j - 1])
                    found.append(Breach(name, float(time), float(values[j]), float(limit)))
    return min(found, key=lambda one: one.time, default=None)
