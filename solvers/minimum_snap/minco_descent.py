"""Compiled L-BFGS of ``minco``.

Source: Lewis and Overton, "Nonsmooth optimization via quasi-Newton methods", 2013 (bisection to the
weak Wolfe conditions). It is the method of :class:`.time_descent.Descent` as one kernel, because an
evaluation takes a tenth of a millisecond and an interpreted step takes longer.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .minco_kernels import evaluate
from .minco_limits import Multipliers, Task

__all__ = ["descend"]

Floats = NDArray[np.float64]
Flags = NDArray[np.int8]

#: Number of stored pairs of steps and changes of the gradient.
MEMORY = 40
#: Largest change of any unknown in one step, and of trials along a direction.
LONGEST, TRIALS = 0.5, 30
#: Required share of the predicted decrease, and largest remaining share of the slope.
ARMIJO, WOLFE = 1e-4, 0.9


@kernel
def _dot(first: Floats, second: Floats) -> float:
    total = 0.0
    for i in range(first.size):
        total += first[i] * second[i]
    return total


@kernel
def _direction(
    slope: Floats, steps: Floats, turns: Floats, bends: Floats, count: int, way: Floats
) -> None:
    """Write the quasi-Newton direction from the last pairs, stored as a ring."""
    memory, n = steps.shape
    shares = np.zeros(memory)
    for i in range(n):
        way[i] = -slope[i]
    for back in range(min(count, memory)):
        at = (count - 1 - back) % memory
        shares[at] = _dot(steps[at], way) / bends[at]
        for i in range(n):
            way[i] -= shares[at] * turns[at, i]
    if count > 0:
        at = (count - 1) % memory
        factor = bends[at] / _dot(turns[at], turns[at])
        for i in range(n):
            way[i] *= factor
    for ahead in range(max(0, count - memory), count):
        at = ahead % memory
        share = shares[at] - _dot(turns[at], way) / bends[at]
        for i in range(n):
            way[i] += share * steps[at, i]


@kernel
def _search(
    task: Task,
    held: Multipliers,
    x: Floats,
    value: float,
    fall: float,
    way: Floats,
    length: float,
    longest: float,
    trial: Floats,
    slope: Floats,
) -> tuple[float, int]:
    """Write a point with a sufficient decrease and its gradient; return its value and the trials.

    The value is infinite without such a point.
    """  # fmt: skip
    low, high, best = 0.0, np.inf, np.inf
    for count in range(TRIALS):
        for i in range(x.size):
            trial[i] = x[i] + length * way[i]
        now = evaluate(task, held, trial, slope)
        if not now <= value + ARMIJO * length * fall + 1e-14 * abs(value):
            high = length
            middle = 0.5 * (low + length)
            bend = now - value - length * fall
            if low == 0.0 and now < np.inf and bend > 0.0:
                middle = -0.5 * fall * length * length / bend
            length = min(max(middle, low + 0.1 * (high - low)), low + 0.7 * (high - low))
            best = np.inf
        else:
            best = now
            if _dot(slope, way) >= WOLFE * fall or length >= longest:
                return best, count + 1
            low = length
            length = min(2.0 * low if high == np.inf else 0.5 * (low + high), longest)
        if high - low <= 1e-10 * high:
            break
    return best, TRIALS


@kernel
def descend(
    task: Task, held: Multipliers, x: Floats, flag: Flags, most: int, past: int, decrease: float
) -> tuple[float, int, int]:
    """Minimise the augmented Lagrangian from `x`, in place.

    The descent ends after `most` evaluations, if the value has decreased by less than the share
    `decrease` over `past` steps, or if ``flag[0]`` is set. Return the value and the numbers of steps
    and evaluations.
    """
    n = x.size
    steps, turns, bends = np.zeros((MEMORY, n)), np.zeros((MEMORY, n)), np.ones(MEMORY)
    slope, after, way, trial = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    former = np.full(past, np.inf)
    value = evaluate(task, held, x, slope)
    count, iterations, evaluations = 0, 0, 1
    while evaluations < most and not flag[0] and value < np.inf:
        _direction(slope, steps, turns, bends, count, way)
        fall = _dot(way, slope)
        if not fall < 0.0:
            count = 0
            for i in range(n):
                way[i] = -slope[i]
            fall = -_dot(slope, slope)
        if fall == 0.0:
            break
        largest = 0.0
        for i in range(n):
            largest = max(largest, abs(way[i]))
        longest = LONGEST / largest
        length = min(1.0 if count else 0.1 * longest, longest)
        now, trials = _search(task, held, x, value, fall, way, length, longest, trial, after)
        evaluations += trials
        if not now < np.inf:
            if count == 0:
                break
            count = 0
            continue
        at = count % MEMORY
        bend, size, change = 0.0, 0.0, 0.0
        for i in range(n):
            steps[at, i] = trial[i] - x[i]
            turns[at, i] = after[i] - slope[i]
            bend += steps[at, i] * turns[at, i]
            size += steps[at, i] ** 2
            change += turns[at, i] ** 2
            x[i] = trial[i]
            slope[i] = after[i]
        if bend > 1e-12 * np.sqrt(size * change):
            bends[at] = bend
            count += 1
        value = now
        old = former[iterations % past]
        former[iterations % past] = value
        iterations += 1
        if old - value <= decrease * abs(value):
            break
    return value, iterations, evaluations
