"""Statistics of a series before any estimate: length, resolution, trend and rhythm."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...models.attractor.model import AttractorAnalysis
from ..run.diagnosis import Diagnosis, Finding
from .embedding import autocorrelation, standardised

__all__ = ["diagnose_attractor"]

Floats = NDArray[np.float64]

#: Share of the variance that a line may explain, difference between the means of halves (deviations), and
#: ratio of their variances, above which a series drifts.
_TREND, _SHIFT, _RATIO = 0.1, 0.5, 2.0
#: Share of distinct values below which a series has ties. Values within the second share of the range are
#: equal.
_DISTINCT, _SAME = 0.9, 1e-12
#: Robust deviations from the median above which a value is an outlier.
_FAR = 8.0
#: Correlation above which a series repeats itself, and correlation time in samples of dense sampling.
_REPEATS, _DENSE = 0.98, 30
#: Recommended number of correlation times in a series.
_ENOUGH = 100
#: Share of the power below which no rhythm is prominent.
_FAINT = 0.05
#: Flatness above which a spectrum is flat (1 for white noise), and number of averaged segments.
_FLAT, _PIECES = 0.8, 16
#: Number of equal successive values that is reported even without other ties.
_RUN = 5


def diagnose_attractor(model: AttractorAnalysis, time_limit: float | None = None) -> Diagnosis:
    """Return statistics of a series that limit the meaning of its estimates; `time_limit` is not used.

    Every embedding that fits is a plan, so a plan always exists.
    """
    values = standardised(model.series)
    count, lags = len(values), np.arange(len(values) // 2)
    # Each sum is divided by the number of its pairs, so that a periodic series has a correlation of 1.
    correlation = autocorrelation(values, len(lags) - 1) * count / (count - lags)
    findings = (
        *_length(count),
        *_sampling(correlation, model.period),
        *_spectrum(values, correlation, model.period),
        *_drift(values),
        *_grid(model.series, model.deviation),
        *_outliers(model.series),
    )
    summary = "a plan exists, as any embedding is one; this is what the series lets it mean"
    return Diagnosis(model.name, True, "statistics of the series", summary, findings)


def _length(count: int) -> Iterator[Finding]:
    """Yield the largest dimensions that this number of samples can show."""
    dimension = 2 * np.log10(count)
    yield Finding(
        f"{count} samples: no correlation dimension above 2 log10 N = {dimension:.3g} can be seen, and no exponent "
        f"where the dimension is above {dimension / 2:.3g} (Eckmann and Ruelle 1992); an estimate near these says nothing",
        where="series",
        data={"samples": count, "largest_dimension": float(dimension)},
    )


def _first(hits: NDArray[np.bool_]) -> int | None:
    return int(hits.argmax()) if hits.any() else None


def _sampling(correlation: Floats, period: float) -> Iterator[Finding]:
    """Yield the number of samples for which the series stays correlated."""
    count = 2 * len(correlation)
    zero = _first(correlation <= 0)
    # With a mean of 0 the autocorrelation always falls, up to rounding.
    fallen = _first(correlation < np.exp(-1.0)) or len(correlation)
    data = {"correlation_time": fallen, "first_zero": zero}
    crosses = "and not to 0 within half of the series" if zero is None else f"and to 0 after {zero}"
    samples = "1 sample" if fallen == 1 else f"{fallen} samples"
    told = f"the autocorrelation falls to 1/e after {samples} ({fallen * period:.3g} s) {crosses}"
    if fallen <= 1:
        told += ": noise, a map, or a motion that is sampled too slowly to be followed"
    elif fallen > _DENSE:
        told += (
            f": sampled densely; one sample in {fallen // 10} to {fallen // 5} would do, and neighbours must be more "
            "than this apart in time"
        )
    yield Finding(told, where="series", data=data)
    if count < _ENOUGH * fallen:
        yield Finding(
            f"the series holds {count / fallen:.3g} correlation times only: few neighbours are not also near in time",
            where="series", data={"correlation_times": count / fallen},
        )  # fmt: skip


def _spectrum(values: Floats, correlation: Floats, period: float) -> Iterator[Finding]:
    """Yield the strongest rhythm, and whether the series is periodic or has no rhythm."""
    from scipy.signal import periodogram, welch

    frequencies, power = periodogram(values, window="hann", detrend="linear")
    total = float(power.sum())
    if total > 0:
        peak = int(power[1:].argmax()) + 1
        # The window spreads a line over two bins on both sides.
        share = float(power[max(peak - 2, 1) : peak + 3].sum()) / total
        strongest = 1.0 / float(frequencies[peak])
        told = (
            f"the strongest rhythm has a period of {strongest:.4g} samples ({strongest * period:.3g} s) and "
            f"{share:.1%} of the power"
        )
        if share < _FAINT:
            told = f"no rhythm stands out: the strongest has {share:.2%} of the power"
        elif peak <= 2:
            told = f"{share:.1%} of the power is in motions as slow as the series is long"
        yield Finding(told, where="spectrum", data={"period": strongest, "share": share})
        piece = max(len(values) // _PIECES, 16)
        spread = welch(values, nperseg=piece)[1][1:-1]
        mean = float(spread.mean()) or 1.0
        flatness = float(np.exp(np.log(spread + 1e-300).mean())) / mean
        if flatness > _FLAT:
            yield Finding(
                f"the spectrum is flat ({flatness:.2f}, 1 for white noise): no linear method tells it from noise",
                where="spectrum", data={"flatness": flatness},
            )  # fmt: skip
    dip = _first(correlation < 0.5)
    if dip is not None and dip + 1 < len(correlation):
        again = dip + int(correlation[dip:].argmax())
        most = float(correlation[again])
        if most > _REPEATS:
            first = dip + int((correlation[dip:] > _REPEATS).argmax())
            # The maximum of the first hill that is high enough.
            while first + 1 < len(correlation) and correlation[first + 1] > correlation[first]:
                first += 1
            yield Finding(
                f"the series repeats itself after {first} samples (correlation {correlation[first]:.4f}): it is "
                "periodic or nearly so, and its exponent 0",
                where="series", data={"repeats": first, "correlation": float(correlation[first])},
            )  # fmt: skip


def _drift(values: Floats) -> Iterator[Finding]:
    """Yield signs of drift; `values` have mean 0 and deviation 1."""
    time = np.linspace(-1.0, 1.0, len(values))
    share = float(np.corrcoef(time, values)[0, 1] ** 2)
    if share > _TREND:
        yield Finding(
            f"a straight line explains {share:.1%} of the variance: remove the trend, or differ the series",
            where="series", data={"trend": share},
        )  # fmt: skip
    half = len(values) // 2
    first, second = values[:half], values[half:]
    shift = float(second.mean() - first.mean())
    least, most = sorted((float(first.var()), float(second.var())))
    ratio = most / least if least > _SAME**2 else np.inf
    differ = []
    if abs(shift) > _SHIFT:
        differ.append(f"their means by {shift:+.3g} deviations")
    if not np.isfinite(ratio):
        differ.append("one does not vary at all")
    elif ratio > _RATIO:
        differ.append(f"the variance of one is {ratio:.3g} times that of the other")
    if differ:
        yield Finding(
            f"the halves differ: {', '.join(differ)}; a series that drifts has no one attractor",
            where="series", data={"shift": shift, "variance_ratio": ratio if np.isfinite(ratio) else None},
        )  # fmt: skip


def _grid(series: Floats, deviation: float) -> Iterator[Finding]:
    """Yield the shares of equal values and of equal states."""
    count = len(series)
    ordered = np.sort(series)
    steps = np.diff(ordered / deviation)
    same = _SAME * float(ordered[-1] / deviation - ordered[0] / deviation)
    apart = steps > same
    distinct = 1 + int(apart.sum())
    step = float(steps[apart].min()) * deviation
    tied = distinct < _DISTINCT * count
    if tied:
        multiples = steps[apart] * deviation / step
        grid = bool(np.abs(multiples - multiples.round()).max() < 1e-3)
        what = "all are multiples of" if grid else "the smallest difference is"
        yield Finding(
            f"only {distinct} of {count} values are different, {what} {step:.3g} ({step / deviation:.3g} deviations): "
            "distances below that are ties, and no scaling region reaches there",
            where="series", data={"distinct": distinct, "step": step, "grid": grid},
        )  # fmt: skip
    # Places at which the value changes.
    begins = np.flatnonzero(np.concatenate([[True], np.diff(series) != 0, [True]]))
    runs = np.diff(begins)
    longest = int(runs.max())
    if longest >= _RUN:
        start = int(begins[runs.argmax()])
        yield Finding(
            f"the same value stands {longest} times in a row from sample {start} on: a sensor that stuck, or a "
            "gap that was filled",
            where=f"series[{start}]", data={"run": longest, "start": start},
        )  # fmt: skip
    repeated = _repeated(series)
    if repeated > 0:
        yield Finding(
            f"{repeated:.1%} of all three successive values occur elsewhere exactly: such neighbours never part",
            where="series", data={"repeated": repeated},
        )  # fmt: skip


def _repeated(series: Floats) -> float:
    """Return the share of triples of successive values that occur more than once."""
    key = np.unique(series, return_inverse=True)[1].astype(np.int64)
    whole = key
    for back in (1, 2):
        joined = whole[: len(series) - back] * (int(key.max()) + 1) + key[back:]
        whole = np.unique(joined, return_inverse=True)[1].astype(np.int64)
    return float((np.bincount(whole)[whole] > 1).mean())


def _outliers(series: Floats) -> Iterator[Finding]:
    """Yield values far from all others."""
    away = np.abs(series - np.median(series))
    spread = 1.4826 * float(np.median(away))
    if spread == 0:
        share = float((away == 0).mean())
        yield Finding(
            f"{share:.1%} of the values are the same, {float(np.median(series)):.6g}",
            where="series", data={"equal": share},
        )  # fmt: skip
        return
    far = np.flatnonzero(away > _FAR * spread)
    if far.size:
        worst = int(away.argmax())
        several = "1 value lies" if far.size == 1 else f"{far.size} values lie"
        yield Finding(
            f"{several} more than {_FAR:g} robust deviations from the median, the farthest at sample {worst}: "
            f"{series[worst]:.6g}",
            where=f"series[{worst}]", data={"outliers": int(far.size), "worst": worst},
        )  # fmt: skip
