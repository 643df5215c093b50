"""A guess that obeys the dynamics: the declared motion, flown with controls that people name."""

from __future__ import annotations

import itertools

import casadi
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import LSODA

from ....errors import InvalidData
from ..definition import Guess, entry_names
from .guess import Guessed, sample_guess

__all__ = ["fly"]

Floats = NDArray[np.float64]

#: Relative error of a step; a guess needs no more.
ERROR = 1e-6
#: Times the size of a state beyond which a flight has broken down.
BEYOND = 1e9
#: Steps of a flight, at least, and samples that are kept of it, at most.
STEPS, SAMPLES = 200, 401
#: Evaluations of the rates after which a flight has broken down: it stiffens without end.
MOST = 5_000


def fly(
    phase: Guessed,
    function: casadi.Function,
    steer: casadi.Function,
    guess: Guess,
    parameters: Floats,
) -> Guess:
    """Return the guess whose states are integrated from its first ones with its controls.

    Where no end is given and it is free, it is where the final values are nearest. States that were
    guessed after the flight are those of the guess.

    Parameters
    ----------
    phase : Guessed
        The phase.
    function : casadi.Function
        ``(t, x, u, p) -> (rate, …)``.
    steer : casadi.Function
        ``(t, x, u, p) -> u``: what the guess's controls u become by feedback.
    guess : Guess
        Where the flight starts, and its other controls.
    parameters : ndarray, shape (parameters,)
        Their guesses.

    Raises
    ------
    InvalidData
        A state or its rate is not finite, or grows beyond all bounds, or changes too fast to follow.
    """
    states, controls = phase.states, phase.controls
    earliest, latest = (guess.end,) * 2 if "time" in phase.guessed else phase.bounds[2:]
    names = entry_names(states.values())
    lower, upper, first, last, size = (
        np.concatenate([getattr(one, what) for one in states.values()])
        for what in ("lower", "upper", "final_lower", "final_upper", "scale")
    )
    low, high = (
        np.concatenate([*(getattr(one, side) for one in controls.values()), np.empty(0)])
        for side in ("lower", "upper")
    )
    begin, span = guess.start, guess.end - guess.start

    count = itertools.count()

    def control(t: float, x: Floats) -> Floats:
        place = (t - begin) / span
        u = [np.interp(place, guess.fractions, one) for one in guess.controls.T]
        steered: Floats = np.array(steer(t, x, u, parameters), float).reshape(-1)
        return np.clip(steered, low, high)

    def rate(t: float, x: Floats) -> Floats:
        u = control(t, x)
        found = np.array(function(t, x, u, parameters)[0], float).reshape(-1)
        # Where the rates are finite but change too fast, the fastest state is named.
        bad = ~(np.isfinite(found) & (np.abs(x) < BEYOND * size))
        if bad.any() or next(count) > MOST:
            k = int(np.argmax(np.where(bad, np.inf, np.abs(found) / size)))
            values = ", ".join(f"{n} = {v:.4g}" for n, v in zip(names, x, strict=True))
            raise InvalidData(
                f"the flight of phase {phase.name!r} breaks down at t = {t:.6g}: state {names[k]!r} has the rate "
                f"{found[k]:g} at {values}; give other controls, or a shorter time",
                field="simulate",
            )
        return found

    end = max(guess.end, latest)
    times, rows = [begin], [guess.states[0]]
    solver = LSODA(
        rate, begin, rows[0], end, max_step=(end - begin) / STEPS, rtol=ERROR, atol=ERROR * size
    )
    free = earliest < latest
    while solver.status == "running":
        try:
            solver.step()
        except InvalidData:
            if times[-1] <= max(begin, earliest):
                raise
            break  # an end before this instant is allowed
        times.append(solver.t)
        rows.append(solver.y.copy())
        if free and solver.t >= earliest and ((rows[-1] < lower) | (rows[-1] > upper)).any():
            break
    t, table = np.array(times), np.array(rows)
    if solver.status == "finished":
        t[-1] = end
    if free:
        # Where the end is free, the flight ends where its final values are nearest, within bounds.
        outside = ((table < lower) | (table > upper)).any(axis=1)
        allowed = (t >= earliest) & (t > begin) & (np.cumsum(outside) == 0)
        if not allowed.any():
            allowed = (t >= earliest) & (t > begin)
        miss = (((table - np.clip(table, first, last)) / size) ** 2).sum(axis=1)
        best = np.lexsort((np.abs(t - guess.end), np.where(allowed, miss, np.inf)))[0]
        t, table = t[: best + 1], table[: best + 1]
    keep = np.unique(np.linspace(0, t.size - 1, min(t.size, SAMPLES)).round().astype(int))
    t, table = t[keep], np.clip(table[keep], lower, upper)
    u = np.array([control(*one) for one in zip(t, table, strict=True)])
    at = 0
    for name, one in states.items():
        if name not in phase.flown:
            kept = sample_guess(
                one, phase.guessed[name], (t - begin) / (t[-1] - begin), (begin, t[-1])
            )
            table[:, at : at + one.size] = kept
        at += one.size
    return Guess(begin, float(t[-1]), (t - begin) / (t[-1] - begin), table, u)
