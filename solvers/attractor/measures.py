"""``measures``: recurrence quantification, entropies and exponents of memory. Sources: see the page."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.attractor.model import AttractorAnalysis
from ...models.attractor.plan import Measures
from ...models.attractor.recomputed import CONSTANT, PART, window_sizes
from ..contract.backend import Request
from ..contract.option import Option
from .embedding import standardised
from .native import EMBEDDING, AttractorBackend, Finding, embed, poll_of

__all__ = [
    "SeriesMeasures",
    "line_lengths",
    "memory",
    "permutation_entropy",
    "recurrence",
    "sample_entropy",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def line_lengths(keys: Ints) -> Ints:
    """Return the lengths of the runs of successive integers in `keys`."""
    ends = np.flatnonzero(np.diff(np.sort(keys)) != 1)
    return np.diff(np.concatenate([[-1], ends, [len(keys) - 1]]))


def recurrence(states: Floats, theiler: int, radius: float) -> dict[str, Any]:
    """Return the measures of the recurrence plot; empty without recurrent pairs."""
    from scipy.spatial import KDTree

    count = len(states)
    pairs = KDTree(states).query_pairs(radius, np.inf, output_type="ndarray").astype(np.int64)
    first, second = pairs[pairs[:, 1] - pairs[:, 0] > theiler].T
    away = count - theiler - 1
    if not first.size:
        return {"recurrence_rate": 0.0} if away > 0 else {}
    diagonals = line_lengths((second - first) * count + first)
    columns = line_lengths(
        np.concatenate([first * (count + 1) + second, second * (count + 1) + first])
    )
    result: dict[str, Any] = {
        "recurrence_rate": first.size / (away * (away + 1) / 2),
        "determinism": diagonals[diagonals > 1].sum() / first.size,
        "laminarity": columns[columns > 1].sum() / (2 * first.size),
    }
    if (lines := diagonals[diagonals > 1]).size:
        shares = np.unique(lines, return_counts=True)[1] / lines.size
        result |= {"diagonal_mean": lines.mean(), "diagonal_longest": float(lines.max())}
        result["diagonal_entropy"] = abs(float(shares @ np.log(shares)))
    return result


def memory(series: Floats) -> dict[str, float]:
    """Return the exponents of the rescaled range and of the detrended fluctuation of standardised values."""
    from scipy.special import beta

    sizes, profile, ranges, spreads = window_sizes(len(series)), np.cumsum(series), [], []
    for size in sizes:
        count = len(series) // size
        parts = series[: count * size].reshape(count, size)
        parts = parts[np.ptp(parts, axis=1) > CONSTANT * np.ptp(series)]
        sums = np.cumsum(parts - parts.mean(axis=1, keepdims=True), axis=1)
        ratios = np.ptp(sums, axis=1) / parts.std(axis=1)
        expected = (
            np.sqrt(size / np.arange(1.0, size) - 1.0).sum() * beta((size - 1) / 2, 0.5) / np.pi
        )
        ranges.append(ratios.mean() / expected if ratios.size else np.nan)
        rows = profile[: count * size].reshape(count, size)
        rows = rows - rows.mean(axis=1, keepdims=True)
        t = np.arange(size) - (size - 1) / 2
        spread = math.sqrt(((rows - np.outer(rows @ t / (t @ t), t)) ** 2).mean())
        spreads.append(spread if spread > CONSTANT * np.ptp(profile) else np.nan)
    x = np.log(sizes) - np.log(sizes).mean()
    slopes = (np.log(y) @ x / (x @ x) for y in (ranges, spreads))
    return dict(zip(("hurst", "fluctuation"), np.add([*slopes], [0.5, 0.0]), strict=True))


def permutation_entropy(series: Floats, order: int) -> float:
    """Return the normalised entropy of ordinal patterns, which are numbered by comparisons of two values."""
    count = len(series) - order + 1
    code = np.zeros(count, dtype=np.int64)
    for k in range(order):
        before = [series[j : j + count] > series[k : k + count] for j in range(k)]
        code = code * (k + 1) + np.sum(before, axis=0, dtype=np.int64)
    shares = np.unique(code, return_counts=True)[1] / count
    return abs(float(shares @ np.log(shares))) / math.log(math.factorial(order))


def sample_entropy(series: Floats, radius: float) -> float:
    """Return the sample entropy of pairs of successive values; NaN without equal triples."""
    from scipy.spatial import KDTree

    states = np.stack([series[:-2], series[1:-1], series[2:]], axis=1)
    trees = (KDTree(states[:, :2]), KDTree(states))
    pairs, triples = (tree.count_neighbors(tree, radius, np.inf) - len(states) for tree in trees)
    return math.log(pairs / triples) if triples else math.nan


class SeriesMeasures(AttractorBackend):
    """Backend for the measures of a series."""

    name = "measures"
    summary = (
        "recurrence quantification, permutation and sample entropy, Hurst exponent, fluctuation"
    )
    options: ClassVar[dict[str, Option]] = {
        **EMBEDDING,
        "radius": Option(
            0.2, "distance of recurrent states, in deviations of the series", lower=1e-9
        ),
        "order": Option(4, "number of values of an ordinal pattern", int, lower=2, upper=8),
    }

    def find(self, problem: AttractorAnalysis, request: Request) -> Finding:
        """Compute the measures; undefined ones are None and named in the message."""
        options, series, poll = request.options, problem.series, poll_of(request)
        embedding, radius = embed(problem, options), options["radius"] * problem.deviation
        poll()
        states = problem.states(embedding.delay, embedding.dimension)[:PART]
        values = recurrence(states, embedding.theiler, radius)
        poll()
        values |= memory(standardised(series))
        values["permutation_entropy"] = permutation_entropy(series, options["order"])
        values["sample_entropy"] = sample_entropy(series[:PART], radius)
        defined = {name: float(x) for name, x in values.items() if math.isfinite(x)}
        result = Measures(radius, options["order"], **defined)
        missing = [x.replace("_", " ") for x, y in result.data().items() if y is None]
        message = f"undefined for this series and radius: {', '.join(missing)}" if missing else ""
        return Finding(
            embedding.plan(measures=result), {"samples of recurrence": len(states)}, message
        )
