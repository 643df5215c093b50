"""Nine chaotic systems on which nothing was tuned, for the table of verdicts.

The list was fixed before the first measurement. Exponents are computed from two orbits 1e-8 apart (Benettin), and
observed coordinates are the first ones. Sources of the equations: J. C. Sprott, Chaos and Time-Series Analysis, 2003,
appendix A; lines name other sources.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numba import njit

__all__ = ["UNSEEN", "Unseen", "exponent_of", "observed"]


class Unseen(NamedTuple):
    """A system: its number (negative for maps), its start, and the seconds between samples."""

    number: int
    start: tuple[float, ...]
    period: float


UNSEEN: Mapping[str, Unseen] = {
    "ricker": Unseen(-1, (0.1, 0.0, 0.0), 1.0),
    "gauss": Unseen(-2, (0.1, 0.0, 0.0), 1.0),
    "predator and prey": Unseen(-3, (0.5, 0.5, 0.0), 1.0),
    "lu": Unseen(1, (0.1, 0.3, -0.6), 0.02),
    "shimizu-morioka": Unseen(2, (0.1, 0.1, 0.2), 0.25),
    "genesio-tesi": Unseen(3, (0.1, 0.1, 0.1), 0.4),
    "lorenz 1984": Unseen(4, (1.0, 1.0, 0.5), 0.1),
    "rikitake": Unseen(5, (1.0, 0.0, 0.6), 0.15),
    "sprott d": Unseen(6, (0.05, 0.05, 0.05), 0.25),
}


@njit(cache=True)
def rates(number: int, u: np.ndarray, d: np.ndarray) -> None:
    """Fill in the time derivatives of a state."""
    x, y, z = u[0], u[1], u[2]
    if number == 1:  # Lü and Chen 2002
        d[0], d[1], d[2] = 36.0 * (y - x), 20.0 * y - x * z, x * y - 3.0 * z
    elif number == 2:  # Shimizu and Morioka 1980
        d[0], d[1], d[2] = y, x - 0.85 * y - x * z, x * x - 0.5 * z
    elif number == 3:  # Genesio and Tesi 1992
        d[0], d[1], d[2] = y, z, -x - 1.1 * y - 0.44 * z + x * x
    elif number == 4:  # Lorenz 1984
        d[0] = -y * y - z * z - 0.25 * x + 2.0
        d[1] = x * y - 4.0 * x * z - y + 1.0
        d[2] = 4.0 * x * y + x * z - z
    elif number == 5:  # Rikitake's dynamo
        d[0], d[1], d[2] = -x + z * y, -y + (z - 1.0) * x, 1.0 - x * y
    else:  # Sprott's case D
        d[0], d[1], d[2] = -y, x + z, x * z + 3.0 * y * y


@njit(cache=True)
def advance(number: int, u: np.ndarray, step: float, k: np.ndarray) -> None:
    """Advance a state by one step of a map or of the method of Runge and Kutta."""
    x, y = u[0], u[1]
    if number == -1:
        u[0] = 20.0 * x * math.exp(-x)
    elif number == -2:  # Gauss' mouse map
        u[0] = math.exp(-6.2 * x * x) - 0.5
    elif number == -3:  # Beddington, Free and Lawton 1975
        u[0], u[1] = x * math.exp(3.0 * (1.0 - x) - 5.0 * y), x * (1.0 - math.exp(-5.0 * y))
    else:
        rates(number, u, k[0])
        rates(number, u + 0.5 * step * k[0], k[1])
        rates(number, u + 0.5 * step * k[1], k[2])
        rates(number, u + step * k[2], k[3])
        u += step * (k[0] + 2.0 * k[1] + 2.0 * k[2] + k[3]) / 6.0


@njit(cache=True)
def orbit(number: int, u: np.ndarray, step: float, inner: int, found: np.ndarray) -> float:
    """Fill in an orbit of samples, and return the mean logarithmic growth of a small distance per sample."""
    k, v, total = np.zeros((4, len(u))), u.copy(), 0.0
    v[0] += 1e-8
    for row in range(len(found)):
        for _ in range(inner):
            advance(number, u, step, k)
            advance(number, v, step, k)
        found[row] = u[0]
        apart = math.sqrt(((v - u) ** 2).sum())
        total += math.log(max(apart, 1e-15) / 1e-8)
        v[:] = u + (v - u) * (1e-8 / max(apart, 1e-15))
    return total / len(found)


def _run(name: str, count: int, seed: int) -> tuple[np.ndarray, float]:
    known = UNSEEN[name]
    state = np.array(known.start)
    state[0] += 1e-3 * np.random.default_rng(seed).random()
    inner = 1 if known.number < 0 else max(math.ceil(known.period / 0.005), 1)
    skipped, found = np.empty(1000 + 7 * seed), np.empty(count)
    orbit(known.number, state, known.period / inner, inner, skipped)
    growth = orbit(known.number, state, known.period / inner, inner, found)
    return found, growth / known.period


def observed(name: str, count: int, seed: int = 0) -> np.ndarray:
    """Return the observed coordinate of a system after a transient."""
    return _run(name, count, seed)[0]


def exponent_of(name: str, count: int = 200_000) -> float:
    """Return the largest exponent in nats per second over so many samples."""
    return _run(name, count, 0)[1]
