"""Descent on the logarithms of the durations for a sequence of barriers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.minimum_snap.time_allocation import TimeAllocation
from .time_barrier import Barrier, Inner, Spline
from .time_search import Descent

__all__ = ["Allocated", "Factor", "Variables", "allocate"]

Floats = NDArray[np.float64]

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


@dataclass(frozen=True)
class Variables:
    """Durations as functions of unbounded variables: ``T = exp(x)``, or shares of a given total."""

    #: ρ.
    weight: float
    #: ΣT.
    total: float | None

    def durations(self, x: Floats) -> Floats:
        """Return the durations T, s, shape (M,)."""
        if self.total is None:
            whole: Floats = np.exp(x)
            return whole
        share = np.exp(x - x.max())
        durations: Floats = share * (self.total / share.sum())
        return durations

    def slope(self, durations: Floats, slope: Floats) -> Floats:
        """Return the derivatives of J + ρ ΣT by x from those of J by T."""
        if self.total is None:
            return durations * (slope + self.weight)
        mean = float(durations @ slope) / self.total
        return durations * (slope - mean)


@dataclass(frozen=True)
class Factor:
    """Single variable: the logarithm of a factor of given durations."""

    #: ρ.
    weight: float
    #: Durations for factor 1, s, shape (M,).
    base: Floats
    total: ClassVar[None] = None

    def durations(self, x: Floats) -> Floats:
        """Return the durations T, s, shape (M,)."""
        whole: Floats = self.base * np.exp(np.clip(x[0], -50.0, 50.0))
        return whole

    def slope(self, durations: Floats, slope: Floats) -> Floats:
        """Return the derivative of J + ρ ΣT by x, shape (1,), from the derivatives of J by T."""
        return np.array([float(durations @ (slope + self.weight))])


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


Heard = Callable[[Floats, float], None]


def allocate(
    model: TimeAllocation, inner: Inner, durations: Floats, *, tolerance: float, most: int,
    between: float, stopped: Callable[[], bool] = lambda: False,
    heard: Heard = lambda durations, value: None, first: float = GAPS[0], proportional: bool = False,
) -> Allocated:  # fmt: skip
    """Descend from `durations`, which must have a path, in at most `most` iterations.

    `tolerance` is the largest final gradient, relative to the objective, and `between` the largest
    final violation of a bound between instants, relative to its scale. `heard` receives improved
    durations and their objective. `first` is the relative complementarity of the first barrier; a
    large value moves the path away from the bounds. If `proportional`, the durations keep their
    proportions.
    """
    result = Allocated(durations)
    variables: Variables | Factor
    if proportional:
        variables, x = Factor(model.time_weight, durations), np.zeros(1)
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
            heard=lambda point, value: heard(variables.durations(point), value),
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
            best = min(best, (after, x), key=_first)
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
        heard(now, size)
        slope = variables.slope(now, outcome.slope)
        result.gradient = float(np.abs(slope).max()) / max(size, 1e-300)
        if last:
            best = min(best, (size, x), key=_first)
            result.value = size
        if result.iterations >= most:
            break
    if best[0] < size:
        result.value = best[0]
        safe, settled = best[1], settled and size - best[0] <= CLOSE * tolerance * abs(size)
    result.settled = last and settled
    result.durations = variables.durations(safe)
    return result


def _first(pair: tuple[float, Floats]) -> float:
    return pair[0]


def _inside(
    inner: Barrier,
    variables: Variables | Factor,
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


def _ways(
    inner: Barrier, variables: Variables | Factor, x: Floats, safe: Floats
) -> Iterator[Floats]:
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
