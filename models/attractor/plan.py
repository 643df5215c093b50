"""Estimate of an attractor: the embedding, slopes with their regions, and a judgement."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from ...errors import InvalidData
from ..declaration import Declared, Nested, Plan
from ..fields import NumberTuple, Optional, Real, Whole, declared, show
from ..records import Member
from .judgement import Evidence, Judgement, SurrogateTest

__all__ = [
    "AttractorEstimate",
    "Evidence",
    "Judgement",
    "Measures",
    "Method",
    "Slope",
    "Spectrum",
    "SurrogateTest",
]


class Method(StrEnum):
    """Curve of a slope."""

    #: Mean logarithm of the distance from the nearest neighbour, over time (Rosenstein and others 1993).
    ROSENSTEIN = "rosenstein"
    #: Mean logarithm of the mean distance from all neighbours within a radius, over time (Kantz 1994).
    KANTZ = "kantz"
    #: Logarithm of the correlation sum over that of the radius (Grassberger and Procaccia 1983).
    CORRELATION = "correlation"
    #: The same between two radii, with pairs of a state with itself (equations 15 and 17 of the paper).
    TWO_POINTS = "two-points"
    #: The same as a line through 16 radii, with pairs of a state with itself (Figure 4 of the paper).
    LINE = "line"

    @property
    def is_exponent(self) -> bool:
        """Whether the slope is an exponent; otherwise it is a correlation dimension."""
        return self in (Method.ROSENSTEIN, Method.KANTZ)


@dataclass(frozen=True, eq=False)
class Slope(Declared):
    """Slope of a curve within its scaling region.

    Parameters
    ----------
    method : Method
        Curve of the slope.
    value : float
        The slope: nats per second for an exponent, a dimension for a correlation sum.
    deviation : float
        Claimed standard deviation, >= 0.
    low, high : float
        Scaling region: steps ahead (integers, samples) for an exponent, radii in the unit of the series for
        a correlation sum.
    radius : float, optional
        Radius of Kantz' method within which states are neighbours, in the unit of the series.
    """

    method: Method = declared(Member(Method))
    value: float = declared(Real())
    deviation: float = declared(Real(lower=0))
    low: float = declared(Real(lower=0))
    high: float = declared(Real(lower=0))
    radius: float | None = declared(Optional(Real(lower=0, strict=True)), default=None)

    def check(self) -> None:
        """Reject regions without a width, and steps that are not integers."""
        if not self.high > self.low:
            raise InvalidData(
                f"high must be > low = {self.low:g}, got {self.high:g}: a slope needs a region",
                field="high",
            )
        if (self.method is Method.KANTZ) != (self.radius is not None):
            raise InvalidData(
                f"radius belongs to the method kantz, got {show(self.radius)} with {self.method}",
                field="radius",
            )
        if not self.method.is_exponent:
            if not self.low > 0:
                raise InvalidData(f"low must be a radius > 0, got {self.low:g}", field="low")
            return
        for name, value in (("low", self.low), ("high", self.high)):
            if not value.is_integer():
                raise InvalidData(
                    f"{name} must be a whole number of steps, got {value}", field=name
                )

    def __str__(self) -> str:
        return f"{self.value:.4g} ± {self.deviation:.2g}"


@dataclass(frozen=True, eq=False)
class Spectrum(Declared):
    """Lyapunov exponents from linear maps of neighbourhoods, one `step` ahead.

    Parameters
    ----------
    values, deviations : tuple of float
        Exponents, the largest first, and their claimed standard deviations, in nats per second.
    resolved : int
        Number of leading exponents whose directions are resolved. In the other directions the neighbours lie
        on a curved sheet, so the value is an order of magnitude, and its deviation at least as large.
    neighbours, step : int
        Number of neighbours of each linear map, and samples from a state to its image.
    """

    values: tuple[float, ...] = declared(NumberTuple(("exponents",)))
    deviations: tuple[float, ...] = declared(NumberTuple(("exponents",), lower=0))
    resolved: int = declared(Whole(0))
    neighbours: int = declared(Whole(2))
    step: int = declared(Whole(1, 10**9))

    def check(self) -> None:
        """Reject an empty spectrum, exponents that are not in descending order, and too many resolved ones."""
        if not self.values or list(self.values) != sorted(self.values, reverse=True):
            raise InvalidData(
                f"values must be in descending order and not empty, got {show(self.values)}",
                field="values",
            )
        if self.resolved > len(self.values):
            raise InvalidData(
                f"resolved must be <= {len(self.values)} exponents, got {self.resolved}",
                field="resolved",
            )

    @property
    def kaplan_yorke(self) -> tuple[float, float] | None:
        """Kaplan-Yorke dimension and its standard deviation; None if no sum of leading exponents is negative.

        The deviation follows from those of the exponents, as if they were independent. If the first exponent
        is negative, the dimension is 0.
        """
        total = variance = 0.0
        for count, (value, deviation) in enumerate(zip(self.values, self.deviations, strict=True)):
            if total + value < 0:
                spread = math.sqrt(variance + (total / value * deviation) ** 2) / -value
                return count - total / value, spread if count else 0.0
            total, variance = total + value, variance + deviation**2
        return None

    def __str__(self) -> str:
        parts = zip(self.values, self.deviations, strict=True)
        return ", ".join(f"{value:.4g} ± {deviation:.2g}" for value, deviation in parts)


_MEASURE = Optional(Real())


@dataclass(frozen=True, eq=False)
class Measures(Declared):
    """Measures of recurrence, order and memory; None for an undefined one.

    States are recurrent if they are more than the Theiler window apart in time and no coordinate differs by
    more than `radius`. Recurrence and the sample entropy use the first 4000 samples.

    Parameters
    ----------
    radius : float
        Distance of recurrent states, in the unit of the series.
    order : int
        Number of values of an ordinal pattern.
    recurrence_rate : float, optional
        Share of recurrent pairs.
    determinism, laminarity : float, optional
        Share of recurrent pairs in diagonal and in vertical lines of at least two pairs.
    diagonal_mean, diagonal_longest : float, optional
        Mean and largest length of these diagonal lines, in samples.
    diagonal_entropy : float, optional
        Shannon entropy of their lengths, in nats.
    permutation_entropy : float, optional
        Shannon entropy of the ordinal patterns of `order` values one sample apart, divided by ln(order!).
    hurst : float, optional
        Exponent of the rescaled range, corrected by its expectation for independent values.
    fluctuation : float, optional
        Exponent of the detrended fluctuation of the cumulative sum (DFA of order 1).
    sample_entropy : float, optional
        Rate at which two equal pairs of successive values differ in the third, in nats per sample. Values are
        equal if they differ by at most `radius`.
    """

    radius: float = declared(Real(lower=0, strict=True))
    order: int = declared(Whole(2, 8))
    recurrence_rate: float | None = declared(_MEASURE, default=None)
    determinism: float | None = declared(_MEASURE, default=None)
    laminarity: float | None = declared(_MEASURE, default=None)
    diagonal_mean: float | None = declared(_MEASURE, default=None)
    diagonal_longest: float | None = declared(_MEASURE, default=None)
    diagonal_entropy: float | None = declared(_MEASURE, default=None)
    permutation_entropy: float | None = declared(_MEASURE, default=None)
    hurst: float | None = declared(_MEASURE, default=None)
    fluctuation: float | None = declared(_MEASURE, default=None)
    sample_entropy: float | None = declared(_MEASURE, default=None)

    @property
    def values(self) -> dict[str, float]:
        """Defined measures by name."""
        return {
            name: value
            for name, value in self.data().items()
            if value is not None and name not in ("radius", "order")
        }

    def __str__(self) -> str:
        return ", ".join(
            f"{name.replace('_', ' ')} {value:.4g}" for name, value in self.values.items()
        )


@dataclass(frozen=True, eq=False)
class AttractorEstimate(Plan):
    """Embedding of a series, and the figures found in it.

    Parameters
    ----------
    delay : int
        Samples between the coordinates of a state, >= 1.
    dimension : int
        Number of coordinates, >= 1.
    theiler : int
        States at most this number of samples apart are not neighbours, >= 0.
    exponent : Slope, optional
        Largest Lyapunov exponent in nats per second.
    correlation : Slope, optional
        Correlation dimension.
    surrogates : SurrogateTest, optional
        Test whether linear noise explains the series.
    spectrum : Spectrum, optional
        All Lyapunov exponents in nats per second.
    measures : Measures, optional
        Measures of recurrence, order and memory.
    """

    delay: int = declared(Whole(1, 10**9))
    dimension: int = declared(Whole(1, 1000))
    theiler: int = declared(Whole(0, 10**9), default=0)
    exponent: Slope | None = declared(Optional(Nested(Slope)), default=None)
    correlation: Slope | None = declared(Optional(Nested(Slope)), default=None)
    surrogates: SurrogateTest | None = declared(Optional(Nested(SurrogateTest)), default=None)
    spectrum: Spectrum | None = declared(Optional(Nested(Spectrum)), added=True, default=None)
    measures: Measures | None = declared(Optional(Nested(Measures)), added=True, default=None)

    def check(self) -> None:
        """Reject slopes of the wrong curve."""
        if self.exponent is not None and not self.exponent.method.is_exponent:
            raise InvalidData("exponent must not be a slope of a correlation sum", field="exponent")
        if self.correlation is not None and self.correlation.method.is_exponent:
            raise InvalidData(
                "correlation must be a slope of a correlation sum", field="correlation"
            )

    @property
    def window(self) -> int:
        """Samples that a state spans: ``(dimension - 1) * delay``."""
        return (self.dimension - 1) * self.delay

    @property
    def largest_exponent(self) -> float | None:
        """Largest exponent in nats per second: the slope, or else the first of the spectrum."""
        if self.exponent is None:
            return None if self.spectrum is None else self.spectrum.values[0]
        return self.exponent.value

    @property
    def exponent_bits(self) -> float | None:
        """Exponent in bits per second, ``λ / ln 2``; None without an exponent."""
        return None if self.exponent is None else self.exponent.value / math.log(2.0)

    @property
    def horizon(self) -> float | None:
        """Seconds in which a small error grows e-fold, ``1 / λ``; None without a positive exponent.

        The paper's maximum forecast period is also the inverse of the exponent. If its exponent of 0.12 is in
        bits per second, as its unit states, 8.3 s is the doubling time of an error (:attr:`doubling_time`). If
        it is in nats per second, as the natural logarithm of its equation 14 states, 8.3 s is this time.
        """
        if self.exponent is None or not self.exponent.value > 0:
            return None
        return 1.0 / self.exponent.value

    @property
    def doubling_time(self) -> float | None:
        """Seconds in which a small error doubles, ``ln 2 / λ``; None without a positive exponent."""
        return None if self.horizon is None else math.log(2.0) * self.horizon

    @property
    def variables(self) -> tuple[int, int] | None:
        """The smallest number of variables that can span the attractor, and one that always suffices.

        ``INT(D + 1)`` and ``INT(2 D + 1)``, equation 18; None without a correlation dimension.
        """
        if self.correlation is None:
            return None
        dimension = max(self.correlation.value, 0.0)
        return int(dimension + 1.0), int(2.0 * dimension + 1.0)

    def __str__(self) -> str:
        parts = [f"delay {self.delay}, dimension {self.dimension}"]
        if self.exponent is not None:
            parts.append(f"exponent {self.exponent} nats/s")
        if self.correlation is not None:
            parts.append(f"correlation dimension {self.correlation}")
        if self.surrogates is not None:
            parts.append(str(self.surrogates))
        if self.spectrum is not None:
            parts.append(f"exponents {self.spectrum} nats/s")
            if (dimension := self.spectrum.kaplan_yorke) is not None:
                parts.append("Kaplan-Yorke dimension {:.4g} ± {:.2g}".format(*dimension))
        if self.measures is not None:
            parts.append(str(self.measures))
        return ", ".join(parts)
