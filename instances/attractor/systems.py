"""Series of known systems, of noise and of simple signals, and their distortions.

Known figures are those of J. C. Sprott, Chaos and Time-Series Analysis, Oxford 2003, appendix A, and of
P. Grassberger and I. Procaccia, Physical Review Letters 50, 1983, page 346.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from enum import StrEnum
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...jit import kernel
from ...models.attractor.model import LEAST, MOST, AttractorAnalysis
from ...models.fields import Optional, Real, Whole
from ...models.records import Member
from .motions import HENON, LORENZ, ROSSLER, Motion, bounded_steps, orbit

__all__ = ["SYSTEMS", "Known", "System", "generate", "motion_of"]

Floats = NDArray[np.float64]


class System(StrEnum):
    """System that generates a series."""

    #: x ← 4 x (1 − x).
    LOGISTIC = "logistic"
    #: x ← 1 − 1.4 x² + y, y ← 0.3 x.
    HENON = "henon"
    #: ẋ = 10 (y − x), ẏ = x (28 − z) − y, ż = x y − 8/3 z.
    LORENZ = "lorenz"
    #: ẋ = −y − z, ẏ = x + 0.2 y, ż = 0.2 + z (x − 5.7).
    ROSSLER = "rossler"
    #: ẋ = 0.2 x(t − 17) / (1 + x(t − 17)¹⁰) − 0.1 x.
    MACKEY_GLASS = "mackey-glass"
    #: One sine of 0.25 rad/s.
    SINE = "sine"
    #: Two sines of 0.25 and 0.25 √2 rad/s.
    TWO_SINES = "two-sines"
    #: Up from 0 to 1 and back at once, every 20 s.
    SAWTOOTH = "sawtooth"
    #: Independent normal values.
    WHITE_NOISE = "white-noise"
    #: x ← 0.9 x + noise.
    AR1 = "ar1"
    #: A resonance near the unit circle: poles of 0.98 at ±0.25 rad per sample, driven by noise.
    AR2 = "ar2"
    #: Sums of independent normal values.
    RANDOM_WALK = "random-walk"


class Known(NamedTuple):
    """Known figures of a system.

    `period` is the default of the seconds between samples; a map or a noise has one value per second. The
    exponent is the largest Lyapunov exponent in nats per second, and the dimension is the correlation
    dimension.
    """

    title: str
    period: float
    exponent: float | None
    dimension: float | None
    chaotic: bool
    source: str


_SPROTT = "Sprott 2003"
_PROCACCIA = "Grassberger and Procaccia 1983"

#: The systems with their known figures.
SYSTEMS: Mapping[System, Known] = MappingProxyType(
    {
        System.LOGISTIC: Known(
            "Logistic map, r = 4", 1.0, math.log(2.0), 1.0, True, "exact: ln 2, and a density"
        ),
        System.HENON: Known(
            "Hénon map", 1.0, 0.41922, 1.21, True, f"exponent {_SPROTT}, dimension {_PROCACCIA}"
        ),
        System.LORENZ: Known(
            "Lorenz' equations", 0.02, 0.9056, 2.05, True, f"exponent {_SPROTT}, dimension {_PROCACCIA}"
        ),
        System.ROSSLER: Known("Rössler's equations", 0.1, 0.0714, 1.991, True, _SPROTT),
        System.MACKEY_GLASS: Known(
            "Mackey and Glass' equation, delay 17 s", 1.0, None, 1.95, True, _PROCACCIA
        ),
        System.SINE: Known("One sine", 1.0, 0.0, 1.0, False, "exact"),
        System.TWO_SINES: Known("Two sines", 1.0, 0.0, 2.0, False, "exact"),
        System.SAWTOOTH: Known("Saw teeth of 20 s", 1.0, 0.0, None, False, "exact"),
        System.WHITE_NOISE: Known("White noise", 1.0, None, None, False, "by its making"),
        System.AR1: Known("Noise of order 1", 1.0, None, None, False, "by its making"),
        System.AR2: Known("Noise of order 2, a resonance", 1.0, None, None, False, "by its making"),
        System.RANDOM_WALK: Known("Random walk", 1.0, None, None, False, "by its making"),
    }
)  # fmt: skip

#: Number of digits that are kept, because machines round elementary functions differently.
_DIGITS = 12
#: Poles of the noise of order 2: radius, and angle in rad per sample.
_RADIUS, _ANGLE = 0.98, 0.25
#: Number of initial values of a noise or a map that are discarded.
_DISCARDED = 1000
#: Delay of Mackey and Glass' equation, its step, and the discarded initial time, s.
_DELAY, _STEP, _TRANSIENT = 17.0, 0.1, 2000.0


def generate(
    system: str,
    count: int = 2000,
    *,
    seed: int = 0,
    period: float | None = None,
    noise: float = 0.0,
    trend: float = 0.0,
    spikes: float = 0.0,
    levels: int | None = None,
    scale: float = 1.0,
    name: str = "",
) -> AttractorAnalysis:
    """Return the series of a known system with its known figures, or a distorted series.

    Parameters
    ----------
    system : str
        A value of the enumeration ``System``, such as ``"lorenz"``. The series is its first coordinate after the transient.
    count : int
        Number of samples.
    seed : int
        Random seed of the initial state, the noise and the distortions.
    period : float, optional
        Seconds between samples, 1e-4 … 1e6. Default: that of ``SYSTEMS``. For maps and noises it is an
        integer, and the values between samples are omitted.
    noise : float
        Deviation of added white noise, in deviations of the series: √10 is a ratio of −10 dB.
    trend : float
        Difference of an added straight line between the first and the last sample, in deviations of the series.
    spikes : float
        Share of the samples that are moved by ten deviations up or down.
    levels : int, optional
        Number of evenly spaced values, from smallest to largest, to which the series is rounded.
    scale : float
        Factor by which the series is multiplied.
    name : str
        Name of the model.

    Returns
    -------
    AttractorAnalysis
        With the exponent and the dimension of the system, unless the series was distorted. The field
        `chaotic` refers to the motion itself in every case.

    Raises
    ------
    InvalidData
        A parameter is not allowed; the message gives its name and range.
    """
    kind = System(Member(System).coerce("system", system, {}))
    known = SYSTEMS[kind]
    count = Whole(LEAST, MOST).coerce("count", count, {})
    seed = Whole(0).coerce("seed", seed, {})
    lag = Optional(Real(1e-4, 1e6, unit="s")).coerce("period", period, {}) or known.period
    noise = Real(0).coerce("noise", noise, {})
    trend = Real().coerce("trend", trend, {})
    spikes = Real(0, 1).coerce("spikes", spikes, {})
    steps = Optional(Whole(2)).coerce("levels", levels, {})
    scale = Real(0, strict=True).coerce("scale", scale, {})
    rng = np.random.default_rng(seed)
    if kind in _MAKERS:
        series = _MAKERS[kind](rng, count, lag)
    else:
        series = orbit(motion_of(kind, rng), count, lag)[:, 0]
    # Fewer digits, because sums of many values may differ in the last ones.
    deviation = float(f"{series.std():.6g}")
    if noise:
        series = series + noise * deviation * _normal(rng, count)
    if trend:
        series = series + trend * deviation * (np.arange(count) / (count - 1))
    if spikes:
        draw = rng.random((2, count))
        away = np.where(draw[1] < 0.5, -10.0, 10.0) * deviation
        series = series + np.where(draw[0] < spikes, away, 0.0)
    if steps is not None:
        low, high = float(series.min()), float(series.max())
        series = low + (high - low) * (
            np.round((series - low) / (high - low) * (steps - 1)) / (steps - 1)
        )
    plain = not (noise or trend or spikes or steps)
    return AttractorAnalysis(
        scale * series,
        lag,
        true_exponent=known.exponent if plain else None,
        true_dimension=known.dimension if plain else None,
        chaotic=known.chaotic,
        name=name,
    )


def motion_of(system: System, rng: np.random.Generator) -> Motion:
    """Return the equations of the Hénon map, of Lorenz or of Rössler, with a random initial state."""
    draw = rng.random(3) - 0.5
    if system is System.HENON:
        return Motion(HENON, np.array([1.4, 0.3]), 0.2 * draw[:2], 1.0, float(_DISCARDED))
    if system is System.LORENZ:
        # Near one of the two foci, from which every orbit spirals out.
        at = np.array([8.0, 8.0, 27.0]) + 4.0 * draw
        return Motion(LORENZ, np.array([10.0, 28.0, 8.0 / 3.0]), at, 0.005, 50.0)
    if system is System.ROSSLER:
        at = np.array([-4.0, 0.0, 0.0]) + draw
        return Motion(ROSSLER, np.array([0.2, 0.2, 5.7]), at, 0.02, 200.0)
    raise InvalidData(
        f"system must be one with a tangent vector: henon, lorenz, rossler, got {system}",
        field="system",
    )


def _normal(rng: np.random.Generator, count: int) -> Floats:
    """Return normal values from uniform ones, by the method of Box and Muller."""
    first, second = rng.random((2, count))
    values = np.sqrt(-2.0 * np.log(1.0 - first)) * np.cos(2.0 * np.pi * second)
    result: Floats = np.round(values, _DIGITS)
    return result


def _whole(period: float, count: int) -> int:
    """Return the period of a map or a noise, limited so that the number of generated values is allowed."""
    return Whole(1, max(MOST // count, 1)).coerce("period", period, {})


def _logistic(rng: np.random.Generator, count: int, period: float) -> Floats:
    every = _whole(period, count)
    draws = rng.random(_DISCARDED + count * every)
    result = np.empty(len(draws))
    _iterate_logistic(draws, result)
    return result[_DISCARDED::every].copy()


def _mackey_glass(rng: np.random.Generator, count: int, period: float) -> Floats:
    inner = max(math.ceil(period / _STEP - 1e-9), 1)
    step = period / inner
    bounded_steps(count, inner)
    start = 0.5 + rng.random(max(round(_DELAY / step), 1) + 1)
    result = np.empty(count)
    _iterate_delayed(start, step, math.ceil(_TRANSIENT / step), inner, result)
    return result


def _sines(
    rng: np.random.Generator, count: int, period: float, speeds: tuple[float, ...]
) -> Floats:
    phases = 2.0 * np.pi * rng.random(len(speeds))
    times = period * np.arange(count)
    waves = [np.sin(speed * times + phase) for speed, phase in zip(speeds, phases, strict=True)]
    result: Floats = np.round(np.sum(waves, axis=0), _DIGITS)
    return result


def _filtered(
    rng: np.random.Generator, count: int, period: float, feedback: tuple[float, ...]
) -> Floats:
    """Return a noise with feedback from past values: ``x[t] = Σ feedback[k] x[t - 1 - k] + noise``."""
    every = _whole(period, count)
    # The operations of `scipy.signal.lfilter` in its order, without the import, which takes 0.7 s.
    values, delayed = [], [0.0] * (len(feedback) + 1)
    for noise in _normal(rng, _DISCARDED + count * every).tolist():
        values.append(delayed[0] + noise)
        for k, factor in enumerate(feedback):
            delayed[k] = delayed[k + 1] + factor * values[-1]
    return np.array(values[_DISCARDED::every])


def _every(values: Floats, period: float) -> Floats:
    """Return one value per period of a noise."""
    return values[:: int(period)].copy()


#: Functions ``(rng, count, period) -> series`` of the systems without a :class:`Motion`.
_MAKERS: Mapping[System, Callable[[np.random.Generator, int, float], Floats]] = {
    System.LOGISTIC: _logistic,
    System.MACKEY_GLASS: _mackey_glass,
    System.SINE: partial(_sines, speeds=(0.25,)),
    System.TWO_SINES: partial(_sines, speeds=(0.25, 0.25 * math.sqrt(2.0))),
    System.SAWTOOTH: lambda rng, count, period: period * np.arange(float(count)) % 20.0 / 20.0,
    System.WHITE_NOISE: lambda rng, count, period: _every(
        _normal(rng, count * _whole(period, count)), period
    ),
    System.AR1: partial(_filtered, feedback=(0.9,)),
    System.AR2: partial(
        _filtered, feedback=(2.0 * _RADIUS * round(math.cos(_ANGLE), _DIGITS), -_RADIUS * _RADIUS)
    ),
    System.RANDOM_WALK: lambda rng, count, period: _every(
        np.cumsum(_normal(rng, count * _whole(period, count))), period
    ),
}


@kernel(interpretable=True)
def _iterate_logistic(draws: Floats, result: Floats) -> None:
    """Fill in an orbit of the logistic map; the draws change its last digits, because rounding may end it at 0."""
    x = draws[0]
    for k in range(len(result)):
        x = 4.0 * x * (1.0 - x)
        x += (draws[k] - x) * 1e-13
        result[k] = x


@kernel(interpretable=True)
def _iterate_delayed(start: Floats, step: float, skipped: int, inner: int, result: Floats) -> None:
    """Fill in an orbit of Mackey and Glass' equation by the trapezoidal rule, one value each `inner` steps.

    The formula is that of Grassberger and Procaccia, Physica D 9, 1983; `start` has the values of one delay.
    """
    past = start.copy()
    last = len(past) - 1
    keep, gain = (2.0 - 0.1 * step) / (2.0 + 0.1 * step), 0.2 * step / (2.0 + 0.1 * step)
    x, oldest = past[last], 0
    square = past[0] * past[0]
    before = past[0] / (1.0 + square * square * square * square * square)
    row = 0
    for k in range(skipped + (len(result) - 1) * inner + 1):
        if k >= skipped and (k - skipped) % inner == 0:
            result[row] = x
            row += 1
        following = past[(oldest + 1) % (last + 1)]
        square = following * following
        after = following / (1.0 + square * square * square * square * square)
        x = keep * x + gain * (before + after)
        past[oldest] = x
        before = after
        oldest = (oldest + 1) % (last + 1)
