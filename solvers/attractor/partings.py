"""Divergence of neighbouring states over time: the curves of exponents."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...models.attractor.checks import ALL
from .native import Poll
from .neighbour_kernels import mean_partings, nearest_states, order_states
from .regions import whole_slope

__all__ = ["FEW", "MOST", "Curve", "Neighbours", "kantz_curve", "kantz_radius", "rosenstein_curve"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Smallest and largest number of reference states, if not all states are references.
SOME, MOST = 500, 10_000
#: Pairs that a search may visit, which limits the references, and number of states used to estimate
#: the pairs per state.
WORK, PILOT = 50_000_000, 50
#: Coordinates that the means of Kantz may visit, and smallest number of reference states for them.
MEANS, FEW = 100_000_000, 100
#: Blocks of time for the deviation; the clock is checked between them.
BLOCKS = 20
#: Coordinates of neighbours whose distances are computed at once, which fit into a processor's cache.
CACHED = 20_000
#: Number of neighbours within the radius of Kantz that the share :data:`CROWDED` of the states has.
CROWD, CROWDED = 5, 0.5


@dataclass(frozen=True, eq=False)
class Curve:
    """Sums of the log distances of neighbours by blocks of time, shape (blocks, high + 1), and their counts."""

    sums: Floats
    counts: Ints
    references: int

    @property
    def values(self) -> Floats:
        """Mean logarithm of the distance at steps 0 … high, NaN without neighbours."""
        return _mean(self.sums.sum(axis=0), self.counts.sum(axis=0))

    def slope(self, low: int, high: int, period: float) -> tuple[float, float]:
        """Return the slope from step `low` to `high`, and its standard deviation, see :func:`whole_slope`."""
        x = np.arange(low, high + 1, dtype=np.float64) * period
        part = slice(low, high + 1)
        sums, counts = self.sums[:, part], self.counts[:, part]
        occupied = counts.any(axis=1)
        sums, counts = sums[occupied], counts[occupied]
        left_out = _mean(sums.sum(axis=0) - sums, counts.sum(axis=0) - counts)
        return whole_slope(x, self.values[part], left_out)


def _mean(sums: Floats, counts: Ints) -> Floats:
    with np.errstate(all="ignore"):
        mean: Floats = np.where(counts > 0, sums / counts, np.nan)
    return mean


class Neighbours:
    """States before `last` ordered for neighbour search, and choice of reference states.

    States at most `theiler` samples apart are not neighbours.
    """

    def __init__(self, states: Floats, theiler: int, last: int) -> None:
        self.states, self.theiler, self.last = states, theiler, last
        self.ordered, self.times, self.places = order_states(states[:last])

    def references(self, count: int) -> Ints:
        """Return `count` random states in the order of time; all if there are few."""
        if len(self.states) <= ALL or count >= self.last:
            return np.arange(self.last)
        return np.sort(np.random.default_rng(0).choice(self.last, count, replace=False))

    def nearest(self, some: Ints, rank: int = 1) -> tuple[Ints, Floats, int]:
        """Return the neighbours of given rank, their squared distances, and the number of visited pairs."""
        which, squares, visits = nearest_states(
            self.ordered, self.times, self.places[some], self.theiler, rank, False
        )
        return which[:, -1], squares[:, -1], visits

    def within(self, some: Ints, radius: float, ahead: int) -> tuple[Floats, Ints, int]:
        """Return sums and counts of the mean divergence of some states, and their number of neighbours."""
        result: tuple[Floats, Ints, int] = mean_partings(
            self.states, self.ordered, self.times, self.places[some], self.theiler, radius**2, ahead
        )
        return result

    @property
    def pilot(self) -> Ints:
        """Some states, evenly spaced in time."""
        return np.unique(np.linspace(0, self.last - 1, PILOT).astype(np.int64))


def rosenstein_curve(
    states: Floats, theiler: int, last: int, high: int, *, references: int = MOST, poll: Poll = bool
) -> Curve:
    """Return the divergence of the states before `last` from their nearest neighbours, 0 … `high` steps ahead.

    States, shape (m, d), are in the order of time, with ``last + high <= m``. Those at most `theiler`
    samples apart are not neighbours. Up to 1500 states, all are references, otherwise at most `references`.
    `poll` is called between blocks of time.
    """
    pool = Neighbours(states, theiler, last)
    visits = pool.nearest(pool.pilot)[2]
    rows = pool.references(min(max(WORK * PILOT // max(visits, 1), SOME), references))

    courses = np.lib.stride_tricks.sliding_window_view(states, high + 1, axis=0)

    def part(some: Ints) -> tuple[Floats, Ints]:
        nearest = pool.nearest(some)[0]
        pairs = np.stack([some, nearest])[:, nearest >= 0]
        sums, counts = np.zeros(high + 1), np.zeros(high + 1, np.int64)
        size = -(-CACHED // courses[0].size)
        for start in range(0, pairs.shape[1], size):
            firsts, seconds = courses[pairs[:, start : start + size]]
            squares = ((firsts - seconds) ** 2).sum(axis=1)
            differ = squares > 0.0
            sums += 0.5 * np.log(squares, where=differ, out=np.zeros_like(squares)).sum(axis=0)
            counts += differ.sum(axis=0)
        return sums, counts

    return _curve(part, rows, poll)


def kantz_curve(
    states: Floats,
    theiler: int,
    last: int,
    high: int,
    *,
    radius: float,
    references: int = MOST,
    poll: Poll = bool,
) -> Curve:
    """Return the divergence of the states before `last` from all states within `radius`.

    The other parameters are those of :func:`rosenstein_curve`.
    """
    pool = Neighbours(states, theiler, last)
    neighbours = pool.within(pool.pilot, radius, 0)[2]
    cost = max(neighbours, 1) * (high + 1) * states.shape[1]
    rows = pool.references(min(max(MEANS * PILOT // cost, FEW), references))
    return _curve(lambda some: pool.within(some, radius, high)[:2], rows, poll)


def kantz_radius(states: Floats, theiler: int, last: int) -> float | None:
    """Return the radius within which half of the states have five neighbours; None without neighbours.

    More neighbours increase the radius and the exponents of flows: with ten neighbours of three quarters of
    the states, the exponent of 20,000 samples of the Lorenz equations is a fifth above the known one, with
    five of half of them a tenth.
    """
    pool = Neighbours(states, theiler, last)
    squares = pool.nearest(pool.references(SOME), CROWD)[1]
    square = float(np.sort(squares)[int(CROWDED * (len(squares) - 1))])
    # Slightly larger, because rounding would split ties.
    return math.sqrt(square) * (1 + 1e-9) if 0.0 < square < math.inf else None


def _curve(part: Callable[[Ints], tuple[Floats, Ints]], rows: Ints, poll: Poll) -> Curve:
    done = []
    for some in np.array_split(rows, min(BLOCKS, len(rows))):
        poll()
        done.append(part(some))
    sums, counts = zip(*done, strict=True)
    return Curve(np.array(sums), np.array(counts), len(rows))
