"""Newton and quasi-Newton (L-BFGS) descent for functions that may be infinite, in plain NumPy.

Source of the line search: Lewis and Overton, "Nonsmooth optimization via quasi-Newton methods",
2013: bisection to the weak Wolfe conditions, which ends beside an infinite value or a kink too.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Descent", "Reached"]

Floats = NDArray[np.float64]
Function = Callable[[Floats], tuple[float, Floats]]

#: Share of the promised decrease that a step must bring, and of the slope that may stay.
ARMIJO, WOLFE = 1e-4, 0.9
#: Relative rounding of the values: two that differ by less may come in either order.
NOISE = 1e-13
#: Trials along one direction.
TRIALS = 30
#: What Newton's step may still promise at the end, relative to the value and to the gradient's tolerance:
#: in a narrow valley the gradient is large across it for next to no gain.
DECREMENT = 1e-3
#: Steps aside from a trial in a bent valley.
CORRECTIONS = 3
#: Pairs of steps and slopes that are kept. With limits on 5 to 100 segments, 60 were measured to take
#: up to 0.6 of the time that 12 take; without limits their number hardly counts.
MEMORY = 60
#: Variables above which no eigenvectors are formed, and shares of the curvature that are added then.
DENSE = 40
SHIFTS = (1e-8, 1e-6, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)


@dataclass(frozen=True)
class Reached:
    """Where a descent ended.

    Parameters
    ----------
    point, slope : ndarray
        The best point and the gradient there.
    value : float
        Its value.
    iterations, evaluations : int
        Counts.
    settled : bool
        Whether the gradient is as small as was asked; else the steps ended or no longer helped.
    """

    point: Floats
    slope: Floats
    value: float
    iterations: int
    evaluations: int
    settled: bool


class Descent:
    """L-BFGS whose curvature outlives a change of the function: from one barrier to the next.

    Parameters
    ----------
    memory : int
        Pairs of steps and slopes that are kept.
    longest : float
        Largest change of any variable in one step.
    """

    def __init__(self, memory: int = MEMORY, longest: float = 0.7) -> None:
        self.pairs: deque[tuple[Floats, Floats, float]] = deque(maxlen=memory)
        self.longest = longest
        self.boldness = 4.0

    def _direction(self, slope: Floats) -> Floats:
        """Return minus the slope, turned by the curvature that was met."""
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
        curvature: Callable[[Floats], Floats | None] | None = None,
        aim: Callable[[Floats, Floats], float] | None = None,
    ) -> Reached:
        """Minimise `function` from `point`, where it must be finite.

        Parameters
        ----------
        function : callable
            Gives value and gradient; an infinite value's gradient is not read.
        tolerance : float
            The largest entry of the gradient accepted, relative to the value.
        most : int
            Iterations.
        stopped : callable, optional
            Asked before every evaluation.
        heard : callable, optional
            Told every point that is better than those before.
        curvature : callable, optional
            Gives the second derivatives, for Newton's steps; negative curvature counts as if it
            were positive, so that they always descend.
        """
        value, slope = function(point)
        evaluations, iterations, idle, settled = 1, 0, 0, False
        if not np.isfinite(value):
            return Reached(point, slope, value, 0, 1, False)
        while iterations < most and not stopped():
            if float(np.abs(slope).max()) <= tolerance * abs(value):
                settled = True
                break
            bent = None if curvature is None else curvature(point)
            way = self._direction(slope) if bent is None else _newton(bent, slope)
            fall = float(way @ slope)
            if bent is not None and -0.5 * fall <= DECREMENT * tolerance * abs(value):
                settled = True
                break
            if not fall < 0.0:
                self.pairs.clear()
                way, fall, bent = -slope, -float(slope @ slope), None
            size, first = float(np.abs(way).max()), 1.0
            if bent is not None:
                first = length = 1.0 if aim is None else min(1.0, self.boldness * aim(point, way))
            else:
                length = 1.0 if self.pairs else 0.3 / max(size, 1e-300)
            length = min(length, self.longest / max(size, 1e-300))
            low, high = 0.0, np.inf
            found: tuple[Floats, float, Floats] | None = None
            noise = NOISE * abs(value)
            for _ in range(TRIALS):
                if stopped():
                    break
                trial = point + length * way
                new, new_slope = function(trial)
                evaluations += 1
                enough = value + ARMIJO * length * fall + noise
                for _ in range(CORRECTIONS):
                    # Back into a valley that bends away: steps of its first curvature.
                    if bent is None or not np.isfinite(new) or new <= enough:
                        break
                    aside = _newton(bent, new_slope)
                    if float(np.abs(aside).max()) > length * size:
                        break
                    corrected = trial + aside
                    other, other_slope = function(corrected)
                    evaluations += 1
                    if not other < new:
                        break
                    trial, new, new_slope = corrected, other, other_slope
                along = float(new_slope @ way) if np.isfinite(new) else np.inf
                if not new <= enough:
                    high = length
                    # A parabola where the value tells more than that it is infinite.
                    best = 0.5 * (low + high)
                    if np.isfinite(new) and low == 0.0:
                        bend = new - value - length * fall
                        if bend > 0.0:
                            best = -0.5 * fall * length**2 / bend
                    elif not np.isfinite(new):
                        best = low + 0.3 * (high - low)
                    length = min(max(best, low + 0.1 * (high - low)), low + 0.7 * (high - low))
                else:
                    found = (trial, new, new_slope)
                    # Newton's steps need no curvature along the way.
                    if bent is not None or along >= WOLFE * fall or length * size >= self.longest:
                        break
                    low = length
                    length = 2.0 * low if high == np.inf else 0.5 * (low + high)
                    length = min(length, self.longest / size)
                if high - low <= 1e-12 * high:
                    break
            if found is None:
                if self.pairs and not stopped():
                    # The curvature may be that of another barrier: once more without.
                    self.pairs.clear()
                    iterations += 1
                    continue
                break
            trial, new, new_slope = found
            step, change = trial - point, new_slope - slope
            turn = float(step @ change)
            if turn > 1e-12 * float(np.sqrt((step @ step) * (change @ change))):
                self.pairs.append((step, change, turn))
            if bent is not None:
                # What is foreseen is linear: by how much it may be exceeded is learnt.
                went = length >= first or length * size >= self.longest
                self.boldness = min(max(self.boldness * (2.0 if went else 0.5), 1.0), 1e4)
            gained = value - new
            point, value, slope = trial, new, new_slope
            iterations += 1
            if heard is not None and gained > 0.0:
                heard(point, value)
            if abs(gained) <= 1e-16 * abs(value) and (bent is not None or not self.pairs):
                idle += 1
                if idle > 2:
                    break
            else:
                idle = 0
        else:
            settled = float(np.abs(slope).max()) <= tolerance * abs(value)
        return Reached(point, slope, value, iterations, evaluations, settled)


def _newton(bent: Floats, slope: Floats) -> Floats:
    """Return the step to the minimum of the parabola, curved upwards along every axis of it."""
    count = slope.size
    if count > DENSE:
        # Cholesky with as much of the identity as it takes: eigenvectors cost a hundred times more.
        from .time_curvature import shifted_solve

        typical = max(float(np.abs(bent).max()), 1e-300)
        for shift in (0.0, *SHIFTS):
            step: Floats = -slope
            if shifted_solve(bent, shift * typical, step):
                return step
    values, axes = np.linalg.eigh(bent)
    size = np.abs(values)
    size = np.maximum(size, 1e-10 * max(float(size.max()), 1e-300))
    way: Floats = -(axes @ ((axes.T @ slope) / size))
    return way
