"""Spectrum of exponents and measures of a series, computed again from the raw data, without the solvers' code."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .checks import FEW, WORK, Sample
from .plan import Measures

__all__ = [
    "CONSTANT",
    "DEGENERATE",
    "PART",
    "RANK",
    "SKIPPED",
    "exponents",
    "measures",
    "step_limit",
    "window_sizes",
]

Floats = NDArray[np.float64]

#: Largest number of steps of a recomputed spectrum.
STEPS = 1000
#: Number of steps after which the axes of a spectrum are aligned, at most a tenth of all.
SKIPPED = 20
#: Largest number of states for recurrence, and of values for the sample entropy.
PART = 4000
#: Relative size of singular values that are 0, growth of a direction in a step that is 0, and variation relative
#: to the extent of a series that is 0: smaller ones are due to rounding.
RANK, DEGENERATE, CONSTANT = 1e-9, 1e-8, 1e-9


def step_limit(states: Floats) -> int:
    """Return the largest number of steps of a recomputed spectrum, limited by the differences of coordinates."""
    return min(max(WORK // states.size, FEW), STEPS)


def exponents(sample: Sample, step: int, neighbours: int, count: int) -> tuple[Floats, Floats]:
    """Return `count` exponents of the linear maps of neighbourhoods, in nats per step, and standard errors.

    The reference states are `step` samples apart. Their neighbours, without equal states, are projected on
    their leading principal directions, and the map is the regression of the projections one step later.
    The errors are 0 if all references are used. NaN if a map is degenerate or missing.
    """
    states, last = sample.states, len(sample.states) - step
    chain, missing = np.arange(0, last, step), np.full(count, np.nan)
    most = step_limit(states)
    if count > states.shape[1] or len(chain) < 2 or neighbours > last:
        return missing, missing
    is_whole, chain = len(chain) <= most, chain[:most]
    columns, clouds, frames = states[:last].T, [], []
    for i in chain.tolist():
        squares = np.zeros(last)
        for column in columns:
            squares += (column - column[i]) ** 2
        squares[squares == 0] = np.inf
        squares[max(i - sample.theiler, 0) : i + sample.theiler + 1] = np.inf
        farthest = np.partition(squares, neighbours - 1)[neighbours - 1]
        if not np.isfinite(farthest):
            return missing, missing
        near = np.flatnonzero(squares <= farthest)
        near = near[np.argsort(squares[near], kind="stable")][:neighbours]
        clouds.append(near)
        offsets = states[near] - states[near].mean(axis=0)
        frames.append(np.linalg.svd(offsets, full_matrices=False)[2][:count].T)
    axes, logs = np.eye(count), []
    for near, frame, ahead in zip(clouds[:-1], frames[:-1], frames[1:], strict=True):
        now, later = (
            x - x.mean(axis=0) for x in (states[near] @ frame, states[near + step] @ ahead)
        )
        axes, growth = np.linalg.qr(np.linalg.lstsq(now, later, rcond=RANK)[0].T @ axes)
        if np.abs(np.diag(growth)).min() < DEGENERATE:
            return missing, missing
        logs.append(np.log(np.abs(np.diag(growth))))
    rows = np.array(logs[min(SKIPPED, len(logs) // 10) :])
    means = np.array([part.mean(axis=0) for part in np.array_split(rows, 10)])
    order = np.argsort(-rows.mean(axis=0))
    return rows.mean(axis=0)[order], (means.std(axis=0) / 3.0 * (not is_whole))[order]


def window_sizes(count: int) -> list[int]:
    """Return the window lengths for the memory of `count` samples: up to 12, from 16 or less to a quarter."""
    sizes = np.geomspace(min(16, count // 12), count // 4, 12)
    return sorted(set(sizes.round().astype(int).tolist()))


def measures(states: Floats, series: Floats, theiler: int, given: Measures) -> dict[str, float]:
    """Return the measures of a series by name, NaN for an undefined one.

    Sources: Marwan, Romano, Thiel and Kurths, Physics Reports 438, 2007 (recurrence); Bandt and Pompe,
    Physical Review Letters 88, 2002 (permutation entropy); Anis and Lloyd, Biometrika 63, 1976 (rescaled
    range); Peng and others, Physical Review E 49, 1994 (fluctuation); Richman and Moorman, American Journal
    of Physiology 278, 2000 (sample entropy).
    """
    with np.errstate(all="ignore"):
        return {
            **_recurrence(states[:PART], theiler, given.radius),
            **_memory((series - series.mean()) / np.ptp(series)),
            "permutation_entropy": _permutation_entropy(series, given.order),
            "sample_entropy": _sample_entropy(series[:PART], given.radius),
        }


def _lengths(hits: Any) -> list[int]:
    """Return the lengths of the runs of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], hits, [0]])))
    lengths: list[int] = (edges[1::2] - edges[::2]).tolist()
    return lengths


def _recurrence(states: Floats, theiler: int, radius: float) -> dict[str, float]:
    """Return the measures of the recurrence plot, along its diagonals and its columns."""
    count, diagonals, verticals = len(states), Counter[int](), Counter[int]()
    for lag in range(theiler + 1, count):
        hits = (np.abs(states[lag:] - states[:-lag]) <= radius).all(axis=1)
        diagonals.update(_lengths(hits))
    for i in range(count):
        hits = (np.abs(states - states[i]) <= radius).all(axis=1)
        hits[max(i - theiler, 0) : i + theiler + 1] = False
        verticals.update(_lengths(hits))
    points = np.float64(sum(size * number for size, number in diagonals.items()))
    lines = {size: number for size, number in diagonals.items() if size > 1}
    total = np.float64(sum(lines.values()))
    inside = sum(size * number for size, number in lines.items())
    shares = np.array(list(lines.values())) / total
    columns = sum(size * number for size, number in verticals.items() if size > 1)
    away = max(count - theiler - 1, 0)
    return {
        "recurrence_rate": points / np.float64(away * (away + 1) / 2),
        "determinism": inside / points,
        "laminarity": columns / (2 * points),
        "diagonal_mean": inside / total,
        "diagonal_longest": max(lines, default=np.nan),
        "diagonal_entropy": -float((shares * np.log(shares)).sum()) if lines else np.nan,
    }


def _memory(values: Floats) -> dict[str, float]:
    """Return the exponents of the rescaled range and of the detrended fluctuation."""
    sizes = window_sizes(len(values))
    profile, ranges, spreads = np.cumsum(values - values.mean()), [], []
    for size in sizes:
        starts = range(0, len(values) - size + 1, size)
        ratios = []
        for part in (values[k : k + size] for k in starts):
            sums = np.cumsum(part - part.mean())
            if np.ptp(part) > CONSTANT:
                ratios.append((sums.max() - sums.min()) / part.std())
        i = np.arange(1, size)
        log_gamma = math.lgamma((size - 1) / 2) - math.lgamma(size / 2)
        expected = math.exp(log_gamma) / math.sqrt(math.pi) * np.sqrt((size - i) / i).sum()
        ranges.append(np.log(np.mean(ratios) / expected) if ratios else np.nan)
        parts = np.stack([profile[k : k + size] for k in starts], axis=1)
        slopes, offsets = np.polyfit(np.arange(size), parts, 1)
        spread = (parts - np.arange(size)[:, None] * slopes - offsets).std()
        spreads.append(np.log(spread) if spread > CONSTANT * np.ptp(profile) else np.nan)
    slopes = [
        float(np.polyfit(np.log(sizes), logs, 1)[0]) if np.isfinite(logs).all() else np.nan
        for logs in (ranges, spreads)
    ]
    return {"hurst": slopes[0] + 0.5, "fluctuation": slopes[1]}


def _permutation_entropy(series: Floats, order: int) -> float:
    """Return the entropy of the orders of successive values; of equal values the earlier is smaller."""
    windows = np.lib.stride_tricks.sliding_window_view(series, order)
    patterns = np.argsort(windows, axis=1, kind="stable")
    shares = np.unique(patterns, axis=0, return_counts=True)[1] / len(windows)
    return -float((shares * np.log(shares)).sum()) / math.lgamma(order + 1)


def _sample_entropy(series: Floats, radius: float) -> float:
    """Return the sample entropy with pairs of values as templates."""
    pairs = triples = 0
    for lag in range(1, len(series) - 2):
        near = np.abs(series[lag:] - series[:-lag]) <= radius
        both = near[:-2] & near[1:-1]
        pairs += int(both.sum())
        triples += int((both & near[2:]).sum())
    return math.log(pairs / triples) if triples else math.nan
