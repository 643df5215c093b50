"""The curves of the C-C method: how far values a delay apart are from independent, from correlation sums.

Sources: H. S. Kim, R. Eykholt and J. D. Salas, "Nonlinear dynamics, delay times, and embedding windows",
Physica D 127, 1999; Z.-B. Lu, Z.-M. Cai and K.-Y. Jiang, "Determination of embedding parameters for phase space
reconstruction based on improved C-C method", Journal of System Simulation 19, 2007.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .nearest import thin_out

__all__ = ["Curves", "close_pairs", "curves", "statistic", "whole_statistic"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Largest dimension of the sums, and the radii in deviations of the series.
LARGEST, RADII = 5, (0.5, 1.0, 1.5, 2.0)
#: States at the most whose neighbours are counted in the whole series.
_ASKED = 300
#: States of the largest dimension that a subseries must have.
_STATES = 10


@kernel
def close_pairs(series: Floats, step: int, radii: Floats, largest: int) -> Ints:
    """Return how many pairs of states are closer than each radius, in `step` disjoint subseries.

    Parameters
    ----------
    series : ndarray, shape (n,)
    step : int
        Each subseries has every so many samples, one of which lies between coordinates.
    radii : ndarray, shape (R,)
        Ascending.
    largest : int
        Dimensions 1 … `largest` are counted, by the largest difference of a coordinate.

    Returns
    -------
    ndarray, shape (step, largest, R)
    """
    last = len(series)
    count = len(radii)
    close = np.zeros((step, largest, count), np.int64)
    for i in range(last):
        part = i % step
        for j in range(i + step, last, step):
            slot = 0
            for m in range(largest):
                if j + m * step >= last:
                    break
                apart = abs(series[i + m * step] - series[j + m * step])
                while slot < count and apart >= radii[slot]:
                    slot += 1
                if slot == count:
                    break
                close[part, m, slot] += 1
    # A radius holds what smaller ones hold.
    for part in range(step):
        for m in range(largest):
            for r in range(1, count):
                close[part, m, r] += close[part, m, r - 1]
    return close


def _radii(series: Floats) -> Floats:
    return np.array(RADII) * float(series.std())


def statistic(series: Floats, delay: int) -> Floats:
    """Return S(m, N, r, t) of m = 2 … 5 and the radii, averaged over `delay` disjoint subseries.

    S is the correlation sum less the one of a single coordinate to the power m: 0 where values are independent.

    Parameters
    ----------
    series : ndarray, shape (n,)
    delay : int
        t: each subseries has every t-th sample.

    Returns
    -------
    ndarray, shape (4, 4)
    """
    close = close_pairs(series, delay, _radii(series), LARGEST)
    lengths = (len(series) - np.arange(delay) + delay - 1) // delay
    states = lengths[:, None] - np.arange(LARGEST)
    found: Floats = _excess(close / (states * (states - 1) / 2)[:, :, None]).mean(axis=0)
    return found


def slots(series: Floats) -> NDArray[np.uint8]:
    """Return how many radii the distance of each pair of values reaches, shape (n, n)."""
    radii = _radii(series)
    found = np.empty((len(series), len(series)), np.uint8)
    for i, value in enumerate(series):
        found[i] = np.searchsorted(radii, np.abs(series - value), side="right")
    return found


def whole_statistic(slot: NDArray[np.uint8], delay: int) -> Floats:
    """Return S(m, N, r, t) from the states of the whole series, those near in time included.

    The states of 300 samples at most are compared with all others.

    Parameters
    ----------
    slot : ndarray, shape (n, n)
        From :func:`slots`.
    delay : int

    Returns
    -------
    ndarray, shape (4, 4)
    """
    sums = np.empty((LARGEST, len(RADII)))
    for m in range(1, LARGEST + 1):
        count = len(slot) - (m - 1) * delay
        begins = thin_out(count, _ASKED)
        far = slot[begins, :count]
        for k in range(1, m):
            far = np.maximum(far, slot[begins + k * delay, k * delay : k * delay + count])
        pairs = len(begins) * (count - 1)
        for r in range(len(RADII)):
            # No state is a neighbour of itself.
            sums[m - 1, r] = (np.count_nonzero(far <= r) - len(begins)) / pairs
    return _excess(sums)


def _excess(sums: Floats) -> Floats:
    """Return what correlation sums of 1, 2, … coordinates, the axis before the last, have over independence."""
    powers = np.arange(2, LARGEST + 1)[:, None]
    found: Floats = sums[..., 1:, :] - sums[..., :1, :] ** powers
    return found


@dataclass(frozen=True)
class Curves:
    """The curves of the delays 1, 2, ….

    Parameters
    ----------
    mean : ndarray, shape (t,)
        S̄, the mean over dimensions and radii.
    spread : ndarray, shape (t,)
        ΔS̄, the largest difference between radii, averaged over dimensions.
    whole : ndarray, shape (t,), optional
        The mean from the whole series, of the improved method.
    """

    mean: Floats
    spread: Floats
    whole: Floats | None = None

    @property
    def combined(self) -> Floats:
        """S_cor = ΔS̄ + |S̄|."""
        found: Floats = self.spread + np.abs(self.mean)
        return found


def longest_delay(count: int, most: int) -> int:
    """Return the longest delay up to `most` whose subseries hold ten states of the largest dimension."""
    return max(min(most, count // (_STATES + LARGEST - 1)), 1)


def curves(
    series: Floats, most: int, *, improved: bool, stopped: Callable[[], bool] = lambda: False
) -> Curves:
    """Return the curves of the delays 1 … `most`; of fewer where `stopped` said so meanwhile.

    The improved method takes the spread from the whole series, which is smoother than the mean of the subseries.
    """
    slot = slots(series) if improved else None
    parts, all_of_it = [], []
    for t in range(1, most + 1):
        parts.append(statistic(series, t))
        if slot is not None:
            all_of_it.append(whole_statistic(slot, t))
        if stopped():
            break
    mean = np.array([one.mean() for one in parts])
    spread = np.array([np.ptp(one, axis=1).mean() for one in all_of_it or parts])
    return Curves(mean, spread, np.array([one.mean() for one in all_of_it]) if improved else None)
