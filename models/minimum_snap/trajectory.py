"""Piecewise polynomial in time: the plan of every trajectory model."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ..declaration import Plan
from ..fields import Array, Optional, Spec, Whole, declared, frozen, show
from ..sampling import sample_count
from ..specs import count_rows
from .polynomials import (
    bernstein_matrix,
    by_power,
    critical_points,
    derived,
    factorials,
    gauss_legendre,
    horner,
    power_matrix,
)

if TYPE_CHECKING:
    from scipy.interpolate import BSpline, PPoly

__all__ = ["Extremes", "Trajectory", "increasing"]

Floats = NDArray[np.float64]

#: Segments per batch if intermediate arrays are larger than the result.
_CHUNK = 65536
#: Times per batch of an evaluation, whose coefficients fit into a processor's cache.
_SAMPLES = 2048
#: Highest order of a derivative. It is far above the degree of any trajectory, so the derivative is 0.
MOST_DERIVATIVES = 999


class Extremes(NamedTuple):
    """Minimum and maximum of a derivative on each segment, with one column per axis.

    Parameters
    ----------
    least, largest : ndarray, shape (segments, dimensions)
        Minimum and maximum, m/s^derivative.
    least_time, largest_time : ndarray, shape (segments, dimensions)
        Times of the minimum and of the maximum, in seconds.
    """

    least: Floats
    largest: Floats
    least_time: Floats
    largest_time: Floats


def increasing(name: str, times: Floats) -> None:
    """Raise :class:`InvalidData` unless `times` has at least two entries and increases strictly."""
    if times.size < 2:
        raise InvalidData(f"{name} must hold at least 2 entries, got {times.size}", field=name)
    bad = np.flatnonzero(np.diff(times) <= 0)
    if bad.size:
        at = int(bad[0]) + 1
        raise InvalidData(
            f"{name}[{at}] must be > {name}[{at - 1}] = {times[at - 1]:g}, got {times[at]:g}",
            field=name,
        )


@dataclass(frozen=True)
class _YawCurve(Spec):
    """Field that holds another trajectory, which has one axis and no yaw."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Trajectory:
        curve = value if isinstance(value, Trajectory) else Trajectory.from_data(value)
        if curve.dimensions != 1 or curve.yaw is not None:
            raise InvalidData(f"{name} must have one axis, got {curve.dimensions}", field=name)
        return curve

    def encode(self, value: Trajectory) -> Any:
        return value.data()

    def feed(self, value: Trajectory) -> Iterable[bytes]:
        return value._feed()


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Plan):
    """Piecewise polynomial, evaluated as ``trajectory(t, derivative=0)``.

    Parameters
    ----------
    times : ndarray, shape (segments + 1,)
        Knots in seconds, strictly increasing.
    coefficients : ndarray, shape (segments, degree + 1, dimensions)
        Coefficients in metres of ascending powers of the scaled time of each segment,
        ``s = (t - t_k) / (t_{k+1} - t_k)``. Powers of seconds would lose digits for short or long
        segments.
    yaw : Trajectory, optional
        Yaw of a vehicle, a trajectory of one axis in radians.

    Raises
    ------
    InvalidData
        Shapes differ, times do not increase, or numbers are not finite.
    """

    times: Floats = declared(Array(("knots",)))
    coefficients: Floats = declared(Array(("segments", "degree + 1", "dimensions")))
    yaw: Trajectory | None = declared(Optional(_YawCurve()), default=None, added=True)

    def check(self) -> None:
        """Reject times that do not increase, and coefficients that do not fit them."""
        increasing("times", self.times)
        shape = self.coefficients.shape
        count_rows("coefficients", shape[0], "", {"": (self.times.size - 1, "times (less one)")})
        if 0 in shape:
            raise InvalidData(
                f"coefficients must not be empty, got shape {shape}", field="coefficients"
            )

    # -- shape -----------------------------------------------------------------------------------

    @property
    def segments(self) -> int:
        """Number of polynomials."""
        return int(self.coefficients.shape[0])

    @property
    def degree(self) -> int:
        """Degree of the polynomials."""
        return int(self.coefficients.shape[1]) - 1

    @property
    def dimensions(self) -> int:
        """Number of axes."""
        return int(self.coefficients.shape[2])

    @cached_property
    def durations(self) -> Floats:
        """Duration of each segment, s, shape (segments,)."""
        return frozen(np.diff(self.times))

    @property
    def duration(self) -> float:
        """Total duration, s."""
        return float(self.times[-1] - self.times[0])

    def __repr__(self) -> str:
        return (
            f"<Trajectory {self.segments} segment{'s' if self.segments > 1 else ''} of degree "
            f"{self.degree} in {self.dimensions}-D, {self.times[0]:g} to {self.times[-1]:g} s>"
        )

    # -- values ----------------------------------------------------------------------------------

    def __call__(self, t: ArrayLike, derivative: int = 0) -> Floats:
        """Return the position or a derivative in time at `t`.

        Parameters
        ----------
        t : float or ndarray, any shape
            Times (s) between the first and the last knot. At a knot, the later segment is evaluated.
        derivative : int
            Order: 0 position (default), 1 velocity, 2 acceleration, 3 jerk, 4 snap, …

        Returns
        -------
        ndarray, shape (*t.shape, dimensions)

        Raises
        ------
        InvalidData
            A time is outside the knots, or `derivative` is not a non-negative integer.
        """
        order = _order(derivative)
        first, last = self._span
        if isinstance(t, float | int) and not isinstance(t, bool) and first <= t <= last:
            return self._value(float(t), order)
        at = _real("t", t)
        flat = at.ravel()
        inside = (flat >= first) & (flat <= last)
        if not inside.all():
            outside = float(flat[~inside][0])
            raise InvalidData(
                f"t must lie in [{self.times[0]:g}, {self.times[-1]:g}], got {outside:g}", field="t"
            )
        index = np.clip(np.searchsorted(self.times, flat, "right") - 1, 0, self.segments - 1)
        value = np.zeros((flat.size, self.dimensions))
        for begin in range(0, flat.size if order <= self.degree else 0, _SAMPLES):
            part = slice(begin, begin + _SAMPLES)
            segments = index[part]
            durations = self.durations[segments]
            s = np.clip((flat[part] - self.times[segments]) / durations, 0.0, 1.0)
            inner = by_power(self.coefficients.take(segments, axis=0), order)
            result = inner[-1]
            for row in inner[-2::-1]:
                result *= s
                result += row
            value[part] = (result / durations**order if order else result).T
        return value.reshape(*at.shape, self.dimensions)

    @cached_property
    def _span(self) -> tuple[float, float]:
        """Smallest and largest allowed time: both ends with a margin for rounding, s."""
        first, last = float(self.times[0]), float(self.times[-1])
        slack = 1e-12 * max(1.0, abs(first), abs(last))
        return first - slack, last + slack

    def _value(self, t: float, order: int) -> Floats:
        """Return a derivative at one time. Python floats are faster than arrays at this size."""
        if order > self.degree:
            return np.zeros(self.dimensions)
        segment = min(max(int(self.times.searchsorted(t, "right")) - 1, 0), self.segments - 1)
        duration = self.durations[segment]
        s = min(max((t - float(self.times[segment])) / float(duration), 0.0), 1.0)
        inner = self.coefficients[segment, order:]
        if order:
            inner = inner * factorials(self.degree, order)[:, None]
        values = []
        for axis in inner[::-1].T.tolist():
            value = 0.0
            for coefficient in axis:
                value = value * s + coefficient
            values.append(value)
        return np.array(values) / duration**order if order else np.array(values)

    def at_ends(self, derivative: int = 0) -> tuple[Floats, Floats]:
        """Return a derivative at the start and at the end of every segment.

        Parameters
        ----------
        derivative : int
            Order of the derivative, 0 by default.

        Returns
        -------
        tuple of ndarray, shape (segments, dimensions)
            Values at the starts and at the ends. The end of a segment and the start of the next one
            differ by the jump at the knot.
        """
        order = _order(derivative)
        inner = derived(self.coefficients, order)
        scale = (self.durations**-order)[:, None]
        return inner[:, 0] * scale, inner.sum(axis=1) * scale

    def integral_of_square(self, derivative: int) -> Floats:
        """Return ∫ (x^(derivative))² dt of each axis by exact Gauss-Legendre quadrature.

        The quadrature is a sum of squares without cancellation, unlike the quadratic form in the
        coefficients.

        Parameters
        ----------
        derivative : int
            Order of the derivative.

        Returns
        -------
        ndarray, shape (dimensions,)
            Integrals over all segments, m²/s^(2 derivative - 1).
        """
        order = _order(derivative)
        total = np.zeros(self.dimensions)
        if order > self.degree:
            return total
        nodes, weights = gauss_legendre(self.degree - order + 1)
        powers = np.vander(nodes, self.degree - order + 1, increasing=True)
        for begin in range(0, self.segments, _SAMPLES):
            part = slice(begin, begin + _SAMPLES)
            inner = by_power(self.coefficients[part], order)
            values = powers @ inner.reshape(len(inner), -1)
            share = (weights @ (values * values)).reshape(inner.shape[1:])
            total += (share * self.durations[part] ** (1 - 2 * order)).sum(axis=1)
        return total

    def extremes(
        self,
        derivative: int = 0,
        direction: ArrayLike | None = None,
        segments: NDArray[np.int64] | None = None,
    ) -> Extremes:
        """Return the minimum and maximum of a derivative on every segment, with their times.

        The result is exact up to rounding: it compares the values at the ends and at the roots of
        the next derivative.

        Parameters
        ----------
        derivative : int
            Order of the derivative in time, 0 by default.
        direction : ndarray, shape (segments, dimensions), optional
            Vectors along which the component is evaluated, instead of the axes. The result then has
            one column.
        segments : ndarray of int, optional
            Indices of the segments, which may repeat; one row of the result per index. All segments
            by default.

        Returns
        -------
        Extremes
            Values and times.
        """
        order = _order(derivative)
        own = np.arange(self.segments)
        if segments is not None:
            own = Array(("n",), int, lower=0, upper=self.segments - 1).coerce(
                "segments", segments, {}
            )
        inner = derived(self.coefficients[own], order)
        if direction is not None:
            sizes = {"segments": (len(own), "segments"), "axes": (self.dimensions, "trajectory")}
            along = Array(("segments", "axes")).coerce("direction", direction, sizes)
            inner = np.einsum("kpd,kd->kp", inner, along)[:, :, None]
        count, powers, width = inner.shape
        shape = (count, width)
        flat = np.moveaxis(inner, 2, 1).reshape(-1, powers)
        result = np.empty((4, count * width))
        for begin in range(0, flat.shape[0], _CHUNK):
            part = slice(begin, begin + _CHUNK)
            s = critical_points(flat[part])
            values = horner(flat[part][:, :, None], s)
            low, high = values.argmin(axis=1), values.argmax(axis=1)
            rows = np.arange(s.shape[0])
            result[0, part], result[1, part] = values[rows, low], values[rows, high]
            result[2, part], result[3, part] = s[rows, low], s[rows, high]
        least, largest, where_least, where_largest = (r.reshape(shape) for r in result)
        begin_times, long = self.times[own, None], self.durations[own, None]
        scale = long ** -float(order)
        return Extremes(
            least * scale,
            largest * scale,
            begin_times + where_least * long,
            begin_times + where_largest * long,
        )

    # -- other forms -----------------------------------------------------------------------------

    def bezier(self) -> Floats:
        """Return the Bézier control points, m, shape (segments, degree + 1, dimensions)."""
        control: Floats = np.einsum("bp,kpd->kbd", bernstein_matrix(self.degree), self.coefficients)
        return control

    @classmethod
    def from_bezier(cls, times: ArrayLike, points: ArrayLike) -> Trajectory:
        """Return the trajectory whose segments have these Bézier control points.

        Parameters
        ----------
        times : ndarray, shape (segments + 1,)
            Knots (s), strictly increasing.
        points : ndarray, shape (segments, degree + 1, dimensions)
            Control points (m).

        Raises
        ------
        InvalidData
            Shapes differ, times do not increase, or numbers are not finite.
        """
        control = Array(("segments", "degree + 1", "dimensions")).coerce("points", points, {})
        matrix = power_matrix(max(control.shape[1] - 1, 0))
        return cls(cast(Floats, times), np.einsum("pb,kbd->kpd", matrix, control))

    def to_ppoly(self) -> PPoly:
        """Return a ``scipy.interpolate.PPoly`` with values of shape (dimensions,).

        Its coefficients multiply powers of seconds, not of scaled time.
        """
        from scipy.interpolate import PPoly

        scale = self.durations[:, None] ** -np.arange(self.degree + 1.0)
        powers = self.coefficients * scale[:, :, None]
        return PPoly(np.moveaxis(powers[:, ::-1], 0, 1), self.times, extrapolate=False)

    @classmethod
    def from_ppoly(cls, piecewise: PPoly) -> Trajectory:
        """Return the trajectory of a ``PPoly``.

        Parameters
        ----------
        piecewise : scipy.interpolate.PPoly
            Piecewise polynomial with values of shape (dimensions,), or scalar values for one axis.

        Raises
        ------
        InvalidData
            `piecewise` is not a ``PPoly``, or its values have more than one dimension.
        """
        if not hasattr(piecewise, "c") or not hasattr(piecewise, "x"):
            raise InvalidData(
                f"piecewise must be a PPoly, got {show(piecewise)}", field="piecewise"
            )
        c = _real("piecewise.c", piecewise.c)
        if c.ndim not in (2, 3):
            raise InvalidData(
                f"piecewise.c must have 2 or 3 dimensions, got shape {c.shape}", field="piecewise"
            )
        powers = np.moveaxis(c.reshape(*c.shape[:2], -1)[::-1], 0, 1)
        times = Array(("knots",)).coerce("piecewise.x", piecewise.x, {})
        scale = np.diff(times)[:, None] ** np.arange(float(c.shape[0]))
        return cls(times, powers * scale[:, :, None])

    def to_bspline(self) -> BSpline:
        """Return a ``scipy.interpolate.BSpline`` of Bézier pieces, with repeated knots.

        Each segment has ``degree + 1`` coefficients, independent of the continuity.
        """
        from scipy.interpolate import BSpline

        knots = np.repeat(self.times, self.degree + 1)
        return BSpline(
            knots, self.bezier().reshape(-1, self.dimensions), self.degree, extrapolate=False
        )

    def sampled(self, rate: float = 100.0, derivatives: int = 4) -> Floats:
        """Return rows ``t, x…, ẋ…, …`` at `rate` per second, the last knot included.

        Parameters
        ----------
        rate : float
            Samples per second, positive; 100 by default.
        derivatives : int
            Highest order of a derivative in the rows, 4 by default.

        Returns
        -------
        ndarray, shape (samples, 1 + (derivatives + 1) * dimensions)
            Times (s), positions (m) and derivatives in time.

        Raises
        ------
        InvalidData
            The rate is not positive or yields too many samples, or `derivatives` is not a
            non-negative integer.
        """
        count = sample_count(self.duration, rate)
        t = self.times[0] + np.arange(count + 1) / rate
        if t[-1] < self.times[-1] - 1e-9 / rate:
            t = np.append(t, self.times[-1])
        t = np.minimum(t, self.times[-1])
        return np.column_stack([t, *(self(t, j) for j in range(_order(derivatives) + 1))])


def _order(derivative: Any) -> int:
    if type(derivative) is int and 0 <= derivative <= MOST_DERIVATIVES:
        return derivative
    if isinstance(derivative, bool) or not isinstance(derivative, int | np.integer):
        raise InvalidData(
            f"derivative must be a whole number >= 0, got {show(derivative)}", field="derivative"
        )
    return Whole(0, MOST_DERIVATIVES).coerce("derivative", derivative, {})


def _real(name: str, value: Any) -> Floats:
    """Return `value` as an array of floats of any shape, or raise :class:`InvalidData`."""
    try:
        array = np.asarray(value)
        result = np.asarray(array, float) if array.dtype.kind in "iufO" else None
    except Exception:  # a third-party `__array__` may raise any exception
        result = None
    if result is None:
        raise InvalidData(f"{name} must be numbers, got {show(value)}", field=name)
    return result
