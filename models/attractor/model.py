"""Analysis of a measured series as the motion on an attractor.

Source: "Method of Quantitative Analysis for Multirobot Cooperative Hunting Behaviors", Mathematical
Problems in Engineering 2016, article 4370635, doi 10.1155/2016/4370635.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Flag, Optional, Real, Text, declared, required
from ..inputs import FloatArray, FloatsOrNone
from ..model import Model
from ..verification import TOLERANCE, Check, Verification, check_tolerance
from .checks import Sample, prediction_error
from .evidence import evidence_gap
from .plan import AttractorEstimate, Judgement, Slope
from .recomputed import exponents, measures

__all__ = ["AttractorAnalysis"]

Floats = NDArray[np.float64]

#: Smallest and largest number of samples.
LEAST, MOST = 50, 10_000_000
#: Smallest scale for relative differences of exponents, in nats per sample.
SLOW = 0.01


@dataclass(frozen=True, eq=False, repr=False)
class AttractorAnalysis(Model[AttractorEstimate]):
    """Delay, dimension, largest Lyapunov exponent and correlation dimension of a series.

    Parameters
    ----------
    series : ndarray, shape (n,)
        Measured values, evenly spaced in time, at least 50.
    period : float
        Seconds between samples, > 0.
    unit : str
        Unit of the values, for pictures.
    true_exponent : float, optional
        Largest Lyapunov exponent in nats per second, if it is known. Hidden from backends.
    true_dimension : float, optional
        Correlation dimension, if it is known. Hidden from backends.
    chaotic : bool, optional
        Whether the series is known to come from a chaotic motion. Hidden from backends.
    further : ndarray, shape (n, k), optional
        Further coordinates of the same motion, measured at the same times, in any unit.

    Notes
    -----
    The objective is the mean relative error of the known figures, each at most 1. A known figure that the
    estimate does not claim has the error 1. Without known figures, the objective is the error of predicting
    one delay ahead by the nearest state, relative to the deviation of the series. It measures the embedding
    only.

    Raises
    ------
    InvalidData
        The message gives field, place and value.

    Examples
    --------
    >>> import crosstrack as ct
    >>> model = ct.load("attractor/henon")
    >>> print(model.describe())
    2000 samples, one each 1 s
    """

    series: FloatArray = declared(Array(("n",)))
    period: float = declared(Real(lower=0, strict=True, unit="s"), default=1.0)
    unit: str = declared(Text(), default="")
    true_exponent: float | None = declared(Optional(Real()), hidden=True, default=None)
    true_dimension: float | None = declared(Optional(Real(lower=0)), hidden=True, default=None)
    chaotic: bool | None = declared(Optional(Flag()), hidden=True, default=None)
    further: FloatsOrNone = declared(Optional(Array(("n", "k"))), added=True, default=None)

    kind: ClassVar[str] = "attractor"
    plan_type: ClassVar[type] = AttractorEstimate
    agreement: ClassVar[float | None] = 0.2
    #: Backends answer different questions: an exponent, a dimension or an embedding.
    rivals: ClassVar[bool] = False

    @property
    def times(self) -> Floats:
        """Times of the samples in seconds from the first one, shape (n,)."""
        times: Floats = self.period * np.arange(float(len(self.series)))
        return times

    def check(self) -> None:
        """Reject series that are too short, constant, or whose squares overflow."""
        count = len(self.series)
        if not LEAST <= count <= MOST:
            raise InvalidData(
                f"series must hold {LEAST} … {MOST} samples, got {count}", field="series"
            )
        for name, values in self._named_coordinates():
            _check_values(name, values)

    @property
    def deviation(self) -> float:
        """Standard deviation of the series, in its unit."""
        return _deviation(self.series)

    def _named_coordinates(self) -> list[tuple[str, Floats]]:
        """Return the measured coordinates with their names in messages."""
        further = () if self.further is None else self.further.T
        return [("series", self.series), *((f"further[:, {k}]", x) for k, x in enumerate(further))]

    @property
    def coordinates(self) -> Floats:
        """The series and the further coordinates with its mean and deviation, shape (k + 1, n)."""
        mean, deviation = self.series.mean(), self.deviation
        columns = [
            (x - x.mean()) * (deviation / _deviation(x)) + mean
            for _, x in self._named_coordinates()[1:]
        ]
        return np.stack([self.series, *columns])

    def states(self, delay: int, dimension: int) -> Floats:
        """Return the states of an embedding, shape (n - (dimension - 1) delay, dimension (k + 1)).

        The delayed values of the series come first, then those of each further coordinate.

        Parameters
        ----------
        delay, dimension : int
            Samples between delayed values, and number of delayed values of each coordinate.

        Raises
        ------
        InvalidData
            The series is too short for the embedding.
        """
        count = len(self.series) - (dimension - 1) * delay
        if not count > 1:
            raise InvalidData(
                f"delay {delay} and dimension {dimension} need more than {(dimension - 1) * delay + 1} "
                f"samples, got {len(self.series)}",
                field="dimension",
            )
        columns = [
            x[k * delay : k * delay + count] for x in self.coordinates for k in range(dimension)
        ]
        return np.ascontiguousarray(np.stack(columns, axis=1))

    def verify(self, plan: AttractorEstimate, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the objective, and check that every slope is that of its recomputed curve.

        The curves are computed pair by pair, for all states up to 1500, otherwise for a sample of 500 of them.
        The slope of a sample may differ by five standard errors.
        """
        check_tolerance(tolerance)
        required("plan", plan, AttractorEstimate)
        states = self.states(plan.delay, plan.dimension)
        sample = Sample(states, plan.theiler, self.scene_seeds(1)[0])
        checks = [
            Check.scaled(
                "embedding fits", "", max(plan.theiler + 1.0 - (len(states) - 1), 0.0), "samples",
                f"{len(states)} states", tolerance, 1.0,
            )
        ]  # fmt: skip
        for name, slope in (
            ("exponent", plan.exponent),
            ("correlation dimension", plan.correlation),
        ):
            if slope is not None:
                checks.append(self._slope_check(name, sample, slope, tolerance))
        if plan.surrogates is not None:
            checks.append(_judgement_check(plan, len(self.series) * self.period, tolerance))
            evidence = plan.surrogates.evidence
            if evidence is not None:
                gap = evidence_gap(self.series, plan, evidence, self.scene_seeds(1)[0])
                where = f"K = {evidence.zero_one:.3g}"
                checks.append(
                    Check.scaled(
                        "evidence follows from the series", "", gap, "", where, tolerance, 1.0
                    )
                )
        checks += self._further_checks(plan, sample, tolerance)
        known = self._errors(plan)
        if known:
            return Verification(sum(known) / len(known), tuple(checks))
        return Verification(prediction_error(sample, plan.delay, plan.dimension - 1), tuple(checks))

    def _slope_check(self, name: str, sample: Sample, slope: Slope, tolerance: float) -> Check:
        result, error, width = sample.slope(slope, self.period)
        # The smallest relevant slope is a change of 1 over the region.
        scale = max(abs(slope.value), 1.0 / width)
        # For small samples, the allowance is limited to the slope or to one nat over the region.
        worst = max(abs(slope.value - result) - min(5.0 * error, scale), 0.0)
        unit = "nats/s" if name == "exponent" else ""
        return Check.scaled(
            f"{name} is the slope of its curve", "13-14" if unit else "15-17", worst, unit,
            f"{slope.low:g} … {slope.high:g}, computed again {result:.6g}", tolerance, scale,
        )  # fmt: skip

    def _further_checks(
        self, plan: AttractorEstimate, sample: Sample, tolerance: float
    ) -> list[Check]:
        """Check that the exponents of the spectrum and the measures are those of the raw data."""
        checks = []
        if (spectrum := plan.spectrum) is not None:
            count = len(spectrum.values)
            values, errors = exponents(sample, spectrum.step, spectrum.neighbours, count)
            rate = 1.0 / (spectrum.step * self.period)
            # Of few steps, the allowance is limited to the exponent or to one nat per step.
            scale = np.maximum(np.abs(spectrum.values), rate)
            apart = np.abs(np.array(spectrum.values) - values * rate)
            apart -= np.minimum(5.0 * errors * rate, scale)
            over = float(np.max(np.nan_to_num(np.maximum(apart, 0.0) / scale, nan=np.inf)))
            checks.append(
                Check.scaled(
                    "spectrum is that of the linear maps", "", over, "",
                    f"computed again {', '.join(f'{x * rate:.4g}' for x in values)}", tolerance, 1.0,
                )
            )  # fmt: skip
        if plan.measures is not None:
            again = measures(sample.states, self.series, plan.theiler, plan.measures)
            claimed = plan.measures.values
            apart_by = {n: abs(x - again[n]) / max(abs(x), 1.0) for n, x in claimed.items()}
            worst = max(apart_by, key=lambda n: np.nan_to_num(apart_by[n], nan=np.inf), default="")
            where = f"{worst}, computed again {again[worst]:.6g}" if worst else ""
            over = float(np.nan_to_num(apart_by.get(worst, 0.0), nan=np.inf))
            checks.append(
                Check.scaled(
                    "measures are those of the series", "", over, "", where, tolerance, 1.0
                )
            )
        return checks

    def _errors(self, plan: AttractorEstimate) -> list[float]:
        """Return the relative errors of the known figures."""
        result = []
        correlation = None if plan.correlation is None else plan.correlation.value
        for known, value, least in (
            (self.true_exponent, plan.largest_exponent, SLOW / self.period),
            (self.true_dimension, correlation, 1e-9),
        ):
            if known is not None:
                apart = 1.0 if value is None else abs(value - known) / max(abs(known), least)
                result.append(min(apart, 1.0))
        if self.chaotic is not None:
            claimed = plan.surrogates
            right = claimed is not None and (claimed.judgement is Judgement.CHAOTIC) == self.chaotic
            result.append(0.0 if right else 1.0)
        return result

    def distance(self, plan: AttractorEstimate, other: AttractorEstimate) -> float:
        """Return the largest relative difference of the figures that both plans claim.

        Exponents near 0 are relative to 0.01 nats per sample, and different judgements have the distance 1.
        Of spectra the resolved exponents are compared, and measures if they have the same radius and order.
        If both plans claim nothing but an embedding, the delays are compared.
        """
        pairs, slow = list[tuple[float | None, float | None, float]](), SLOW / self.period
        pairs.append((plan.largest_exponent, other.largest_exponent, slow))
        if plan.correlation is not None and other.correlation is not None:
            pairs.append((plan.correlation.value, other.correlation.value, 1e-9))
        if plan.spectrum is not None and other.spectrum is not None:
            first, second = (x.values[: x.resolved] for x in (plan.spectrum, other.spectrum))
            pairs += [(x, y, slow) for x, y in zip(first, second, strict=False)]
        if plan.measures is not None and other.measures is not None:
            mine, theirs = plan.measures, other.measures
            if (mine.radius, mine.order) == (theirs.radius, theirs.order):
                pairs += [(x, theirs.values.get(name), 0.05) for name, x in mine.values.items()]
        apart = [
            abs(x - y) / max(abs(x), abs(y), least)
            for x, y, least in pairs
            if x is not None and y is not None
        ]
        if plan.surrogates is not None and other.surrogates is not None:
            same = plan.surrogates.judgement is other.surrogates.judgement
            apart.append(0.0 if same else 1.0)
        if not apart:
            longer = max(plan.delay, other.delay)
            apart.append((longer - min(plan.delay, other.delay)) / longer)
        return max(apart)

    def describe(self) -> str:
        """Return the number of samples, the period and the number of coordinates as text."""
        more = "" if self.further is None else f", {len(self.further[0]) + 1} coordinates"
        return f"{len(self.series)} samples, one each {self.period:.6g} s{more}"


def _deviation(values: Floats) -> float:
    """Return the standard deviation; halves do not overflow."""
    return 2.0 * float((values / 2 - values.mean() / 2).std())


def _check_values(name: str, values: Floats) -> None:
    """Reject values that are constant, too large or too near one another."""
    low, high = float(values.min()), float(values.max())
    field = name.partition("[")[0]
    if low == high:
        raise InvalidData(
            f"{name} must not be constant, got {low:g} at all {len(values)} samples", field=field
        )
    if not max(abs(low), abs(high)) < 1e150 or not high - low > 1e-150:
        raise InvalidData(
            f"{name} must have values below 1e150 that differ by more than 1e-150, got {low:g} … {high:g}",
            field=field,
        )
    deviation = _deviation(values)
    if deviation <= 1e-12 * max(abs(low), abs(high)):
        raise InvalidData(
            f"{name} must vary by more than rounding does: its deviation is {deviation:g} about "
            f"{float(values.mean()):g}",
            field=field,
        )


def _judgement_check(plan: AttractorEstimate, duration: float, tolerance: float) -> Check:
    """Check that ranks and evidence support the judgement.

    Chaos and nonlinearity need a rank of 5 %. Chaos needs an exponent clearly above 0, a separation
    of neighbours over the `duration` in seconds, and no reason against it. A regular motion needs neighbours that
    stay together. Plans without evidence need less.
    """
    result = plan.surrogates
    assert result is not None
    over, evidence = 0.0, result.evidence
    if result.judgement is Judgement.REGULAR:
        over = 0.0 if evidence is not None and evidence.stays else 1.0
    elif result.judgement is not Judgement.NOISE:
        over = max(result.p_value - 0.05, 0.0)
    if result.judgement is Judgement.CHAOTIC:
        slope = plan.exponent
        sure = slope is not None and slope.value > 0.0
        if evidence is not None and slope is not None:
            doubts = evidence.doubts(slope.value, slope.deviation, duration)
            sure = sure and not (evidence.stays or evidence.refutes or doubts)
        over = over if sure else 1.0
    ranks = f"p = {result.p_value:.3g}"
    return Check.scaled("judgement follows from the ranks", "", over, "", ranks, tolerance, 0.05)
