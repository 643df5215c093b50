"""Estimators that follow a drive sample by sample, created by :func:`crosstrack.prepare`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import jit
from ...errors import InvalidData, UnsupportedOption
from ...models.fields import Real, show
from ...models.sideslip.data import MOST_GAP
from ...models.sideslip.dynamics import parameters
from ...models.sideslip.model import SideslipEstimation
from .gates import Track, new_track, noise_of
from .mismatch import ERRORS
from .online_kernels import Cloud, Pair, kalman_sample, unscented_sample
from .passes import largest_variance, noise_variances
from .unscented import setting_of
from .unscented_kernels import SIZE

__all__ = ["OnlineEstimate", "OnlineFilter", "prepare_sideslip"]

Floats = NDArray[np.float64]

#: Samples that the gate keeps at first; the number doubles if the longest window has more.
_ROOM = 4096
#: Largest values of speed (m/s), steering angle (rad), yaw rate (rad/s) and acceleration (m/s²), as in a recording.
_LARGEST = (1000.0, 0.5 * math.pi, 100.0, 1000.0)
_ERRORS, _TERMS = (2, len(ERRORS)), (2, 2 * len(ERRORS) + 2)
#: Shapes of the fields of a :class:`Pair` up to `error`.
_SHAPES: tuple[Any, ...] = (
    2, 2, 2, (2, 2), 4, 5, (2, 2), (2, 2, 2), (2, 2), (2, 2, 2), (2, 2), (2, 2, 2), (1, 2, 2), (1, 2),
    (2, 2, 2), (2, 2), _ERRORS, _ERRORS, _TERMS, _ERRORS, _TERMS, 2, 2,
)  # fmt: skip
_NAMES = ("speed", "steering", "yaw_rate", "lateral_acceleration")


class OnlineEstimate(NamedTuple):
    """Estimate at the newest sample.

    Parameters
    ----------
    sideslip, deviation : float
        Angle and its standard deviation, rad.
    contradiction : float
        Difference from kinematics (rad) that widens the deviation; 0 without a contradiction.
    grip_lost : bool
        True while an axle slides, according to ``unscented-filter``.
    """

    sideslip: float
    deviation: float
    contradiction: float
    grip_lost: bool


class OnlineFilter:
    """Filter that follows a drive sample by sample; created by :func:`crosstrack.prepare`.

    Angle, covariance and deviation equal those of the backend on the same samples. The object can be
    pickled at any time.

    Parameters
    ----------
    model : SideslipEstimation
        Vehicle, noise and initial state. Its recording is not read.
    backend : {"kalman-filter", "unscented-filter"}
        Filter.
    history : float, default 0
        Seconds by which a sample may be late. The filter then runs again over the samples since, which
        takes as long as they took. With 0 late samples are refused.

    Raises
    ------
    InvalidData
        The history is negative or not finite.
    """

    @np.errstate(over="ignore")  # noises of any size are allowed
    def __init__(self, model: SideslipEstimation, backend: str, history: float = 0.0) -> None:
        self._history = Real(0.0).coerce("history", history, {})
        jit.compile_always()
        self._backend = backend
        self._sensors = noise_of(model)
        self._sensors[3] = model.vehicle.rear
        self._most = largest_variance(model)
        if backend == "kalman-filter":
            initial = np.concatenate([model.initial, model.initial_deviation**2])
            arrays: list[Any] = [*map(np.zeros, _SHAPES), np.zeros(2, bool), np.zeros(1, np.int8)]
            self._start: Any = Pair._make(
                [*arrays, parameters(model.vehicle), noise_variances(model), initial]
            )
        else:
            *constants, initial = setting_of(model)
            arrays = [np.zeros(shape) for shape in (1, 1, 1, 2, (2, SIZE), (2, SIZE, SIZE), 2, 2)]
            self._start = Cloud._make(
                [*arrays, *constants, initial[:, 0].copy(), np.diag(initial[:, 1])]
            )
            self._most = math.sqrt(self._most)
        self.reset()
        self.update((0.0, 10.0, 0.0, 0.0, 0.0))  # loads the compiled code
        self.reset()

    def reset(self) -> None:
        """Forget all samples: the next one is the first of a drive."""
        self._filter, self._track = _copied(self._start), new_track(_ROOM, self._sensors)
        self._time, self._inputs = -math.inf, (math.nan, math.nan)
        self._samples: list[tuple[float, ...]] = []
        self._saved: list[tuple[Any, ...]] = [self._snapshot()] * 2 if self._history else []

    @property
    def state(self) -> Floats:
        """State at the newest sample: angle (rad), yaw rate (rad/s), and the further ones of ``unscented-filter``."""
        return np.array(self._filter.filtered[1])

    @property
    def covariance(self) -> Floats:
        """Covariance of :attr:`state` by the model, before the deviation of the angle is widened."""
        if isinstance(self._filter, Cloud):
            return np.array(self._filter.root[1] @ self._filter.root[1].T)
        return np.array(self._filter.covariance[1])

    def update(self, sample: Sequence[float] | dict[str, float]) -> OnlineEstimate:
        """Return the estimate after a further sample.

        Parameters
        ----------
        sample : sequence of float, or dict
            Time (s), speed (m/s), steering angle (rad), yaw rate (rad/s) and lateral acceleration (m/s²), as
            in a :class:`~crosstrack.models.sideslip.Recording`. NaN marks a missing value: the filter
            uses the other measurement or only predicts, and keeps the last speed and steering angle.
            After more than 2 s without a sample it starts again. The keys of a dict are ``time``,
            ``speed``, ``steering``, ``yaw_rate`` and ``lateral_acceleration``, and missing values may be omitted.

        Returns
        -------
        OnlineEstimate
            Angle and deviation at the newest time, which is not that of a late sample.

        Raises
        ------
        InvalidData
            A value is out of range, the first sample, or the first one after a gap, has no speed or steering
            angle, or the sample is later than `history` or has the time of another one. The filter is unchanged.
        """
        time, speed, steering, yaw_rate, acceleration = values = self._checked(sample)
        if not time > self._time:
            return self._insert(values)
        first = not time - self._time <= MOST_GAP
        if speed != speed or steering != steering:
            held = (math.nan, math.nan) if first else self._inputs
            speed = held[0] if speed != speed else speed
            steering = held[1] if steering != steering else steering
            if speed != speed or steering != steering:
                raise InvalidData(
                    "speed and steering must be known at the first sample and after a gap",
                    field="speed",
                )
        if self._track.counts[0] == len(self._track.times):
            self._track = _compacted(self._track)
        if self._history:
            if time - self._saved[1][0] >= self._history:
                self._saved = [self._saved[1], self._snapshot()]
                self._samples = [entry for entry in self._samples if entry[0] > self._saved[0][0]]
            self._samples.append(values)
        if first:
            self._filter, self._track = _copied(self._start), new_track(_ROOM, self._sensors)
        self._time, self._inputs = time, (speed, steering)
        step = kalman_sample if self._backend == "kalman-filter" else unscented_sample
        data = time, speed, steering, yaw_rate, acceleration
        return OnlineEstimate(*step(first, *data, self._most, self._filter, self._track))

    def _checked(self, sample: Any) -> tuple[float, float, float, float, float]:
        """Return the values of a sample, or raise if one is out of range."""
        if type(sample) is dict and sample.keys() <= {"time", *_NAMES}:
            sample = [sample.get(name, math.nan) for name in ("time", *_NAMES)]
        try:
            time, u, d, w, a = map(
                float, () if isinstance(sample, str | bytes | set | dict) else sample
            )
        except (TypeError, ValueError, OverflowError):
            raise InvalidData(
                f"sample must be time, {', '.join(_NAMES)}, got {show(sample)}", field="sample"
            ) from None
        if not abs(time) < math.inf:
            raise InvalidData(f"time must be finite, got {time:g}", field="time")
        high, right, fast, strong = _LARGEST
        if u < 0.0 or u > high or abs(d) > right or abs(w) > fast or abs(a) > strong:
            for name, value, most in zip(_NAMES, (u, d, w, a), _LARGEST, strict=True):
                least = 0.0 if name == "speed" else -most
                if not (least <= value <= most or value != value):
                    raise InvalidData(
                        f"{name} must be {least:.5g} … {most:.5g}, got {value:g}", field=name
                    )
        return time, u, d, w, a

    def _insert(self, late: tuple[float, ...]) -> OnlineEstimate:
        """Return the estimate at the newest time after a late sample, by running again from before it."""
        oldest = self._saved[0][0] if self._saved else math.inf
        times = [entry[0] for entry in self._samples]
        if not late[0] > oldest or late[0] in times:
            raise InvalidData(
                f"time must rise, got {late[0]:.9g} s after {self._time:.9g} s: history={self._history:g} s "
                "bounds how late a sample may be, and times must differ",
                field="time",
            )
        former = self._snapshot(), self._samples, self._saved
        samples = sorted([*self._samples, late])
        try:
            self._restore(self._saved[0])
            self._samples, self._saved = [], [self._saved[0]] * 2
            for entry in samples:
                result = self.update(entry)
        except InvalidData:
            self._restore(former[0])
            self._samples, self._saved = former[1:]
            raise
        return result

    def _snapshot(self) -> tuple[Any, ...]:
        """Return a copy of the state. Rows of the track before its count never change."""
        track = self._track._replace(
            state=self._track.state.copy(), counts=self._track.counts.copy()
        )
        return self._time, self._inputs, _copied(self._filter), track

    def _restore(self, snapshot: tuple[Any, ...]) -> None:
        self._time, self._inputs, self._filter, self._track = snapshot
        self._time, self._inputs, self._filter, self._track = self._snapshot()

    def __repr__(self) -> str:
        return f"<OnlineFilter {self._backend} at {self._time:g} s>"


def _copied(arrays: Any) -> Any:
    return arrays._make(array.copy() for array in arrays)


def _compacted(track: Track) -> Track:
    """Return the track without the samples that no later window or reference needs."""
    count = int(track.counts[0])
    recent = np.arange(track.counts[2:].min(), count)
    last = track.state[3:4].astype(int)
    rows = np.unique(np.concatenate([recent, track.origin[recent], last[last >= 0]]))
    room = len(track.times) * (2 if len(rows) > len(track.times) // 2 else 1)
    moved: list[Any] = []
    for array in track[:-3]:
        moved.append(np.zeros((room, *array.shape[1:]), array.dtype))
        moved[-1][: len(rows)] = array[rows]
    state, counts = track.state.copy(), np.searchsorted(rows, track.counts)
    state[3:5] = np.where(state[3:5] < 0, state[3:5], np.searchsorted(rows, state[3:5]))
    result = Track._make([*moved, state, counts, track.sensors])
    result.origin[: len(rows)] = np.searchsorted(rows, track.origin[rows])
    return result


def prepare_sideslip(
    model: SideslipEstimation, backend: str = "kalman-filter", history: float = 0.0, **options: Any
) -> OnlineFilter:
    """Prepare a filter that follows a drive; refuse other backends and options."""
    if options:
        raise UnsupportedOption(
            f"prepare accepts the option history for a sideslip model, got {', '.join(options)}"
        )
    if backend not in ("kalman-filter", "unscented-filter"):
        raise UnsupportedOption(
            "prepare takes the backends 'kalman-filter' and 'unscented-filter' for a sideslip model, got "
            f"{show(backend)}: others use later samples, solve programs or learn"
        )
    return OnlineFilter(model, backend, history)
