"""How neighbouring states part as time goes on: the curves that exponents are read from."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...models.attractor.checks import ALL
from .neighbour_kernels import mean_partings, nearest_partings, nearest_states
from .regions import whole_slope

__all__ = ["FEW", "MOST", "Curve", "Neighbours", "kantz_curve", "kantz_radius", "rosenstein_curve"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Stopped = Callable[[], bool]

#: States that are asked for their neighbours at the least and at the most, where not all are.
SOME, MOST = 500, 10_000
#: Pairs that a search may look at, which decides between the two, and states that are asked how many it takes.
WORK, PILOT = 50_000_000, 50
#: Coordinates that the means of Kantz may take, and how many states are asked whatever it takes.
MEANS, FEW = 100_000_000, 100
#: Blocks of time for the deviation; the clock is looked at between them.
BLOCKS = 20
#: Neighbours within the radius of Kantz that :data:`CROWDED` of the states have.
CROWD, CROWDED = 5, 0.5


@dataclass(frozen=True, eq=False)
class Curve:
    """Sums of the logarithms of distances, by blocks of time.

    Parameters
    ----------
    sums : ndarray, shape (blocks, high + 1)
        Over the reference states of a block.
    counts : ndarray, shape (blocks, high + 1)
        How many were summed.
    references : int
        How many states were asked for neighbours.
    """

    sums: Floats
    counts: Ints
    references: int

    @property
    def values(self) -> Floats:
        """Mean logarithm of the distance at steps 0 … high, not a number where there is none."""
        return _mean(self.sums.sum(axis=0), self.counts.sum(axis=0))

    def slope(self, low: int, high: int, period: float) -> tuple[float, float]:
        """Return the slope from `low` to `high` steps, and its standard deviation, see :func:`whole_slope`."""
        x = np.arange(low, high + 1, dtype=np.float64) * period
        part = slice(low, high + 1)
        sums, counts = self.sums[:, part], self.counts[:, part]
        held = counts.any(axis=1)
        sums, counts = sums[held], counts[held]
        left_out = _mean(sums.sum(axis=0) - sums, counts.sum(axis=0) - counts)
        return whole_slope(x, self.values[part], left_out)


def _mean(sums: Floats, counts: Ints) -> Floats:
    with np.errstate(all="ignore"):
        found: Floats = np.where(counts > 0, sums / counts, np.nan)
    return found


class Neighbours:
    """States ordered for the search of neighbours, and those that are asked for theirs.

    Parameters
    ----------
    states : ndarray, shape (m, d)
        All states, in the order of time.
    theiler : int
        States at most as many samples apart are no neighbours.
    last : int
        Only states before it take part.
    """

    def __init__(self, states: Floats, theiler: int, last: int) -> None:
        self.states, self.theiler, self.last = states, theiler, last
        self.times = np.argsort(states[:last, 0], kind="stable")
        self.ordered = states[self.times]
        self.places = np.empty(last, np.int64)
        self.places[self.times] = np.arange(last)

    def asked(self, count: int) -> Ints:
        """Return so many states, drawn alike from all times, in their order; all where there are few."""
        if len(self.states) <= ALL or count >= self.last:
            return np.arange(self.last)
        return np.sort(np.random.default_rng(0).choice(self.last, count, replace=False))

    def nearest(self, some: Ints, rank: int = 1) -> tuple[Ints, Floats, int]:
        """Return the neighbours of some states, their squared distances, and the pairs looked at."""
        found: tuple[Ints, Floats, int] = nearest_states(
            self.ordered, self.times, self.places[some], self.theiler, rank
        )
        return found

    def within(self, some: Ints, radius: float, ahead: int) -> tuple[Floats, Ints, int]:
        """Return the sums and counts of the mean partings of some states, and how many neighbours they have."""
        found: tuple[Floats, Ints, int] = mean_partings(
            self.states, self.ordered, self.times, self.places[some], self.theiler, radius**2, ahead
        )
        return found

    @property
    def pilot(self) -> Ints:
        """Some states, evenly spaced in time."""
        return np.unique(np.linspace(0, self.last - 1, PILOT).astype(np.int64))


def rosenstein_curve(
    states: Floats,
    theiler: int,
    last: int,
    high: int,
    *,
    references: int = MOST,
    stopped: Stopped = bool,
) -> Curve | None:
    """Return how the states before `last` part from their nearest neighbours, 0 … `high` steps ahead.

    Parameters
    ----------
    states : ndarray, shape (m, d)
        In the order of time.
    theiler : int
        States at most as many samples apart are no neighbours.
    last, high : int
        With ``last + high <= m``.
    references : int
        States asked at the most; up to 1500 all are.
    stopped : callable
        Asked between blocks of time.

    Returns
    -------
    Curve, optional
        None where it was stopped.
    """
    pool = Neighbours(states, theiler, last)
    visits = pool.nearest(pool.pilot)[2]
    asked = pool.asked(min(max(WORK * PILOT // max(visits, 1), SOME), references))

    def part(some: Ints) -> tuple[Floats, Ints]:
        found: tuple[Floats, Ints] = nearest_partings(states, some, pool.nearest(some)[0], high)
        return found

    return _curve(part, asked, stopped)


def kantz_curve(
    states: Floats,
    theiler: int,
    last: int,
    high: int,
    *,
    radius: float,
    references: int = MOST,
    stopped: Stopped = bool,
) -> Curve | None:
    """Return how the states before `last` part from all that lie within `radius`, 0 … `high` steps ahead.

    The parameters are those of :func:`rosenstein_curve`.
    """
    pool = Neighbours(states, theiler, last)
    neighbours = pool.within(pool.pilot, radius, 0)[2]
    cost = max(neighbours, 1) * (high + 1) * states.shape[1]
    asked = pool.asked(min(max(MEANS * PILOT // cost, FEW), references))
    return _curve(lambda some: pool.within(some, radius, high)[:2], asked, stopped)


def kantz_radius(states: Floats, theiler: int, last: int) -> float | None:
    """Return the radius within which half of the states have five neighbours; None where they have none.

    More neighbours make the radius larger, and the exponents of flows too great: with ten of three quarters of the
    states, that of 20,000 samples of the Lorenz equations is a fifth above the known one, with five of half of them
    a tenth.
    """
    pool = Neighbours(states, theiler, last)
    squares = pool.nearest(pool.asked(SOME), CROWD)[1]
    square = float(np.sort(squares)[int(CROWDED * (len(squares) - 1))])
    # Beyond a tie, which rounding would split.
    return math.sqrt(square) * (1 + 1e-9) if 0.0 < square < math.inf else None


def _curve(
    part: Callable[[Ints], tuple[Floats, Ints]], asked: Ints, stopped: Stopped
) -> Curve | None:
    done = []
    for some in np.array_split(asked, min(BLOCKS, len(asked))):
        if stopped():
            return None
        done.append(part(some))
    sums, counts = zip(*done, strict=True)
    return Curve(np.array(sums), np.array(counts), len(asked))
