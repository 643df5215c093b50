"""Statistics of runs: means that tolerate failures, integrals over time, and rank tests."""

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
#: Numbers, one per run or instance.
_Column = Sequence[float] | NDArray[np.float64]

#: Smallest number of values of each side for a test, and smallest number of differing pairs. Smaller
#: samples have little power; with five pairs no p-value is below :data:`LEVEL`.
FEWEST, FEWEST_PAIRS = 5, 6
#: Magnitude above which differences are computed of values divided by the largest, to avoid overflow.
LARGE = 1e300
#: Significance level.
LEVEL = 0.05
#: Largest number of pairs for the exact signed-rank test, and largest product of two sample sizes for
#: the exact rank test.
EXACT, EXACT_PRODUCT = 12, 2500


def shifted_geometric_mean(values: Sequence[float], shift: float = 1.0) -> float:
    r"""Return the shifted geometric mean of times.

    :math:`\bigl(\prod_i (t_i + s)\bigr)^{1/n} - s`. Neither the longest runs nor those below the
    resolution of a clock dominate it. Enter a failed run with its time limit.

    Parameters
    ----------
    values : sequence of float
        Times, >= 0 (s).
    shift : float
        :math:`s \ge 0` (s). The mean is geometric for 0 and tends to the arithmetic mean as it grows.

    Returns
    -------
    float
        The mean (s).

    Raises
    ------
    InvalidData
        There is no value, or a value is negative or not finite.

    References
    ----------
    T. Achterberg: Constraint integer programming, TU Berlin, 2007, appendix A.3.
    """
    times, shift = _numbers("values", values), _least("shift", shift)
    if (times < 0).any():
        raise InvalidData(f"values must be >= 0, got {times.min():g}", field="values")
    if shift == 0 and not times.all():
        return 0.0
    longest = float(times.max())
    if shift and shift >= longest:
        # In units of the shift, so that no digit of the times is lost.
        return float(shift * np.expm1(np.log1p(times / shift).mean()))
    # In units of the largest, so that no product overflows.
    largest = longest + shift
    mean = float((np.log(times + shift) - math.log(largest)).mean())
    return max(largest * math.expm1(mean) + (largest - shift), 0.0)


def success_interval(successes: int, runs: int) -> tuple[float, float]:
    """Return the 95 % confidence interval of a success rate.

    Wilson's interval stays within [0, 1] and is informative even if all or no runs succeeded.

    Parameters
    ----------
    successes, runs : int
        Number of successes and of runs, 0 <= `successes` <= `runs`, `runs` >= 1.

    Returns
    -------
    low, high : float
        Ends of the interval.

    Raises
    ------
    InvalidData
        The numbers are not integers in this range.

    References
    ----------
    E. B. Wilson: Probable inference, the law of succession, and statistical inference, Journal of the
    American Statistical Association 22, 1927.
    """
    from scipy.stats import binomtest

    successes, runs = (
        Whole().coerce(*pair, {}) for pair in (("successes", successes), ("runs", runs))
    )
    if not 0 <= successes <= runs or runs < 1:
        raise InvalidData(
            f"successes must be 0 to runs, and runs >= 1, got {successes} of {runs}", field="runs"
        )
    interval = binomtest(successes, runs).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


def primal_gap(objective: float | None, best: float, scale: float = 0.0) -> float:
    r"""Return the relative distance of an objective from the best known one, in [0, 1].

    :math:`|f - f^*| / \max(|f|, |f^*|, s)`, at most 1. It is 0 if both are 0. It is 1 without a
    plan, and if the signs differ and :math:`s = 0`. The scale :math:`s`, which the reference does
    not have, is the magnitude to which values near zero are compared.

    Parameters
    ----------
    objective : float, optional
        Objective of a plan; None or not finite without one.
    best : float
        Best known objective.
    scale : float
        Scale :math:`s \ge 0` of the objective.

    Raises
    ------
    InvalidData
        `best` is not finite, or `scale` is negative or not finite.

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

    Lower is better. It equals the time until the best known plan if this is the first plan, and
    `limit` if there is no plan.

    Parameters
    ----------
    incumbents : sequence of (float, float)
        Seconds and objective of every improvement, in any order.
    best : float
        Best known objective.
    limit : float
        End of the integration (s), > 0.
    scale : float
        Scale of the objective, at least 0: gaps of smaller objectives are relative to it.

    Returns
    -------
    float
        Value between 0 and `limit` (s).

    References
    ----------
    T. Berthold: Measuring the impact of primal heuristics, Operations Research Letters 41, 2013, (3).
    """
    limit = Real(0.0, strict=True).coerce("limit", limit, {})
    total, start, gap, lowest = 0.0, 0.0, 1.0, math.inf
    course = Array(("plans", 2), infinity=1).coerce(
        "incumbents", [*incumbents] or np.empty((0, 2)), {}
    )
    for seconds, objective in sorted(map(tuple, course.tolist())):
        if seconds >= limit:
            break
        if objective < lowest:
            total += gap * max(seconds - start, 0.0)
            start, gap, lowest = max(seconds, start), primal_gap(objective, best, scale), objective
    return total + gap * (limit - start)


@dataclass(frozen=True)
class RankTest:
    """Test whether the values of one sample tend to be lower than those of another.

    Parameters
    ----------
    method : str
        Name of the test.
    p_value : float, optional
        Probability of ranks at least as different without a true difference, corrected for the
        number of pairs if there are several. None if there are too few values.
    effect : float
        Probability that a value of the first sample is lower than one of the second, minus the
        opposite, in [-1, 1]: Cliff's delta, or the rank-biserial correlation for pairs.
    runs : int
        Number of values of the smaller sample; with too few pairs, the number of differing pairs.
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
    """Test whether two randomised backends differ on one instance, with one value per seed.

    Parameters
    ----------
    first, second : sequence of float
        Values of which lower is better, such as objectives; inf for a failed run.

    Returns
    -------
    RankTest
        Two-sided Mann-Whitney test.

    References
    ----------
    H. B. Mann, D. R. Whitney, Annals of Mathematical Statistics 18, 1947. The test is exact without
    ties up to ``EXACT_PRODUCT``, and uses the normal approximation with ties correction otherwise.
    """
    from scipy.stats import mannwhitneyu

    left, right = _ranked("first", first), _ranked("second", second)
    less, more = np.less.outer(left, right).mean(), np.greater.outer(left, right).mean()
    runs, effect = min(left.size, right.size), float(less - more)
    if runs < FEWEST:
        return RankTest("Mann-Whitney", None, effect, runs)
    if np.unique(np.concatenate([left, right])).size == 1:
        return RankTest("Mann-Whitney", 1.0, 0.0, runs)
    is_distinct = np.unique(np.concatenate([left, right])).size == left.size + right.size
    method = "exact" if is_distinct and left.size * right.size <= EXACT_PRODUCT else "asymptotic"
    p_value = float(mannwhitneyu(left, right, method=method).pvalue)
    return RankTest("Mann-Whitney", p_value, effect, runs)


def compare_pairs(first: _Column, second: _Column) -> RankTest:
    """Test whether two backends differ over instances, with one pair of values per instance.

    Parameters
    ----------
    first, second : sequence of float
        Equally many finite values, on the same scale for all instances, such as primal gaps or
        logarithms of seconds.

    Returns
    -------
    RankTest
        Two-sided Wilcoxon signed-rank test.

    References
    ----------
    F. Wilcoxon, Biometrics Bulletin 1, 1945. Equal pairs are omitted. The test is exact, including
    ties, up to ``EXACT`` differing pairs, and uses the normal approximation otherwise.
    """
    from scipy.stats import rankdata, wilcoxon

    left, right = _numbers("first", first), _numbers("second", second)
    if left.size != right.size:
        raise InvalidData(
            f"second must have {left.size} values, as many as first, got {right.size}",
            field="second",
        )
    largest = max(float(np.abs(left).max()), float(np.abs(right).max()), 1.0)
    # Divided by the largest if the differences could overflow.
    differences = left / largest - right / largest if largest > LARGE else left - right
    nonzero = differences[differences != 0]
    if nonzero.size < FEWEST_PAIRS:
        p_value = 1.0 if left.size >= FEWEST_PAIRS and not nonzero.size else None
        runs = left.size if p_value else nonzero.size
        return RankTest("Wilcoxon", p_value, _biserial(differences), int(runs))
    if nonzero.size <= EXACT:
        # Rank sums for all combinations of signs. Ranks are multiples of 1/2, so the sums are exact.
        signs = (np.arange(2**nonzero.size)[:, None] >> np.arange(nonzero.size)) & 1
        ranks = rankdata(np.abs(nonzero))
        sums, observed = signs @ ranks, ranks[nonzero > 0].sum()
        p_value = min(1.0, 2 * float(min((sums <= observed).mean(), (sums >= observed).mean())))
    else:
        p_value = float(wilcoxon(nonzero, method="approx").pvalue)
    return RankTest("Wilcoxon", p_value, _biserial(differences), int(left.size))


def correct_tests(tests: Mapping[_Key, RankTest]) -> dict[_Key, RankTest]:
    """Return tests with p-values corrected for their number by Holm's method.

    The probability of any false difference among them stays below the significance level.

    Parameters
    ----------
    tests : mapping of object to RankTest
        The tests.

    Returns
    -------
    dict of object to RankTest
        The same tests with corrected p-values.

    References
    ----------
    S. Holm: A simple sequentially rejective multiple test procedure, Scandinavian Journal of Statistics 6,
    1979.
    """
    corrected = dict(tests)
    tested = sorted(
        (name for name, test in tests.items() if test.p_value is not None),
        key=lambda name: tests[name].p_value or 0.0,
    )
    lower = 0.0
    for k, name in enumerate(tested):
        test = tests[name]
        lower = max(lower, min(1.0, (len(tested) - k) * (test.p_value or 0.0)))
        corrected[name] = RankTest(f"{test.method}, Holm", lower, test.effect, test.runs)
    return corrected


def _biserial(differences: np.ndarray[Any, Any]) -> float:
    """Return the rank-biserial correlation, positive if the first value of the pairs is lower."""
    from scipy.stats import rankdata

    nonzero = differences[differences != 0]
    if not nonzero.size:
        return 0.0
    ranks = rankdata(np.abs(nonzero))
    return float((ranks[nonzero < 0].sum() - ranks[nonzero > 0].sum()) / ranks.sum())


def _ranked(name: str, values: _Column) -> np.ndarray[Any, Any]:
    """Return numbers that may be infinite, as ranks allow it."""
    try:
        numbers = np.asarray(values, float)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.ndim != 1 or not numbers.size or np.isnan(numbers).any():
        raise InvalidData(f"{name} must be a list of numbers, got {show(values)}", field=name)
    return numbers


def _least(name: str, value: float) -> float:
    """Return a finite, non-negative number."""
    return float(Real(0.0).coerce(name, value, {}))


def _numbers(name: str, values: _Column) -> np.ndarray[Any, Any]:
    numbers = _ranked(name, values)
    if not np.isfinite(numbers).all():
        raise InvalidData(f"{name} must be finite, got {show(values)}", field=name)
    return numbers
