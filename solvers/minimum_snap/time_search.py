"""Newton and quasi-Newton (L-BFGS) descent for functions that may be infinite, in plain NumPy.

Source of the line search: Lewis and Overton, "Nonsmooth optimization via quasi-Newton methods",
2013: bisection to the weak Wolfe conditions, which also terminates near infinite values or kinks.
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

#: Required share of the predicted decrease, and largest remaining share of the slope.
ARMIJO, WOLFE = 1e-4, 0.9
#: Relative rounding error of the values. Smaller differences do not order two values.
NOISE = 1e-13
#: Largest number of trials along one direction.
TRIALS = 30
#: Largest predicted decrease of a Newton step at the end, relative to the value times the gradient's
#: tolerance. In a narrow valley the gradient may be large without a possible decrease.
DECREMENT = 1e-3
#: Largest number of corrections of a trial in a curved valley.
CORRECTIONS = 3
#: Number of stored pairs of steps and slopes. With limits on 5 to 100 segments, 60 pairs were measured
#: to reduce the time of 12 pairs to as little as 0.6. Without limits the number has little effect.
MEMORY = 60
#: Largest number of variables with an eigendecomposition, and shifts for more variables, as shares of
#: the curvature.
DENSE = 40
SHIFTS = (1e-8, 1e-6, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)


@dataclass(frozen=True)
class Reached:
    """Result of a descent.

    Parameters
    ----------
    point, slope : ndarray
        Best point and its gradient.
    value : float
        Value at the best point.
    iterations, evaluations : int
        Numbers of iterations and of evaluations.
    settled : bool
        Whether the gradient satisfies the tolerance. If False, the descent reached a limit or made
        no further progress.
    """

    point: Floats
    slope: Floats
    value: float
    iterations: int
    evaluations: int
    settled: bool


class Descent:
    """L-BFGS that keeps its curvature if the function changes, as from one barrier to the next.

    Parameters
    ----------
    memory : int
        Number of stored pairs of steps and slopes.
    longest : float
        Largest change of any variable in one step.
    """

    def __init__(self, memory: int = MEMORY, longest: float = 0.7) -> None:
        self.pairs: deque[tuple[Floats, Floats, float]] = deque(maxlen=memory)
        self.longest = longest
        self.boldness = 4.0

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
        curvature: Callable[[Floats], Floats | None] | None = None,
        aim: Callable[[Floats, Floats], float] | None = None,
    ) -> Reached:
        """Minimise `function` from a `point` with a finite value.

        Parameters
        ----------
        function : callable
            Function that returns value and gradient. The gradient is ignored if the value is
            infinite.
        point : ndarray, shape (n,)
            Starting point.
        tolerance : float
            Largest entry of the final gradient, relative to the value.
        most : int
            Largest number of iterations.
        stopped : callable, optional
            Function that returns True to stop, called before every evaluation.
        heard : callable, optional
            Callback for every improved point and its value.
        curvature : callable, optional
            Function that returns the second derivatives for Newton steps, or None. The absolute
            values of negative curvatures are used, so that every step is a descent direction.
        aim : callable, optional
            Function of a point and a direction, called before the trials. It returns the largest
            predicted step length.

        Returns
        -------
        Reached
            Best point.
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
                    # Return to a curved valley by Newton steps with the initial curvature.
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
                    # Use quadratic interpolation if the value is finite.
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
                    # Newton steps do not require the curvature condition.
                    if bent is not None or along >= WOLFE * fall or length * size >= self.longest:
                        break
                    low = length
                    length = 2.0 * low if high == np.inf else 0.5 * (low + high)
                    length = min(length, self.longest / size)
                if high - low <= 1e-12 * high:
                    break
            if found is None:
                if self.pairs and not stopped():
                    # The stored curvature may be that of a previous barrier. Retry without it.
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
                # The prediction is linear. Adapt the factor that lets a step exceed it.
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
    """Return the Newton step of the quadratic model with absolute values of its eigenvalues."""
    count = slope.size
    if count > DENSE:
        # Cholesky with the smallest sufficient shift. Eigenvectors cost a hundred times more.
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
