"""Shared parts of the adapters of the scoreboard."""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

__all__ = [
    "QUIET",
    "Unsupported",
    "bounded",
    "guessed_integrals",
    "nodes_per_interval",
    "problem_of",
    "sampled",
]

#: Quiet Ipopt at its defaults.
QUIET = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False}


class Unsupported(Exception):
    """The package cannot express the problem."""


def problem_of(name: str) -> Any:
    """Return the declared problem with its best known value, from both sets."""
    try:
        return importlib.import_module("published").problems()[name]
    except ModuleNotFoundError:
        return importlib.import_module("unseen").UNSEEN[name]


def sampled(guess: Any, places: Any) -> tuple[Any, Any]:
    """Return guessed states and controls at fractions of the phase, one row per entry."""
    return tuple(
        np.array([np.interp(places, guess.fractions, row) for row in table.T]).reshape(
            -1, np.size(places)
        )
        for table in (guess.states, guess.controls)
    )


def guessed_integrals(phase: Any, p: Any) -> Any:
    """Return the integrals along the guess by the trapezoidal rule, with 0 for values that are not finite."""
    places = np.linspace(0.0, 1.0, 201)
    x, u = sampled(phase.guess, places)
    times = phase.guess.start + places * (phase.guess.end - phase.guess.start)
    values = phase.function(times[None, :], x, u, p)[2].full()
    return np.nan_to_num(np.trapezoid(values, times), nan=0.0, posinf=0.0, neginf=0.0)


def nodes_per_interval(x: Any, u: Any, degrees: list[int], overlap: int = 1) -> dict[str, Any]:
    """Return states and controls per interval: tables with one row per node."""
    states, controls, at, at_state = [], [], 0, 0
    for degree in degrees:
        states.append(x[at_state : at_state + degree + 1])
        controls.append(u[at : at + degree])
        at, at_state = at + degree, at_state + degree + 1 - overlap
    return {"states": states, "controls": controls}


def bounded(expression: Any, low: Any, high: Any) -> Iterator[Any]:
    """Yield the constraints of a column with finite bounds, one entry at a time."""
    for k in range(expression.numel()):
        if low[k] == high[k]:
            yield expression[k] == low[k]
            continue
        if math.isfinite(low[k]):
            yield expression[k] >= low[k]
        if math.isfinite(high[k]):
            yield expression[k] <= high[k]
