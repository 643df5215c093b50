"""Evidence of a judgement computed again from the series, pair by pair and without the solvers' searches."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .checks import Sample
from .judgement import EDITION
from .plan import AttractorEstimate, Evidence

__all__ = ["evidence_gap"]

Floats = NDArray[np.float64]

#: Samples per mean period of the 0-1 test in each edition, smallest and largest number of samples, and frequencies.
PER_PERIOD, FEWEST, MOST, FREQUENCIES = {1: 8, EDITION: 6}, 100, 1500, 48
#: Orders of linear models, samples per coefficient and of predictions.
ORDERS, PER_COEFFICIENT, LEADING = (2, 5, 10, 20, 40), 20, 10_000
#: Nearest states of a prediction, number of predicted states, dimension above which fewer are predicted, their number,
#: and golden ratio.
NEAREST, ASKED, HIGH, ASKED_HIGH, GOLDEN = 5, 2000, 5, 500, (5**0.5 - 1) / 2
#: Nearest states per coefficient of a linear map, its penalty, and largest dimension of maps.
MAP_NEAREST, PENALTY, MAPPED = 2, 1e-6, 20
#: Pairs and times of mean logarithms, and smallest relative distance.
PAIRS, TIMES, NOTHING = 20_000, 50, 1e-9
#: Allowance for rounding of errors and correlations; for means over samples of states: nats and standard errors.
SHARE, NATS, ERRORS = 1e-6, 0.15, 5.0


def evidence_gap(series: Floats, plan: AttractorEstimate, found: Evidence, seed: int) -> float:
    """Return the largest difference of a figure from the recomputed one beyond its allowance, 0 if all agree.

    It is infinite if the step of the 0-1 test is not that of the mean period.
    """
    x = standard(series)
    power = np.abs(np.fft.rfft(x)) ** 2
    step = power.sum() / (power @ np.fft.rfftfreq(len(x))) / PER_PERIOD[found.edition]
    if abs(found.step - min(max(step, 1.0), max(len(x) // FEWEST, 1))) > 0.5 + SHARE:
        return math.inf
    return max(
        0.0,
        abs(found.zero_one - zero_one(x, found.step)) - SHARE,
        abs(found.linear - linear_error(x[:LEADING], found.ahead)) - SHARE,
        abs(found.nonlinear - nearest_error(x[:LEADING], plan, found)) - SHARE,
        *partings_gaps(series, plan, found, seed),
    )


def standard(x: Floats) -> Floats:
    """Return values with mean 0 and deviation 1, or zeros for constant ones."""
    x = (x - x.min()) / (np.ptp(x) or 1.0)
    x = x - x.mean()
    return x / (x.std() or 1.0)


def zero_one(x: Floats, step: int) -> float:
    """Return the median correlation of mean square displacements with time."""
    x = standard(x[::step][:MOST])
    n, cut, result = len(x), len(x) // 10, []
    ahead = np.arange(1, cut + 1)
    for c in np.pi * (0.2 + 0.6 * (np.arange(FREQUENCIES) + 0.5) / FREQUENCIES):
        turned = c * np.arange(1, n + 1)
        p, q = np.cumsum(x * np.cos(turned)), np.cumsum(x * np.sin(turned))
        moved = np.zeros(cut)
        for k in range(1, cut + 1):
            moved[k - 1] = (
                (p[k : n - cut + k] - p[: n - cut]) ** 2 + (q[k : n - cut + k] - q[: n - cut]) ** 2
            ).mean()
        result.append(float(np.corrcoef(ahead, moved)[0, 1]) if np.ptp(moved) > 0 else 0.0)
    return float(np.median(result))


def linear_error(x: Floats, ahead: int) -> float:
    """Return the error of the best least-squares prediction from the last 2 … 40 samples, 1 without any."""
    x, errors = standard(x), []
    for order in ORDERS:
        rows = len(x) - order - ahead + 1
        if rows >= PER_COEFFICIENT * order and x.any():
            columns = [x[k : k + rows] for k in range(order)]
            past = np.stack([np.ones(rows), *columns], axis=1)
            base, sizes, _ = np.linalg.svd(past, full_matrices=False)
            base = base[
                :, sizes > np.finfo(float).eps * rows * sizes[0]
            ]  # columns may be dependent
            rest = x[order - 1 + ahead :]
            for _ in range(2):  # the second projection removes the rounding of the first
                rest = rest - base @ (base.T @ rest)
            errors.append(float(np.sqrt(rest @ rest / (rows - order - 1))))
    return min(errors, default=1.0)


def nearest_error(x: Floats, plan: AttractorEstimate, found: Evidence) -> float:
    """Return the smaller error of predictions by the mean of five nearest states and by a linear map of more of them.

    The first edition has no maps. The error is 1 without any prediction. One state of equal stretches is predicted.
    """
    last, rank = len(x) - plan.window - found.ahead, MAP_NEAREST * (plan.dimension + 1)
    rank *= found.edition == EDITION and plan.dimension <= MAPPED
    if last < NEAREST or not np.ptp(x) > 0:
        return 1.0
    # One row per coordinate: the maximum over a short last axis takes several times as long.
    states = np.ascontiguousarray(embedded(x, plan)[:last].T)
    futures = x[plan.window + found.ahead :]
    theiler = min(plan.theiler, len(x) // 4)
    many = plan.dimension <= HIGH or len(x) <= ASKED
    count = min(last, ASKED if many else ASKED_HIGH)
    # The position within a stretch follows multiples of the golden ratio; all states if they are few.
    k = np.arange(count)
    shift = k * GOLDEN % 1.0 if count < last else 0.0
    means, maps = list[float](), list[float]()
    for i in np.floor((k + shift) * (last / count)).astype(int).tolist():
        apart = np.abs(states - states[:, i : i + 1]).max(axis=0)
        apart[max(i - theiler, 0) : i + theiler + 1] = np.inf
        near = nearest_of(apart, max(NEAREST, rank))
        if len(near) >= NEAREST:
            means.append((futures[i] - futures[near[:NEAREST]].mean()) ** 2)
        near = near[:rank]
        if 0 < rank == len(near):
            maps.append((futures[i] - mapped(states[:, near].T, futures[near], states[:, i])) ** 2)
    best = min((float(np.mean(squares)) for squares in (means, maps) if squares), default=x.var())
    return float(np.sqrt(best / x.var()))


def nearest_of(apart: Floats, count: int) -> NDArray[np.int64]:
    """Return at most `count` states with the smallest finite distances, the earlier of equal ones."""
    place = min(count, len(apart)) - 1
    near = np.flatnonzero(apart <= min(np.partition(apart, place)[place], np.finfo(float).max))
    return near[np.argsort(apart[near], kind="stable")[:count]]


def mapped(states: Floats, futures: Floats, state: Floats) -> float:
    """Return the future of a state by a regression over others, whose penalty are further equations."""
    past = states - states.mean(axis=0)
    size = max(
        float(np.sqrt(PENALTY * (past**2).sum() / len(state))), float(np.finfo(float).tiny) ** 0.5
    )
    rows = np.vstack([past, size * np.eye(len(state))])
    later = np.concatenate([futures - futures.mean(), np.zeros(len(state))])
    slopes = np.linalg.lstsq(rows, later)[0]
    return float(futures.mean() + slopes @ (state - states.mean(axis=0)))


def partings_gaps(x: Floats, plan: AttractorEstimate, found: Evidence, seed: int) -> list[float]:
    """Return the differences of both separations of nearest states beyond their allowances.

    The separations are 0 without neighbours.
    """
    states = embedded(x, plan)
    latest = min(len(x) // 3, len(states) // 2)
    ahead = np.linspace(latest // 2, latest, TIMES).astype(np.int64)
    sample, last = Sample(states, plan.theiler, seed), len(states) - int(ahead[-1])
    least = NOTHING * float(np.ptp(states))
    firsts, seconds = np.random.default_rng(seed).integers(0, len(states), (2, PAIRS))
    levels = logs(states[firsts] - states[seconds], least)
    early, late = [np.zeros(0)], [np.zeros(0)]
    for some, apart in sample.blocks(last, largest=True):
        near = apart.argmin(axis=1)
        good = np.isfinite(apart[np.arange(len(some)), near])
        some, near = some[good], near[good]
        early.append(logs(states[some] - states[near], least))
        moved = [logs(states[some + k] - states[near + k], least) for k in ahead]
        late.append(np.mean(moved, axis=0))
    gaps = []
    for value, parts in ((found.near, early), (found.far, late)):
        rows, expected, allowed = np.concatenate(parts), 0.0, SHARE
        if len(rows):
            expected = float(levels.mean() - rows.mean())
            allowed = NATS + ERRORS * math.hypot(
                float(rows.std()) / math.sqrt(min(len(rows), 500)), float(levels.std()) / 64.0
            )
        gaps.append(abs(value - expected) - allowed)
    return gaps


def embedded(x: Floats, plan: AttractorEstimate) -> Floats:
    """Return the states of a series in the embedding of a plan."""
    count = len(x) - plan.window
    return np.stack([x[k * plan.delay :][:count] for k in range(plan.dimension)], axis=1)


def logs(apart: Floats, least: float) -> Floats:
    """Return the logarithms of the largest differences of a coordinate."""
    result: Floats = np.log(np.maximum(np.abs(apart).max(axis=1), least))
    return result
