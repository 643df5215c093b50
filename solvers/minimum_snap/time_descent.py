"""Descent (L-BFGS) on the logarithms of the durations for a sequence of barriers.

Source of the line search: Lewis and Overton, "Nonsmooth optimization via quasi-Newton methods",
2013: bisection to the weak Wolfe conditions, which also terminates near infinite values or kinks.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.minimum_snap.time_allocation import TimeAllocation
from .time_barrier import Barrier, Inner, Spline

__all__ = ["Allocated", "Descent", "Reached", "Variables", "allocate"]

Floats = NDArray[np.float64]
Function = Callable[[Floats], tuple[float, Floats]]

#: Relative complementarities of the sequence of barriers.
GAPS = tuple(float(gap) for gap in np.geomspace(1e-1, 1e-6, 9))
#: Gradient at which the descent on a barrier ends, relative to its complementarity.
LOOSE = 1.0
#: Predicted decrease at which the descent on a barrier ends, relative to its goal times the value. The
#: last barrier requires the gradient, because the model may underestimate the decrease.
DECREMENT = 1e-3
#: Shares of the way back to the last feasible durations, tried if new durations have no path.
BACK = (0.05, 0.2, 0.5, 0.8, 1.0)
#: Logarithms of stretch factors, tried first if slower motions satisfy all limits.
SLOWER = (1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
#: Largest number of descents on the last barrier, each with bounds at more instants.
ROUNDS = 20
#: Largest final increase of the objective by added instants, as a multiple of the gradient's tolerance
#: times the objective.
CLOSE = 0.1
#: Required share of the predicted decrease, and largest remaining share of the slope.
ARMIJO, WOLFE = 1e-4, 0.9
#: Relative rounding error of the values. Smaller differences do not order two values.
NOISE = 1e-13
#: Largest number of trials along one direction.
TRIALS = 30
#: Number of stored pairs of steps and slopes. With limits on 5 to 100 segments, 60 pairs were measured
#: to reduce the time of 12 pairs to as little as 0.6. Without limits the number has little effect.
MEMORY = 60
#: Largest change of any variable in one step.
LONGEST = 0.7


# -- quasi-Newton descent for functions that may be infinite ----------------------------------------


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
    the time on 5 to 100 segments, for 450 lines more.
    """

    def __init__(self) -> None:
        self.pairs: deque[tuple[Floats, Floats, float]] = deque(maxlen=MEMORY)

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
        report: Callable[[Floats, float], None] | None = None,
        decrement: float = 0.0,
    ) -> Reached:
        """Minimise `function` from a `point` with a finite value, in at most `most` iterations.

        The function returns value and gradient, which is ignored if the value is infinite.
        `tolerance` is the largest entry of the final gradient, and `decrement` the predicted decrease
        at which the descent has converged, both relative to the value: in a narrow valley the
        gradient may be large without a possible decrease. `stopped` is called before every
        evaluation, and `report` for every improved point and its value.
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
            if report is not None and gained > 0.0:
                report(now.point, now.value)
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
        length = min(1.0 if self.pairs else 0.3 / size, LONGEST / size)
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
                if float(trial.slope @ way) >= WOLFE * fall or length * size >= LONGEST:
                    return best, count + 1
                low = length
                length = 2.0 * low if high == np.inf else 0.5 * (low + high)
                length = min(length, LONGEST / size)
            if high - low <= 1e-12 * high:
                return best, count + 1
        return best, TRIALS


# -- descent on the durations ------------------------------------------------------------------------


@dataclass(frozen=True)
class Variables:
    """Durations as functions of unbounded variables.

    They are ``T = exp(x)``, shares of a given total, or, for a single variable, ``exp(x)`` times
    given durations.
    """

    #: ρ.
    weight: float
    #: ΣT.
    total: float | None = None
    #: Durations for factor 1, s, shape (M,).
    base: Floats | None = None

    def durations(self, x: Floats) -> Floats:
        """Return the durations T, s, shape (M,)."""
        if self.base is not None:
            return np.asarray(self.base * np.exp(np.clip(x[0], -50.0, 50.0)))
        if self.total is None:
            return np.asarray(np.exp(x))
        share = np.exp(x - x.max())
        return np.asarray(share * (self.total / share.sum()))

    def slope(self, durations: Floats, slope: Floats) -> Floats:
        """Return the derivatives of J + ρ ΣT by x from those of J by T."""
        if self.base is not None:
            return np.array([float(durations @ (slope + self.weight))])
        if self.total is None:
            return durations * (slope + self.weight)
        mean = float(durations @ slope) / self.total
        return durations * (slope - mean)


@dataclass
class Allocated:
    """Result of the descent on the durations."""

    #: Best durations, s, shape (M,).
    durations: Floats
    #: Objective at the best durations.
    value: float = np.inf
    #: Largest entry of the gradient by x at the best durations, relative to the objective.
    gradient: float = np.inf
    #: Whether the gradient satisfies the tolerance.
    settled: bool = False
    #: Numbers of iterations and of evaluations.
    iterations: int = 0
    evaluations: int = 0


Report = Callable[[Floats, float], None]


def allocate(
    model: TimeAllocation,
    inner: Inner,
    durations: Floats,
    *,
    tolerance: float,
    most: int,
    between: float,
    stopped: Callable[[], bool] = lambda: False,
    report: Report = lambda durations, value: None,
    first: float = GAPS[0],
    proportional: bool = False,
) -> Allocated:
    """Descend from `durations`, which must have a path, in at most `most` iterations.

    `tolerance` is the largest final gradient, relative to the objective, and `between` the largest
    final violation of a bound between instants, relative to its scale. `report` receives improved
    durations and their objective. `first` is the relative complementarity of the first barrier; a
    large value moves the path away from the bounds. If `proportional`, the durations keep their
    proportions.
    """
    result = Allocated(durations)
    if proportional:
        variables, x = Variables(model.time_weight, base=durations), np.zeros(1)
    else:
        variables, x = Variables(model.time_weight, model.total_time), np.log(durations)

    def function(point: Floats) -> tuple[float, Floats]:
        now = variables.durations(point)
        if not (np.all(now > 1e-100) and np.all(np.isfinite(now))):
            return np.inf, point
        outcome = inner.value(now)
        value = outcome.value + model.time_weight * float(now.sum())
        return value, variables.slope(now, outcome.slope)

    descent = Descent()
    if isinstance(inner, Spline):
        reached = descent.descend(
            function, x, tolerance, most, stopped=stopped,
            report=lambda point, value: report(variables.durations(point), value),
        )  # fmt: skip
        result.durations = variables.durations(reached.point)
        result.gradient = float(np.abs(reached.slope).max()) / max(abs(reached.value), 1e-300)
        result.settled = reached.settled
        result.iterations, result.evaluations = reached.iterations, reached.evaluations
        return result
    price = model.time_weight
    size = inner.value(durations).objective + price * float(durations.sum())
    safe, last, lost, settled = x, False, False, False
    best: tuple[float, Floats] = (np.inf, x)
    for gap in (g for g in GAPS if g <= first):
        inner.mu = gap * size / inner.pairs
        last = gap == GAPS[-1]
        goal = tolerance if last else max(LOOSE * gap, tolerance)
        threshold = between if last else max(between, 1e-2 * gap)
        if not np.isfinite(inner.value(variables.durations(x), afresh=True).value):
            inside = _inside(inner, variables, x, safe, threshold, 1)
            if inside is None:
                settled = False
                break
            x = inside
        for _ in range(ROUNDS):
            reached = descent.descend(
                function, x, goal, most - result.iterations,
                stopped=stopped, decrement=0.0 if last else DECREMENT * goal,
            )  # fmt: skip
            result.iterations += reached.iterations
            result.evaluations += reached.evaluations
            if stopped():
                result.durations = variables.durations(best[1] if best[0] < np.inf else safe)
                return result
            x, settled = reached.point, reached.settled
            now = variables.durations(x)
            before = inner.value(now).objective + price * float(now.sum())
            if not np.isfinite(reached.value) or not inner.exchange(now, threshold):
                break
            inside = _inside(inner, variables, x, safe, threshold, 25 if last else 1)
            lost = inside is None
            if inside is None:
                break
            x = inside
            if not last:
                break
            now = variables.durations(x)
            after = inner.value(now).objective + price * float(now.sum())
            best = (after, x) if after < best[0] else best
            # A minimum with a subset of the bounds that satisfies all bounds is a minimum with all.
            if settled and after - before <= CLOSE * tolerance * abs(after):
                break
            settled = False
        now = variables.durations(x)
        outcome = inner.value(now)
        if lost or not np.isfinite(outcome.value):
            settled = False
            break
        safe = x
        size = outcome.objective + price * float(now.sum())
        report(now, size)
        slope = variables.slope(now, outcome.slope)
        result.gradient = float(np.abs(slope).max()) / max(size, 1e-300)
        if last:
            best = (size, x) if size < best[0] else best
            result.value = size
        if result.iterations >= most:
            break
    if best[0] < size:
        result.value = best[0]
        safe, settled = best[1], settled and size - best[0] <= CLOSE * tolerance * abs(size)
    result.settled = last and settled
    result.durations = variables.durations(safe)
    return result


def _inside(
    inner: Barrier,
    variables: Variables,
    x: Floats,
    safe: Floats,
    threshold: float,
    rounds: int,
) -> Floats | None:
    """Return `x` or a nearby point whose path satisfies all bounds, or None without success.

    With bounds at additional instants, durations may no longer have a path. From rest to rest, try
    slower motions. Otherwise try points on the way back to `safe`.
    """
    for point in _ways(inner, variables, x, safe):
        if np.isfinite(inner.settle(variables.durations(point), threshold, rounds).value):
            return point
        if inner.flag[0]:
            break
    return None


def _ways(inner: Barrier, variables: Variables, x: Floats, safe: Floats) -> Iterator[Floats]:
    yield x
    slower = inner.model.from_rest_to_rest and variables.total is None
    if slower:
        for share in SLOWER:
            yield x + share
    for share in BACK:
        yield x + share * (safe - x)
    if slower:
        for share in SLOWER:
            yield safe + share
