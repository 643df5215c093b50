"""Quasi-Newton descent (L-BFGS) for functions that may be infinite, in plain NumPy.

Source of the line search: Lewis and Overton, "Nonsmooth optimization via quasi-Newton methods",
2013: bisection to the weak Wolfe conditions, which also terminates near infinite values or kinks.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Descent", "Reached"]

Floats = NDArray[np.float64]
Function = Callable[[Floats], tuple[float, Floats]]

#: Required share of the predicted decrease, and largest remaining share of the slope.
ARMIJO, WOLFE = 1e-4, 0.9
#: Relative rounding error of the values. Smaller differences do not order two values.
NOISE = 1e-13
#: Largest number of trials along one direction.
TRIALS = 30
#: Number of stored pairs of steps and slopes. With limits on 5 to 100 segments, 60 pairs were measured
#: to reduce the time of 12 pairs to as little as 0.6. Without limits the number has little effect.
MEMORY = 60


@dataclass(frozen=True)
class Reached:
    """Result of a descent."""

    #: Best point and its gradient.
    point: Floats
    slope: Floats
    #: Value at the best point.
    value: float
    #: Numbers of iterations and of evaluations.
    iterations: int
    evaluations: int
    #: Whether the gradient or the predicted decrease satisfies its tolerance. If False, the
    #: descent reached a limit or made no further progress.
    settled: bool


class _Trial(NamedTuple):
    """Point with its value and gradient."""

    point: Floats
    value: float
    slope: Floats


class Descent:
    """L-BFGS that keeps its curvature if the function changes, as from one barrier to the next.

    With second derivatives of the barrier, Newton's method was measured to take at least 0.55 of
    the time on 5 to 100 segments, for 450 lines more. `memory` is the number of stored pairs of steps
    and slopes, and `longest` the largest change of any variable in one step.
    """

    def __init__(self, memory: int = MEMORY, longest: float = 0.7) -> None:
        self.pairs: deque[tuple[Floats, Floats, float]] = deque(maxlen=memory)
        self.longest = longest

    def _direction(self, slope: Floats) -> Floats:
        """Return the quasi-Newton direction for this slope."""
        way = -slope
        shares = []
        for step, change, curvature in reversed(self.pairs):
            share = float(step @ way) / curvature
            way -= share * change
            shares.append(share)
        if self.pairs:
            _, change, curvature = self.pairs[-1]
            way *= curvature / float(change @ change)
        for (step, change, curvature), share in zip(self.pairs, reversed(shares), strict=True):
            way += (share - float(change @ way) / curvature) * step
        return way

    def descend(
        self,
        function: Function,
        point: Floats,
        tolerance: float,
        most: int,
        *,
        stopped: Callable[[], bool] = lambda: False,
        heard: Callable[[Floats, float], None] | None = None,
        decrement: float = 0.0,
    ) -> Reached:
        """Minimise `function` from a `point` with a finite value, in at most `most` iterations.

        The function returns value and gradient, which is ignored if the value is infinite.
        `tolerance` is the largest entry of the final gradient, and `decrement` the predicted decrease
        at which the descent has converged, both relative to the value: in a narrow valley the
        gradient may be large without a possible decrease. `stopped` is called before every
        evaluation, and `heard` for every improved point and its value.
        """
        now = _Trial(point, *function(point))
        evaluations, iterations, idle, settled = 1, 0, 0, False
        while np.isfinite(now.value):
            settled = float(np.abs(now.slope).max()) <= tolerance * abs(now.value)
            if settled or iterations >= most or stopped():
                break
            iterations += 1
            way = self._direction(now.slope)
            fall = float(way @ now.slope)
            informed = len(self.pairs) >= min(way.size, MEMORY)
            if informed and 0.0 < -0.5 * fall < decrement * abs(now.value):
                settled = True
                break
            if not fall < 0.0:
                self.pairs.clear()
                way = -now.slope
            trial, count = self._search(function, now, way, stopped)
            evaluations += count
            if trial is None:
                if self.pairs and not stopped():
                    # The stored curvature may be that of a previous barrier. Retry without it.
                    self.pairs.clear()
                    continue
                break
            step, change = trial.point - now.point, trial.slope - now.slope
            turn = float(step @ change)
            if turn > 1e-12 * float(np.sqrt((step @ step) * (change @ change))):
                self.pairs.append((step, change, turn))
            gained = now.value - trial.value
            now = trial
            if heard is not None and gained > 0.0:
                heard(now.point, now.value)
            idle = idle + 1 if abs(gained) <= 1e-16 * abs(now.value) and not self.pairs else 0
            if idle > 2:
                break
        return Reached(now.point, now.slope, now.value, iterations, evaluations, settled)

    def _search(
        self, function: Function, start: _Trial, way: Floats, stopped: Callable[[], bool]
    ) -> tuple[_Trial | None, int]:
        """Return a point on the ray `way` with a sufficient decrease, and the number of trials."""
        value, fall = start.value, float(way @ start.slope)
        size = max(float(np.abs(way).max()), 1e-300)
        length = min(1.0 if self.pairs else 0.3 / size, self.longest / size)
        low, high, best = 0.0, np.inf, None
        for count in range(TRIALS):
            if stopped():
                return best, count
            point = start.point + length * way
            trial = _Trial(point, *function(point))
            if not trial.value <= value + ARMIJO * length * fall + NOISE * abs(value):
                high, middle = length, 0.5 * (low + length)
                if not np.isfinite(trial.value):
                    middle = low + 0.3 * (high - low)
                elif low == 0.0:
                    # Minimum of the parabola through both values with the initial slope.
                    bend = trial.value - value - length * fall
                    middle = -0.5 * fall * length**2 / bend if bend > 0.0 else middle
                length = min(max(middle, low + 0.1 * (high - low)), low + 0.7 * (high - low))
            else:
                best = trial
                if float(trial.slope @ way) >= WOLFE * fall or length * size >= self.longest:
                    return best, count + 1
                low = length
                length = 2.0 * low if high == np.inf else 0.5 * (low + high)
                length = min(length, self.longest / size)
            if high - low <= 1e-12 * high:
                return best, count + 1
        return best, TRIALS
