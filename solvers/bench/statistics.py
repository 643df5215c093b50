"""What runs amount to: means that bear failures, integrals over time, and tests of ranks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.fields import Array, Real, Whole, show

__all__ = [
    "RankTest",
    "compare_pairs",
    "compare_seeds",
    "correct_tests",
    "primal_gap",
    "primal_integral",
    "shifted_geometric_mean",
    "success_interval",
]

_Key = TypeVar("_Key")
#: Numbers, one a run or an instance.
_Column = Sequence[float] | NDArray[np.float64]

#: Values of each side at least before a difference is tested, and pairs that differ: fewer say next to
#: nothing, and with five pairs no p-value is below :data:`LEVEL`.
FEWEST, FEWEST_PAIRS = 5, 6
#: Numbers from which differences are taken of shares of the largest.
LARGE = 1e300
#: What p must be below for a difference to be called one.
LEVEL = 0.05
#: Pairs up to which all signs are counted, and sizes of two samples, multiplied, up to which all ranks are.
EXACT, EXACT_PRODUCT = 12, 2500


def shifted_geometric_mean(values: Sequence[float], shift: float = 1.0) -> float:
    r"""Return the shifted geometric mean of times.

    :math:`\bigl(\prod_i (t_i + s)\bigr)^{1/n} - s`: neither the longest runs nor those below the
    resolution of a clock decide it. A run that failed counts as its limit of time.

    Parameters
    ----------
    values : sequence of float
        Times, >= 0 (s).
    shift : float
        :math:`s \ge 0` (s); the mean is geometric at 0 and tends to the arithmetic one as it grows.

    Returns
    -------
    float
        The mean (s).

    Raises
    ------
    InvalidData
        There is no value, or one is negative or not finite.

    References
    ----------
    T. Achterberg: Constraint integer programming, TU Berlin, 2007, appendix A.3.
    """
    times, shift = _numbers("values", values), _least("shift", shift)
    if (times < 0).any():
        raise InvalidData(f"values must be >= 0, got {times.min():g}", field="values")
    if shift == 0 and not times.all():
        return 0.0
    most = float(times.max())
    if shift and shift >= most:
        # In terms of the shift: no digit of the times is lost beside it.
        return float(shift * np.expm1(np.log1p(times / shift).mean()))
    # In terms of the largest, so that no product leaves the range of floats.
    large = most + shift
    mean = float((np.log(times + shift) - math.log(large)).mean())
    return max(large * math.expm1(mean) + (large - shift), 0.0)


def success_interval(successes: int, runs: int) -> tuple[float, float]:
    """Return the interval of a rate of success with a confidence of 95 %.

    Wilson's, which stays within [0, 1] and says something where all or none succeeded.

    References
    ----------
    E. B. Wilson: Probable inference, the law of succession, and statistical inference, Journal of the
    American Statistical Association 22, 1927.
    """
    from scipy.stats import binomtest

    successes, runs = (
        Whole().coerce(*one, {}) for one in (("successes", successes), ("runs", runs))
    )
    if not 0 <= successes <= runs or runs < 1:
        raise InvalidData(
            f"successes must be 0 to runs, and runs >= 1, got {successes} of {runs}", field="runs"
        )
    found = binomtest(successes, runs).proportion_ci(method="wilson")
    return float(found.low), float(found.high)


def primal_gap(objective: float | None, best: float, scale: float = 0.0) -> float:
    r"""Return how far an objective is from the best one known, in [0, 1].

    :math:`|f - f^*| / \max(|f|, |f^*|, s)`, at most 1; 0 where both are 0, 1 without a plan and, for
    :math:`s = 0`, where the two have different signs. A scale :math:`s` is what a value near zero is
    measured against; the source has none.

    Raises
    ------
    InvalidData
        The best one is not finite, or the scale is not >= 0 and finite.

    References
    ----------
    T. Berthold: Measuring the impact of primal heuristics, Operations Research Letters 41, 2013, (1).
    """
    best, scale = Real().coerce("best", best, {}), _least("scale", scale)
    if objective is None or not math.isfinite(objective):
        return 1.0
    if objective == best:
        return 0.0
    return min(1.0, abs(objective - best) / max(abs(objective), abs(best), scale))


def primal_integral(
    incumbents: Sequence[tuple[float, float]], best: float, limit: float, scale: float = 0.0
) -> float:
    """Return the integral of the primal gap over time.

    Less is better: it is the time to the best plan known if there is nothing before it, and `limit` where
    there is no plan at all.

    Parameters
    ----------
    incumbents : sequence of (float, float)
        Seconds and objective of every better plan, in their order.
    best : float
        The best objective known.
    limit : float
        Until when the run is looked at (s), > 0.
    scale : float
        As in :func:`primal_gap`.

    Returns
    -------
    float
        Between 0 and `limit` (s).

    References
    ----------
    T. Berthold: Measuring the impact of primal heuristics, Operations Research Letters 41, 2013, (3).
    """
    limit = Real(0.0, strict=True).coerce("limit", limit, {})
    total, since, gap, least = 0.0, 0.0, 1.0, math.inf
    course = Array(("plans", 2), infinity=1).coerce(
        "incumbents", [*incumbents] or np.empty((0, 2)), {}
    )
    for seconds, objective in sorted(map(tuple, course.tolist())):
        if seconds >= limit:
            break
        if objective < least:
            total += gap * max(seconds - since, 0.0)
            since, gap, least = max(seconds, since), primal_gap(objective, best, scale), objective
    return total + gap * (limit - since)


@dataclass(frozen=True)
class RankTest:
    """A test of whether one of two samples tends to be less than the other.

    Parameters
    ----------
    method : str
        Which test.
    p_value : float, optional
        Probability of ranks at least as different if there were no difference; corrected for the number of
        pairs where there are several. None where there is too little to test.
    effect : float
        Probability that a run of the first is less than one of the second, less the opposite, in
        [-1, 1]: Cliff's delta, and the rank-biserial correlation for pairs.
    runs : int
        Values of each side, the fewer ones; where they are too few, the pairs that differ.
    """

    method: str
    p_value: float | None
    effect: float
    runs: int

    def __str__(self) -> str:
        if self.p_value is None:
            return f"no difference shown: too few values, {self.runs}"
        if self.p_value >= LEVEL:
            return f"no difference shown: p = {self.p_value:.2g}, {self.method}"
        word = "less" if self.effect > 0 else "greater"
        return f"{word}: p = {self.p_value:.2g}, effect {abs(self.effect):.2f}, {self.method}"


def compare_seeds(first: _Column, second: _Column) -> RankTest:
    """Return whether two backends that draw differ on one instance: a value a seed.

    Parameters
    ----------
    first, second : sequence of float
        What less of is better, such as objectives; inf where a run failed.

    References
    ----------
    H. B. Mann, D. R. Whitney, Annals of Mathematical Statistics 18, 1947; exact without ties up to
    :data:`EXACT_PRODUCT`, otherwise with the normal approximation corrected for ties.
    """
    from scipy.stats import mannwhitneyu

    one, two = _ranked("first", first), _ranked("second", second)
    less, more = np.less.outer(one, two).mean(), np.greater.outer(one, two).mean()
    runs, effect = min(one.size, two.size), float(less - more)
    if runs < FEWEST:
        return RankTest("Mann-Whitney", None, effect, runs)
    if np.unique(np.concatenate([one, two])).size == 1:
        return RankTest("Mann-Whitney", 1.0, 0.0, runs)
    apart = np.unique(np.concatenate([one, two])).size == one.size + two.size
    method = "exact" if apart and one.size * two.size <= EXACT_PRODUCT else "asymptotic"
    p_value = float(mannwhitneyu(one, two, method=method).pvalue)
    return RankTest("Mann-Whitney", p_value, effect, runs)


def compare_pairs(first: _Column, second: _Column) -> RankTest:
    """Return whether two backends differ over instances: a pair of values an instance.

    Parameters
    ----------
    first, second : sequence of float
        As many of both, on the same scale for all instances, such as primal gaps or logarithms of
        seconds; finite.

    References
    ----------
    F. Wilcoxon, Biometrics Bulletin 1, 1945: equal pairs are left out. Exact, ties included, up to
    :data:`EXACT` pairs that differ; with the normal approximation beyond.
    """
    from scipy.stats import PermutationMethod, wilcoxon

    one, two = _numbers("first", first), _numbers("second", second)
    if one.size != two.size:
        raise InvalidData(
            f"second must have {one.size} values, as many as first, got {two.size}", field="second"
        )
    most = max(float(np.abs(one).max()), float(np.abs(two).max()), 1.0)
    apart = one / most - two / most if most > LARGE else one - two  # which must not overflow
    moved = apart[apart != 0]
    if moved.size < FEWEST_PAIRS:
        p_value = 1.0 if one.size >= FEWEST_PAIRS and not moved.size else None
        runs = one.size if p_value else moved.size
        return RankTest("Wilcoxon", p_value, _biserial(apart), int(runs))
    every = PermutationMethod(n_resamples=2 ** (EXACT + 1), rng=np.random.default_rng(0))
    found = wilcoxon(moved, method=every if moved.size <= EXACT else "approx")
    return RankTest("Wilcoxon", float(found.pvalue), _biserial(apart), int(one.size))


def correct_tests(tests: Mapping[_Key, RankTest]) -> dict[_Key, RankTest]:
    """Return tests with p-values corrected for their number.

    By Holm's method: the chance of a single false difference among all of them stays below what is asked.

    References
    ----------
    S. Holm: A simple sequentially rejective multiple test procedure, Scandinavian Journal of Statistics 6,
    1979.
    """
    found = dict(tests)
    tested = sorted(
        (name for name, test in tests.items() if test.p_value is not None),
        key=lambda name: tests[name].p_value or 0.0,
    )
    least = 0.0
    for k, name in enumerate(tested):
        test = tests[name]
        least = max(least, min(1.0, (len(tested) - k) * (test.p_value or 0.0)))
        found[name] = RankTest(f"{test.method}, Holm", least, test.effect, test.runs)
    return found


def _biserial(apart: np.ndarray[Any, Any]) -> float:
    """Return the rank-biserial correlation: positive where the first of each pair is less."""
    from scipy.stats import rankdata

    moved = apart[apart != 0]
    if not moved.size:
        return 0.0
    ranks = rankdata(np.abs(moved))
    return float((ranks[moved < 0].sum() - ranks[moved > 0].sum()) / ranks.sum())


def _ranked(name: str, values: _Column) -> np.ndarray[Any, Any]:
    """Return numbers that may be infinite, for ranks bear that."""
    try:
        found = np.asarray(values, float)
    except (TypeError, ValueError):
        found = np.empty(0)
    if found.ndim != 1 or not found.size or np.isnan(found).any():
        raise InvalidData(f"{name} must be a list of numbers, got {show(values)}", field=name)
    return found


def _least(name: str, value: float) -> float:
    """Return a finite number that is not negative."""
    return float(Real(0.0).coerce(name, value, {}))


def _numbers(name: str, values: _Column) -> np.ndarray[Any, Any]:
    found = _ranked(name, values)
    if not np.isfinite(found).all():
        raise InvalidData(f"{name} must be finite, got {show(values)}", field=name)
    return found
