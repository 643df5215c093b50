"""Guesses that satisfy the dynamics: the declared motion with guessed controls."""

from __future__ import annotations

import itertools

import casadi
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import LSODA

from ....errors import InvalidData
from ..definition import Guess, entry_names, entry_slices, stacked
from .guess import Guessed, sample_guess

__all__ = ["fly"]

Floats = NDArray[np.float64]

#: Relative error of a step, sufficient for a guess.
ERROR = 1e-6
#: Ratio to the size of a state beyond which the integration has diverged.
BEYOND = 1e9
#: Smallest number of steps of the integration, and largest number of its samples that are returned.
STEPS, SAMPLES = 200, 401
#: Largest number of evaluations of the rates; a motion that needs more stiffens without end.
MOST = 5_000


def fly(
    phase: Guessed,
    function: casadi.Function,
    steer: casadi.Function,
    solved: casadi.Function | None,
    guess: Guess,
    parameters: Floats,
) -> Guess:
    """Return the guess with states integrated from its initial ones with its controls.

    If the end is free and not given, it is the time at which the final values are nearest. States that were
    guessed after the call of ``simulate`` keep their guesses. The functions are ``(t, x, u, p) -> (rate, …)``,
    `steer`, from the guessed controls u to those with feedback, and `solved`, which solves the equations for the
    algebraic variables in u. A state that is not finite, diverges or changes too fast raises ``InvalidData``.
    """
    states, controls = phase.states, phase.controls
    earliest, latest = (guess.end,) * 2 if "time" in phase.guessed else phase.bounds[2:]
    names = entry_names(states.values())
    lower, upper, first, last, size = (
        stacked(states.values(), what)
        for what in ("lower", "upper", "final_lower", "final_upper", "scale")
    )
    low, high = (stacked(controls.values(), side) for side in ("lower", "upper"))
    begin, span = guess.start, guess.end - guess.start
    count = itertools.count()

    def control(t: float, x: Floats) -> Floats:
        place = (t - begin) / span
        u = [np.interp(place, guess.fractions, item) for item in guess.controls.T]
        steered: Floats = np.array(steer(t, x, u, parameters), float).reshape(-1)
        steered = np.clip(steered, low, high)
        return (
            steered if solved is None else np.array(solved(t, x, steered, parameters)).reshape(-1)
        )

    def rate(t: float, x: Floats) -> Floats:
        u = control(t, x)
        rates = np.array(function(t, x, u, parameters)[0], float).reshape(-1)
        # If the rates are finite but change too fast, the message names the fastest state.
        invalid = ~(np.isfinite(rates) & (np.abs(x) < BEYOND * size))
        if invalid.any() or next(count) > MOST:
            k = int(np.argmax(np.where(invalid, np.inf, np.abs(rates) / size)))
            values = ", ".join(f"{n} = {v:.4g}" for n, v in zip(names, x, strict=True))
            raise InvalidData(
                f"the flight of phase {phase.name!r} breaks down at t = {t:.6g}: state {names[k]!r} has the rate "
                f"{rates[k]:g} at {values}; give other controls, or a shorter time",
                field="simulate",
            )
        return rates

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
            break  # the phase may end before this instant
        times.append(solver.t)
        rows.append(solver.y.copy())
        if free and solver.t >= earliest and ((rows[-1] < lower) | (rows[-1] > upper)).any():
            break
    t, table = np.array(times), np.array(rows)
    if solver.status == "finished":
        t[-1] = end
    if free:
        # A free end is the time at which the final values are nearest, within the bounds.
        outside = ((table < lower) | (table > upper)).any(axis=1)
        allowed = (t >= earliest) & (t > begin) & (np.cumsum(outside) == 0)
        if not allowed.any():
            allowed = (t >= earliest) & (t > begin)
        distance = (((table - np.clip(table, first, last)) / size) ** 2).sum(axis=1)
        best = np.lexsort((np.abs(t - guess.end), np.where(allowed, distance, np.inf)))[0]
        t, table = t[: best + 1], table[: best + 1]
    samples = np.unique(np.linspace(0, t.size - 1, min(t.size, SAMPLES)).round().astype(int))
    t, table = t[samples], np.clip(table[samples], lower, upper)
    u = np.array([control(*item) for item in zip(t, table, strict=True)])
    fractions = (t - begin) / (t[-1] - begin)
    for item, entries in entry_slices(states.values()):
        if item.name not in phase.flown:
            guessed = phase.guessed[item.name]
            table[:, entries] = sample_guess(item, guessed, fractions, (begin, t[-1]))
    return Guess(begin, float(t[-1]), fractions, table, u)
