"""Helpers: series whose dynamics are known, by plain loops."""

from functools import cache

import numpy as np

from crosstrack.models import AttractorAnalysis
from crosstrack.solvers import Control, Request, find_backend


def logistic(n, start=0.3):
    x = [start]
    for _ in range(n + 99):
        x.append(4 * x[-1] * (1 - x[-1]))
    return np.array(x[100:])


def henon(n, start=0.1):
    x, y, found = start, 0.1, []
    for _ in range(n + 100):
        x, y = 1 - 1.4 * x * x + y, 0.3 * x
        found.append(x)
    return np.array(found[100:])


def flow(field, n, step, start=(1.0, 1.0, 1.0)):
    from scipy.integrate import solve_ivp

    times = 40 + step * np.arange(n)
    options = {"rtol": 1e-8, "atol": 1e-8, "t_eval": times}
    return solve_ivp(field, (0, times[-1]), start, **options).y[0]


@cache
def lorenz(n, step=0.02):
    return flow(
        lambda _, u: (10 * (u[1] - u[0]), u[0] * (28 - u[2]) - u[1], u[0] * u[1] - 8 / 3 * u[2]),
        n, step,
    )  # fmt: skip


@cache
def rossler(n, step=0.1):
    return flow(lambda _, u: (-u[1] - u[2], u[0] + 0.2 * u[1], 0.2 + u[2] * (u[0] - 5.7)), n, step)


def arma(n, back, ahead=(), seed=0):
    """Return noise that follows its `back` last values and the `ahead` last shocks."""
    from scipy.signal import lfilter

    shocks = np.random.default_rng(seed).normal(size=n + 500)
    return lfilter([1, *ahead], [1, *(-b for b in back)], shocks)[500:]


def strange(seed=0):
    """Return series as no textbook has them, by name."""
    g = np.random.default_rng(seed)
    return {
        "a step": np.repeat([0.0, 1.0], 60),
        "steps": np.repeat([0, 1.0, 0, 2], 50),
        "a spike": np.r_[np.zeros(99), 1, np.zeros(100)],
        "two values": (g.random(300) < 0.3).astype(float),
        "a trend": np.arange(200.0),
        "a noisy trend": np.arange(400) + 5 * g.normal(size=400),
        "fifty samples": henon(50),
        "a short period": np.tile([0, 1.0, 3, 2], 60),
        "a long period": np.sin(np.arange(400) * 2 * np.pi / 350),
        "quantised": np.round(henon(500) * 3),
        "a walk": np.cumsum(g.normal(size=500)),
        "growth": np.exp(0.05 * np.arange(300)),
        "one outlier of a million": np.r_[g.normal(size=150), 1e6, g.normal(size=150)],
        "huge": 1e149 * henon(200),
        "tiny": 1e-140 * henon(200),
        "far off": 1e8 + henon(300),
    }


def analysed(name, series, **options):
    """Return the model of a series, and the answer of a backend without a process of its own."""
    model = AttractorAnalysis(series)
    backend = find_backend(name)
    seed = options.pop("seed", None)
    control = options.pop("control", None) or Control()
    request = Request(seed=seed, options=backend.checked_options(options), control=control)
    return model, backend.run(model.blinded(), request)
