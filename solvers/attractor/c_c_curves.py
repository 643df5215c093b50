"""Curves of the C-C methods: correlation sums of disjoint subseries over the delay.

Source: the paper of :mod:`crosstrack.models.attractor.model`, equations 2-10. Equations 2-7 are the C-C method of
H. S. Kim, R. Eykholt and J. D. Salas, "Nonlinear dynamics, delay times, and embedding windows", Physica D 127,
1999. Equations 8-10 are the paper's improvement.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["Curves", "close_pairs", "correlation_sums", "curves", "longest_delay"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Largest dimension m of the sums, and the radii r_j in standard deviations of the series.
LARGEST, RADII = 5, (0.5, 1.0, 1.5, 2.0)
#: States of the largest dimension that a subseries must have.
_STATES = 10


@kernel
def close_pairs(series: Floats, step: int, radii: Floats, largest: int) -> Ints:
    """Return the number of pairs of states within each radius, shape (subseries, dimensions, radii).

    Each of `step` subseries takes every `step`-th sample, and consecutive samples are coordinates.
    Dimensions 1 … `largest` are counted, with the largest difference of a coordinate as the distance. A
    distance equal to a radius counts (theta(0) = 1 in equation 2); the radii ascend.
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
                while slot < count and apart > radii[slot]:
                    slot += 1
                if slot == count:
                    break
                close[part, m, slot] += 1
    # A radius contains the pairs of all smaller radii.
    for part in range(step):
        for m in range(largest):
            for r in range(1, count):
                close[part, m, r] += close[part, m, r - 1]
    return close


def correlation_sums(series: Floats, delay: int) -> Floats:
    """Return C_s(m, r, t) of equation 2 for the t = `delay` subseries of equation 3, shape (t, 5, 4).

    Each subseries has INT(n / t) samples, so the last n modulo t samples are not used.
    """
    length = len(series) // delay
    radii = np.array(RADII) * float(series.std())
    states = length - np.arange(LARGEST)
    sums: Floats = (
        2.0 * close_pairs(series[: length * delay], delay, radii, LARGEST)
        / (states * (states - 1))[:, None]
    )  # fmt: skip
    return sums


@dataclass(frozen=True)
class Curves:
    """The curves over the delays 1, 2, ….

    `sums` is the mean correlation sum C(t), equations 8 and 9; `mean` the mean statistic S(t), equations 5
    and 7; `spread` the mean dispersion ΔS(t) between the radii, equations 6 and 7.
    """

    sums: Floats
    mean: Floats
    spread: Floats

    @property
    def combined(self) -> Floats:
        """S_cor(t) = ΔS(t) + |S(t)|, equation 7."""
        combined: Floats = self.spread + np.abs(self.mean)
        return combined

    @property
    def periodic(self) -> Floats:
        """S_c(t) = C(t) - S(t), equation 10.

        The sums of m coordinates cancel, so this is the mean of C_s(1, r, t)^m, which contains sums of a
        single coordinate only.
        """
        periodic: Floats = self.sums - self.mean
        return periodic


def longest_delay(count: int, most: int) -> int:
    """Return the longest delay up to `most` whose subseries hold ten states of the largest dimension."""
    return max(min(most, count // (_STATES + LARGEST - 1)), 1)


def curves(series: Floats, most: int, *, stopped: Callable[[], bool] = lambda: False) -> Curves:
    """Return the curves for the delays 1 … `most`, or for fewer delays if `stopped` returns true."""
    powers = np.arange(2, LARGEST + 1)[:, None]
    rows = []
    for t in range(1, most + 1):
        sums = correlation_sums(series, t)
        statistic = (sums[:, 1:] - sums[:, :1] ** powers).mean(axis=0)
        rows.append((sums[:, 1:].mean(), statistic.mean(), np.ptp(statistic, axis=1).mean()))
        if stopped():
            break
    return Curves(*np.array(rows).T)
