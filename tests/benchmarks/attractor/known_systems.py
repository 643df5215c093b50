"""Systems with known exponents and dimensions, and series without chaos, for the coverage of the estimates.

Exponents are those of J. C. Sprott, Chaos and Time-Series Analysis, Oxford 2003, appendix A. Each agrees within 3 % with
that of :func:`separation_exponent`, which follows two orbits by the equations. Four are computed this way only.
Correlation dimensions are exact, those of Sprott, that of P. Grassberger and I. Procaccia, Physical Review Letters 50,
1983, page 346, or computed by :func:`state_dimension` from 150,000 states with all coordinates.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.signal import lfilter
from scipy.spatial import cKDTree

from crosstrack.instances.attractor.systems import generate

__all__ = [
    "CALIBRATION",
    "HELD_OUT",
    "SYSTEMS",
    "Known",
    "null_series",
    "separation_exponent",
    "series_of",
    "state_dimension",
]

Floats = np.ndarray


class Known(NamedTuple):
    """Figures of a system.

    Parameters
    ----------
    number : int
        Equations in :func:`rates` or :func:`map_step`; negative for maps.
    start : tuple of float
        State near the attractor.
    period : float
        Seconds between samples; 1 for maps.
    exponent : float
        Largest Lyapunov exponent, nats per second.
    dimension : float, optional
        Correlation dimension.
    exponent_source, dimension_source : str
        Sources of both figures.
    coordinate : int
        Coordinate that is observed.
    """

    number: int
    start: tuple[float, ...]
    period: float
    exponent: float
    dimension: float | None
    exponent_source: str
    dimension_source: str = ""
    coordinate: int = 0


@njit(cache=True)
def map_step(number: int, u: Floats) -> None:
    """Replace a state by the next one of a map."""
    x, y = u[0], u[1]
    if number == -1:  # logistic; the added term keeps rounding from ending the orbit at 0
        u[0] = 4.0 * x * (1.0 - x) * (1.0 - 1e-13) + 1e-14
    elif number == -2:  # Hénon
        u[0], u[1] = 1.0 - 1.4 * x * x + y, 0.3 * x
    elif number == -3:  # Ikeda
        phase = 0.4 - 6.0 / (1.0 + x * x + y * y)
        c, s = math.cos(phase), math.sin(phase)
        u[0], u[1] = 1.0 + 0.9 * (x * c - y * s), 0.9 * (x * s + y * c)
    elif number == -4:  # delayed logistic
        u[0], u[1] = 2.27 * x * (1.0 - y), x
    elif number == -5:  # Holmes' cubic
        u[0], u[1] = y, -0.2 * x + 2.77 * y - y**3
    elif number == -6:  # Kaplan and Yorke
        u[0], u[1] = (2.0 * x) % 0.99999999999995, 0.2 * y + math.cos(4.0 * math.pi * x)
    elif number == -7:  # Burgers
        u[0], u[1] = 0.75 * x - y * y, 1.75 * y + x * y
    elif number == -8:  # Arnold's cat
        u[0] = (x + y) % 1.0
        u[1] = (x + 2.0 * y) % 1.0
    elif number == -9:  # Lozi
        u[0], u[1] = 1.0 + y - 1.7 * abs(x), 0.5 * x
    elif number == -10:  # Tinkerbell
        u[0], u[1] = x * x - y * y + 0.9 * x - 0.6 * y, 2.0 * x * y + 2.0 * x + 0.5 * y
    elif number == -11:  # cubic
        u[0] = 3.0 * x * (1.0 - x * x) * (1.0 - 1e-13)
    elif number == -12:  # dissipative standard
        u[1] = (0.1 * y + 8.8 * math.sin(x)) % (2.0 * math.pi)
        u[0] = (x + u[1]) % (2.0 * math.pi)
    elif number == -13:  # gingerbreadman
        u[0], u[1] = 1.0 - y + abs(x), x
    elif number == -14:  # sine
        u[0] = math.sin(math.pi * x) * (1.0 - 1e-13)
    elif number == -16:  # Grebogi, Ott, Pelikan and Yorke: strange, not chaotic
        u[0] = 3.0 * math.tanh(x) * math.cos(2.0 * math.pi * y)
        u[1] = (y + 0.6180339887498949) % 1.0


@njit(cache=True)
def rates(number: int, u: Floats, t: float, d: Floats) -> None:
    """Fill in the time derivatives of a state."""
    x, y, z = u[0], u[1], u[2]
    if number == 1:  # Lorenz
        d[0], d[1], d[2] = 10.0 * (y - x), x * (28.0 - z) - y, x * y - 8.0 / 3.0 * z
    elif number == 2:  # Rössler
        d[0], d[1], d[2] = -y - z, x + 0.2 * y, 0.2 + z * (x - 5.7)
    elif number == 3:  # Chen
        d[0], d[1], d[2] = 35.0 * (y - x), -7.0 * x - x * z + 28.0 * y, x * y - 3.0 * z
    elif number == 4:  # diffusionless Lorenz
        d[0], d[1], d[2] = -y - x, -x * z, x * y + 1.0
    elif number == 5:  # Halvorsen
        d[0] = -1.27 * x - 4.0 * y - 4.0 * z - y * y
        d[1] = -1.27 * y - 4.0 * z - 4.0 * x - z * z
        d[2] = -1.27 * z - 4.0 * x - 4.0 * y - x * x
    elif number == 6:  # Rucklidge
        d[0], d[1], d[2] = -2.0 * x + 6.7 * y - y * z, x, -z + y * y
    elif number == 7:  # Duffing, two wells
        d[0], d[1], d[2] = y, x - x**3 - 0.25 * y + 0.4 * math.sin(z), 1.0
    elif number == 8:  # Chua
        bend = -5.0 / 7.0 * x - 1.5 / 7.0 * (abs(x + 1.0) - abs(x - 1.0))
        d[0], d[1], d[2] = 9.0 * (y - x - bend), x - y + z, -100.0 / 7.0 * y
    elif number == 9:  # Ueda
        d[0], d[1], d[2] = y, -(x**3) - 0.05 * y + 7.5 * math.sin(z), 1.0
    elif number == 10:  # Sprott's jerk
        d[0], d[1], d[2] = y, z, -2.017 * z + y * y - x
    elif number == 12:  # complex butterfly
        d[0], d[1], d[2] = (
            0.55 * (y - x),
            -z * (1.0 if x > 0 else -1.0 if x < 0 else 0.0),
            abs(x) - 1.0,
        )
    elif number == 13:  # Thomas
        d[0] = -0.18 * x + math.sin(y)
        d[1] = -0.18 * y + math.sin(z)
        d[2] = -0.18 * z + math.sin(x)
    elif number == 14:  # Sprott's case B
        d[0], d[1], d[2] = y * z, x - y, 1.0 - x * y


@njit(cache=True)
def advance(number: int, u: Floats, step: float, k: Floats) -> None:
    """Advance a state by a step of the method of Runge and Kutta."""
    if number < 0:
        map_step(number, u)
        return
    rates(number, u, 0.0, k[0])
    rates(number, u + 0.5 * step * k[0], 0.0, k[1])
    rates(number, u + 0.5 * step * k[1], 0.0, k[2])
    rates(number, u + step * k[2], 0.0, k[3])
    for i in range(3):
        u[i] += step * (k[0, i] + 2.0 * k[1, i] + 2.0 * k[2, i] + k[3, i]) / 6.0


@njit(cache=True)
def iterate(number: int, u: Floats, step: float, inner: int, skipped: int, found: Floats) -> None:
    """Fill in an orbit, one row per sample."""
    k = np.zeros((4, 3))
    for _ in range(skipped * inner):
        advance(number, u, step, k)
    for row in range(len(found)):
        for _ in range(inner):
            advance(number, u, step, k)
        found[row] = u


@njit(cache=True)
def iterate_pair(number: int, u: Floats, step: float, inner: int, count: int) -> float:
    """Return the mean logarithmic growth per sample of the distance of two orbits 1e-8 apart."""
    k, total = np.zeros((4, 3)), 0.0
    v = u.copy()
    v[0] += 1e-8
    for _ in range(count):
        for _ in range(inner):
            advance(number, u, step, k)
            advance(number, v, step, k)
        apart = math.sqrt(((v - u) ** 2).sum())
        if not 0.0 < apart < 1e-2:  # one of them crossed the edge of a circle
            v[:] = u
            v[0] += 1e-8
            continue
        total += math.log(apart / 1e-8)
        v[:] = u + (v - u) * (1e-8 / apart)
    return total / count


_BOOK, _OURS, _EXACT = "Sprott", "computed", "exact"
_PROCACCIA = "Grassberger and Procaccia"
#: Systems on which the constants of :mod:`crosstrack.solvers.attractor.regions` are calibrated.
CALIBRATION: Mapping[str, Known] = {
    "logistic": Known(-1, (0.3, 0, 0), 1, math.log(2), 1.0, _EXACT, _EXACT),
    "henon": Known(-2, (0.1, 0.1, 0), 1, 0.41922, 1.220, _BOOK, _BOOK),
    "ikeda": Known(-3, (0.1, 0.1, 0), 1, 0.5076, 1.690, _BOOK, _BOOK),
    "delayed logistic": Known(-4, (0.9, 0.9, 0), 1, 0.18312, None, _BOOK),
    "holmes": Known(-5, (1.6, 0.0, 0), 1, 0.59458, 1.21, _BOOK, _OURS),
    "kaplan-yorke": Known(-6, (0.2, 0.4, 0), 1, math.log(2), 1.42, _EXACT, _OURS, 1),
    "burgers": Known(-7, (-0.1, 0.1, 0), 1, 0.12076, 1.39, _BOOK, _OURS),
    "cat": Known(-8, (0.2, 0.4, 0), 1, 0.962424, 2.0, _EXACT, _EXACT),
    "lorenz": Known(1, (1, 1, 20), 0.05, 0.9056, 2.068, _BOOK, _BOOK),
    "rossler": Known(2, (-4, 0, 0), 0.3, 0.0714, 1.991, _BOOK, _BOOK),
    "chen": Known(3, (-3, 2, 20), 0.02, 2.0272, 2.10, _BOOK, _OURS),
    "diffusionless lorenz": Known(4, (1, 0, 1), 0.2, 0.2101, 2.105, _BOOK, _OURS),
    "halvorsen": Known(5, (-5, 0, 0), 0.05, 0.7899, 2.05, _BOOK, _OURS),
    "rucklidge": Known(6, (1, 0, 4.5), 0.2, 0.1923, 2.05, _OURS, _OURS),
    "sprott b": Known(14, (0.5, 0.5, 0.5), 0.25, 0.210, 2.10, _BOOK, _OURS),
}
#: Systems on which the coverage is reported.
HELD_OUT: Mapping[str, Known] = {
    "lozi": Known(-9, (-0.1, 0.1, 0), 1, 0.47023, 1.393, _BOOK, _OURS),
    "tinkerbell": Known(-10, (-0.72, -0.64, 0), 1, 0.18997, 1.24, _BOOK, _OURS),
    "cubic": Known(-11, (0.1, 0, 0), 1, math.log(3), 1.0, _EXACT, _EXACT),
    "dissipative standard": Known(-12, (0.1, 0.1, 0), 1, 1.46995, 1.31, _BOOK, _OURS),
    "gingerbreadman": Known(-13, (0.5, 3.7, 0), 1, 0.07339, 2.0, _BOOK, _EXACT),
    "sine map": Known(-14, (0.1, 0, 0), 1, 0.689067, 1.0, _BOOK, _EXACT),
    "duffing": Known(7, (0.2, 0, 0), 0.3, 0.1553, 2.28, _OURS, _OURS),
    "chua": Known(8, (0, 0, 0.6), 0.15, 0.3271, 2.00, _BOOK, _OURS),
    "ueda": Known(9, (2.5, 0, 0), 0.2, 0.1034, 2.675, _BOOK, _BOOK),
    "jerk": Known(10, (0, 0, 1), 0.4, 0.0551, 1.94, _BOOK, _OURS),
    "butterfly": Known(12, (0.2, 0, 0), 0.3, 0.1690, 2.33, _BOOK, _OURS),
    "thomas": Known(13, (0.1, 0, 0), 0.3, 0.0349, None, _BOOK),
    "mackey-glass": Known(0, (), 2.0, 0.0051, 1.95, _OURS, _PROCACCIA),
}
SYSTEMS: Mapping[str, Known] = {**CALIBRATION, **HELD_OUT}
#: Strange and not chaotic: the largest exponent is 0.
GOPY = Known(-16, (0.5, 0.1, 0), 1, 0.0, None, "Grebogi, Ott, Pelikan and Yorke 1984")
#: Longest step of an integration, s: of fast flows and of others.
FAST, SLOW = 0.004, 0.02


def inner_steps(known: Known) -> tuple[int, float]:
    """Return the number of steps per sample, and their length."""
    if known.number < 0:
        return 1, 1.0
    inner = max(math.ceil(known.period / (FAST if known.number in (1, 3, 5) else SLOW)), 4)
    return inner, known.period / inner


def orbit_of(known: Known, count: int, seed: int = 0) -> Floats:
    """Return the states of an orbit on the attractor, shape (count, 3)."""
    state = np.array(known.start, float)
    inner, step = inner_steps(known)
    moved = 2 if known.number in (7, 9) else 3
    state[:moved] += (1e-3 if known.number < 0 else 1e-2) * np.random.default_rng(seed).random(
        moved
    )
    seconds = 1000 if known.number < 0 else 300 if known.period > 0.1 else 60
    found = np.empty((count, 3))
    iterate(known.number, state, step, inner, math.ceil(seconds / known.period) + 7 * seed, found)
    return found


def series_of(name: str, count: int, seed: int = 0) -> Floats:
    """Return the observed coordinate of a system of :data:`SYSTEMS`, or of ``"gopy"``."""
    if name == "mackey-glass":
        return generate(name, count, seed=seed, period=SYSTEMS[name].period).series
    known = GOPY if name == "gopy" else SYSTEMS[name]
    return orbit_of(known, count, seed)[:, known.coordinate].copy()


def separation_exponent(name: str, count: int) -> float:
    """Return the exponent by the separation of two orbits over so many samples, nats per second."""
    known = SYSTEMS[name]
    inner, step = inner_steps(known)
    state = orbit_of(known, 1)[0].copy()
    return float(iterate_pair(known.number, state, step, inner, count) / known.period)


def state_dimension(name: str, count: int = 150_000) -> float:
    """Return the correlation dimension of the states with all coordinates, by counts with a KD-tree."""
    known = SYSTEMS[name]
    every = 7 if known.number > 0 else 1
    states = orbit_of(known, count * every, seed=3)[::every]
    if known.number in (7, 9):  # a phase
        states = np.c_[states[:, :2], 3 * np.cos(states[:, 2]), 3 * np.sin(states[:, 2])]
    states = states / states.std(axis=0).clip(1e-9)
    one, two = np.random.default_rng(0).integers(0, count, (2, 400_000))
    apart = np.abs(states[one] - states[two]).max(axis=1)[one != two]
    largest = float(np.quantile(apart, 2e-3))
    radii = np.geomspace(largest / (40 if known.number > 0 else 150), largest, 14)
    tree = cKDTree(states)
    pairs = (tree.count_neighbors(tree, radii, p=np.inf) - count) / 2
    good = pairs > 2000
    return float(np.polyfit(np.log(radii[good]), np.log(pairs[good]), 1)[0])


def randomised(series: Floats, rng: np.random.Generator) -> Floats:
    """Return a series with the spectrum of another one and drawn phases."""
    spectrum = np.abs(np.fft.rfft(series - series.mean()))
    return np.fft.irfft(spectrum * np.exp(2j * np.pi * rng.random(len(spectrum))), len(series))


def null_series(count: int, seed: int) -> Iterator[tuple[str, Floats]]:
    """Yield ten series of `count` samples without chaos, by kind."""
    rng = np.random.default_rng(seed)
    shocks = rng.normal(size=(6, count + 1000))
    radius, angle = rng.uniform(0.9, 0.99), rng.uniform(0.2, 0.8)
    resonance = [1.0, -2.0 * radius * math.cos(angle), radius * radius]
    times, phases = np.arange(count), 2.0 * np.pi * rng.random(4)
    speed = rng.uniform(0.1, 0.4)
    yield "autoregressive, order 1", lfilter([1.0], [1.0, -0.9], shocks[0])[1000:]
    yield "autoregressive, order 2", lfilter([1.0], resonance, shocks[1])[1000:]
    yield "bent autoregressive noise", np.exp(0.5 * lfilter([1.0], [1.0, -0.8], shocks[2])[1000:])
    yield "random walk", np.cumsum(shocks[3])[1000:]
    size = np.maximum(np.fft.rfftfreq(count), 1.0 / count) ** -0.5
    yield "noise of spectrum 1/f", randomised(np.fft.irfft(size, count), rng)
    yield "phases of lorenz drawn", randomised(series_of("lorenz", count, seed), rng)
    yield "phases of henon drawn", randomised(series_of("henon", count, seed), rng)
    wave = np.sin(speed * times + phases[0]) + 0.5 * np.sin(2.0 * speed * times + phases[1])
    yield "periodic", wave
    yield "quasi-periodic", wave + np.sin((speed * math.sqrt(2.0)) * times + phases[2])
    yield "strange, not chaotic", series_of("gopy", count, seed)
