"""Verdicts on the chaotic systems and the series without chaos on which the rules of the judgement were chosen last.

``python tests/benchmarks/attractor/development.py [SAMPLES [NOISE]]`` prints the verdict of each series and their numbers.
Linear maps of neighbourhoods, six samples per mean period in the 0-1 test, and the part of a deviation that is left out were
chosen on series as these. None of the systems of :mod:`unseen` is among them. Sources of the equations are those of :mod:`unseen`.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.attractor.driven import FLOWS as DRIVEN_FLOWS, MAPS as DRIVEN_MAPS, driven  # noqa: E402
from benchmarks.attractor.verdicts import disturbed, judged  # noqa: E402

from crosstrack.solvers.attractor.surrogates import surrogates_of  # noqa: E402

Floats = np.ndarray
Rates = Callable[[float, float, float], tuple[float, float, float]]
sin = math.sin

#: Time derivatives, first state, seconds between samples, and observed coordinate. Driven systems have their phase as third one.
FLOWS: Mapping[str, tuple[Rates, tuple[float, float, float], float, int]] = {
    "halvorsen": (
        lambda x, y, z: (
            -1.4 * x - 4 * y - 4 * z - y * y, -1.4 * y - 4 * z - 4 * x - z * z, -1.4 * z - 4 * x - 4 * y - x * x
        ), (-5, 0, 0), 0.06, 0,
    ),
    "thomas": (lambda x, y, z: (sin(y) - 0.18 * x, sin(z) - 0.18 * y, sin(x) - 0.18 * z), (0.1, 0, 0), 0.5, 0),
    "rucklidge": (lambda x, y, z: (-2 * x + 6.7 * y - y * z, x, -z + y * y), (1, 0, 4.5), 0.08, 0),
    "sprott a": (lambda x, y, z: (y, -x + y * z, 1 - y * y), (0, 5, 0), 0.4, 0),
    "sprott b": (lambda x, y, z: (y * z, x - y, 1 - x * y), (0.05, 0.05, 0.05), 0.25, 0),
    "sprott c": (lambda x, y, z: (y * z, x - y, 1 - x * x), (0.05, 0.05, 0.05), 0.25, 0),
    "sprott e": (lambda x, y, z: (y * z, x * x - y, 1 - 4 * x), (0.05, 0.05, 0.05), 0.25, 0),
    "sprott f": (lambda x, y, z: (y + z, -x + 0.5 * y, x * x - z), (0.05, 0.05, 0.05), 0.25, 0),
    "sprott g": (lambda x, y, z: (0.4 * x + z, x * z - y, -x + y), (0.05, 0.05, 0.05), 0.25, 0),
    "sprott h": (lambda x, y, z: (-y + z * z, x + 0.5 * y, x - z), (0.05, 0.05, 0.05), 0.25, 0),
    "sprott i": (lambda x, y, z: (-0.2 * y, x + z, x + y * y - z), (0.05, 0.05, 0.05), 0.4, 0),
    "sprott j": (lambda x, y, z: (2 * z, -2 * y + z, -x + y + y * y), (0.05, 0.05, 0.05), 0.4, 0),
    "sprott k": (lambda x, y, z: (x * y - z, x - y, x + 0.3 * z), (0.05, 0.05, 0.05), 0.4, 0),
    "sprott m": (lambda x, y, z: (-z, -x * x - y, 1.7 + 1.7 * x + y), (0.05, 0.05, 0.05), 0.3, 0),
    "sprott n": (lambda x, y, z: (-2 * y, x + z * z, 1 + y - 2 * z), (0.05, 0.05, 0.05), 0.4, 0),
    "sprott o": (lambda x, y, z: (y, x - z, x + x * z + 2.7 * y), (0.05, 0.05, 0.05), 0.4, 0),
    "sprott p": (lambda x, y, z: (2.7 * y + z, -x + y * y, x + y), (0.05, 0.05, 0.05), 0.3, 0),
    "sprott q": (lambda x, y, z: (-z, x - y, 3.1 * x + y * y + 0.5 * z), (0.05, 0.05, 0.05), 0.3, 0),
    "sprott r": (lambda x, y, z: (0.9 - y, 0.4 + z, x * y - z), (0.05, 0.05, 0.05), 0.4, 0),
    "sprott s": (lambda x, y, z: (-x - 4 * y, x + z * z, 1 + x), (0.05, 0.05, 0.05), 0.3, 0),
    "duffing": (lambda x, y, z: (y, x - x**3 - 0.15 * y + 0.3 * sin(z), 1), (0.2, 0, 0), 0.3, 0),
    "pendulum": (lambda x, y, z: (y, -0.5 * y - sin(x) + 1.15 * sin(z), 2 / 3), (0.5, 0, 0), 0.3, 1),
    "hindmarsh and rose": (
        lambda x, y, z: (y - x**3 + 3 * x * x - z + 3.25, 1 - 5 * x * x - y, 0.006 * (4 * (x + 1.6) - z)),
        (-1, 0, 2), 1.0, 0,
    ),
    "lorenz, y": (lambda x, y, z: (10 * (y - x), x * (45.92 - z) - y, x * y - 4 * z), (1, 1, 20), 0.03, 1),
    "lorenz, z": (lambda x, y, z: (10 * (y - x), x * (45.92 - z) - y, x * y - 4 * z), (1, 1, 20), 0.04, 2),
    "rossler, y": (lambda x, y, z: (-y - z, x + 0.15 * y, 0.2 + z * (x - 10)), (1, 1, 0), 0.4, 1),
    "rossler, z": (lambda x, y, z: (-y - z, x + 0.15 * y, 0.2 + z * (x - 10)), (1, 1, 0), 0.25, 2),
    "chen, z": (lambda x, y, z: (35 * (y - x), -7 * x - x * z + 28 * y, x * y - 3 * z), (-3, 2, 20), 0.015, 2),
    "chua, z": (
        lambda x, y, z: (
            9 * (y - x + 5 / 7 * x + 1.5 / 7 * (abs(x + 1) - abs(x - 1))), x - y + z, -100 / 7 * y
        ), (0.1, 0, 0), 0.15, 2,
    ),
    "nose and hoover, y": (lambda x, y, z: (y, -x + y * z, 1 - y * y), (0, 5, 0), 0.3, 1),
    "nose and hoover, z": (lambda x, y, z: (y, -x + y * z, 1 - y * y), (0, 5, 0), 0.3, 2),
    "moore and spiegel": (
        lambda x, y, z: (y, z, -z - (100 * x * x - 73) * y - 27 * x), (0.1, 0, 0), 0.1, 0
    ),
    "arneodo": (lambda x, y, z: (y, z, 5.5 * x - 3.5 * y - z - x**3), (0.2, 0.2, -0.75), 0.3, 0),
    "burke and shaw": (lambda x, y, z: (-10 * (x + y), -y - 10 * x * z, 10 * x * y + 4.272), (0.6, 0, 0), 0.05, 0),
    "ueda": (lambda x, y, z: (y, -(x**3) - 0.05 * y + 7.5 * sin(z), 1), (2.5, 0, 0), 0.25, 0),
    "simplest jerk": (lambda x, y, z: (y, z, -2.02 * z + y * y - x), (0.02, 0, 0), 0.5, 0),
    "dadras": (lambda x, y, z: (y - 3 * x + 2.7 * y * z, 1.7 * y - x * z + z, 2 * x * y - 9 * z), (1, 1, 0), 0.05, 0),
    "aizawa": (
        lambda x, y, z: (
            (z - 0.7) * x - 3.5 * y, 3.5 * x + (z - 0.7) * y,
            0.6 + 0.95 * z - z**3 / 3 - (x * x + y * y) * (1 + 0.25 * z) + 0.1 * z * x**3,
        ), (0.1, 0, 0), 0.15, 0,
    ),
    "li": (
        lambda x, y, z: (
            40 * (y - x) + 0.16 * x * z, 55 * x + 20 * y - x * z, 1.833 * z + x * y - 0.65 * x * x
        ), (0.1, 1, 2), 0.01, 0,
    ),
}  # fmt: skip


def ikeda(x: float, y: float) -> tuple[float, float]:
    """Return the next state of Ikeda's map."""
    z = 1 + 0.9 * complex(x, y) * np.exp(1j * (0.4 - 6 / (1 + x * x + y * y)))
    return z.real, z.imag


def gumowski(x: float, y: float) -> tuple[float, float]:
    """Return the next state of the map of Gumowski and Mira."""
    later = y + 0.008 * y * (1 - 0.05 * y * y) - 0.7 * x + 3.4 * x * x / (1 + x * x)
    return later, -x - 0.7 * later + 3.4 * later * later / (1 + later * later)


def standard(x: float, y: float) -> tuple[float, float]:
    """Return the next state of the standard map."""
    y = (y + 2.5 * sin(x)) % (2 * math.pi)
    return (x + y) % (2 * math.pi), y


#: Next state, first state, and observed coordinate.
MAPS: Mapping[str, tuple[Callable[[float, float], tuple[float, float]], tuple[float, float], int]] = {
    "lozi": (lambda x, y: (1 + y - 1.7 * abs(x), 0.5 * x), (0.1, 0.1), 0),
    "tent": (lambda x, y: (1.9 * min(x, 1 - x), y), (0.3137, 0), 0),
    "logistic": (lambda x, y: (3.8 * x * (1 - x), y), (0.31, 0), 0),
    "coupled logistic": (
        lambda x, y: (
            3.783 * x * (1 - x) + 0.117 * y * (1 - y), 3.783 * y * (1 - y) + 0.117 * x * (1 - x)
        ), (0.31, 0.42), 0,
    ),
    "ikeda, y": (ikeda, (0.1, 0.1), 1),
    "sine": (lambda x, y: (0.95 * sin(math.pi * x), y), (0.3, 0), 0),
    "cubic": (lambda x, y: (2.8 * x * (1 - x * x), y), (0.3, 0), 0),
    "standard, y": (standard, (0.6, 0.7), 1),
    "tinkerbell, y": (
        lambda x, y: (x * x - y * y + 0.9 * x - 0.6 * y, 2 * x * y + 2 * x + 0.5 * y), (-0.7, -0.6), 1
    ),
    "holmes": (lambda x, y: (y, -0.2 * x + 2.75 * y - y**3), (1.6, 0), 0),
    "holmes, 2": (lambda x, y: (y, -0.2 * x + 2.75 * y - y**3), (0.5, 0.1), 0),
    "power": (lambda x, y: (1 - 1.7 * abs(x) ** 1.5, y), (0.2, 0), 0),
    "gumowski and mira": (gumowski, (0.1, 0.1), 0),
    "svensson": (
        lambda x, y: (0.9 * sin(1.5 * x) - sin(-1.8 * y), 1.6 * math.cos(1.5 * x) + 0.9 * math.cos(-1.8 * y)),
        (0.1, 0.3), 0,
    ),
}  # fmt: skip


def chaotic(name: str, count: int) -> Floats:
    """Return the observed coordinate of a chaotic system after 500 samples."""
    found = np.empty(count + 500)
    if name in MAPS:
        following, pair, column = MAPS[name]
        for k in range(len(found)):
            pair = following(*pair)
            found[k] = pair[column]
        return found[500:]
    rates, start, period, column = FLOWS[name]
    inner = max(math.ceil(period / 0.005), 1)
    state, step = np.array(start, dtype=float), period / inner
    for k in range(len(found)):
        for _ in range(inner):
            first = np.array(rates(*state))
            second = np.array(rates(*(state + step / 2 * first)))
            third = np.array(rates(*(state + step / 2 * second)))
            fourth = np.array(rates(*(state + step * third)))
            state = state + step / 6 * (first + 2 * second + 2 * third + fourth)
        found[k] = state[column]
    return found[500:]


def regular(count: int, seed: int) -> Iterator[tuple[str, Floats]]:
    """Yield the names and values of series without chaos: noise, tori, modulated and driven oscillations."""
    rng, t = np.random.default_rng(seed), np.arange(count)

    def noise(poles: tuple[float, ...], zeros: tuple[float, ...] = (1.0,)) -> Floats:
        return lfilter(zeros, [1, *(-pole for pole in poles)], rng.normal(size=count + 500))[500:]

    p = 2 * math.pi * rng.random(3)
    yield "order 1", noise((0.95,))
    yield "order 2, sharp", noise((1.9, -0.98))
    yield "order 2", noise((1.2, -0.7))
    yield "order 3, moving average", noise((0.5, -0.3, 0.2), (1, 0.8, 0.4))
    yield "two resonances", noise(tuple(-np.convolve([1, -1.8, 0.97], [1, -0.6, 0.96])[1:]))
    yield "exponential of order 2", np.exp(noise((1.6, -0.9)) / 4)
    yield "cube of order 1", noise((0.8,)) ** 3
    yield "random walk", np.cumsum(rng.normal(size=count))
    yield "sum of order 2", np.cumsum(noise((1.7, -0.9)))
    yield "reflected walk", np.abs((np.cumsum(0.3 * rng.normal(size=count)) + 1) % 4 - 2)
    yield "torus", np.sin(0.31 * t + p[0]) + 0.7 * np.sin(0.50158 * t + p[1])
    yield (
        "torus of 3",
        np.sin(0.31 * t + p[0])
        + 0.7 * np.sin(0.50158 * t + p[1])
        + 0.5 * np.sin(0.7484 * t + p[2]),
    )
    yield "product", np.sin(0.5 * t + p[0]) * np.sin(0.809 * t + p[1]) ** 3
    yield "amplitude", (1 + 0.5 * np.sin(0.021 * t + p[0])) * np.sin(0.37 * t + p[1])
    yield "frequency", np.sin(0.3 * t + 3 * np.sin(0.0173 * t + p[0]))
    yield (
        "noisy product",
        np.sin(0.31 * t + p[0]) * np.sin(0.50158 * t + p[1]) + 0.05 * rng.normal(size=count),
    )
    yield "amplitude of noise", noise((0.99,)) * np.sin(0.4 * t)
    yield "phase of noise", np.sin(0.3 * t + np.cumsum(0.1 * rng.normal(size=count)))
    for name in ("lorenz, y", "rossler, y", "lozi", "ikeda, y"):
        yield f"phases of {name}", surrogates_of(chaotic(name, count), 1, rng)[0]
    for name in (*DRIVEN_FLOWS, *DRIVEN_MAPS):
        yield f"driven {name}", driven(name, count, seed)


def main() -> None:
    """Judge all series, and print their verdicts."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    noise = float(sys.argv[2]) if len(sys.argv) > 2 else 0.0
    verdicts = Counter[tuple[str, str]]()
    for name in (*FLOWS, *MAPS):
        period = FLOWS[name][2] if name in FLOWS else 1.0
        word = judged(disturbed(chaotic(name, count), noise, name), period)["judgement"]
        verdicts["chaotic systems", word] += 1
        print(name, word, sep=" | ", flush=True)
    for name, series in regular(count, 21):
        word = judged(series, 1.0)["judgement"]
        verdicts["without chaos", word] += 1
        print(name, word, sep=" | ", flush=True)
    print(dict(verdicts))


if __name__ == "__main__":
    main()
