"""Gates that widen the claimed deviation of an estimate sample by sample.

:func:`apply_gates` is called once for the result of every backend. It leaves the angles unchanged.

The kinematic gate compares the angle with ``β̇ = a_y / u - ω``, which holds for any tyre and any friction. The
reference at sample k starts from the angle of an earlier sample o and integrates the measurements::

    d = β_k - β_o - ∫ (a_y / u - ω + c) dt
    v = s_o² + noise + p T²,  T = t_k - t_o

The constant rate c, the bias of the reference, and its variance p are estimated along the drive; p begins with p₀. If
``|d| > s_k + 3.5 √v``, the deviation becomes ``√(s_k² + d²)``; the sample after a contradicted one is contradicted if
``|d| > s_k + 2 √v``. A contradicted sample is no starting point: windows that would start there start at its own
starting point o instead, so that an error that stays is found after it stopped growing. The sample is trusted again if d
is explained, or if a sensor bias that began during the drive may be the reason: for 8 s the rate of the angle
differed from the reference by less than a bias does, and ``|d| <= s_k + 3.5 √(v + p₀ T²)``.

The model of the filters replaces tangents by angles. Its error without slip at the rear axle, ``b ω / u - arctan(b ω / u)``,
is part of the deviation s_k of estimators that do not learn. It is below 0.001° at 20 m/s, and 0.5° in a narrow turn when parking.

The training-range gate compares the inputs with those of the training drives. At a standardised distance D outside of
their range the deviation becomes ``√(s_k² + (D σ)²)``, and σ is the deviation of what was learned. For kernel
regression it is at least ``R σ`` with the distance R of the recent inputs: tyres that slide change the relation between steering, yaw rate and
acceleration long before one of them leaves its range, and the distances within the kernel, which mix units, do not show
it. The deviation of linear regression grows with the leverage of the recent inputs by itself.
"""

from __future__ import annotations

import math
from collections import namedtuple
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.sideslip.data import LOW_SPEED, UNKNOWN, Recording
from ...models.sideslip.model import SideslipEstimation
from .learning import Window, training_set

__all__ = [
    "Gated", "apply_gates", "calibrate_reference", "find_contradictions", "intervals",
    "measure_history_distance", "measure_training_distance", "small_angle_error", "time_ranges",
]  # fmt: skip

Floats = NDArray[np.float64]

#: Windows of the kinematic gate, s: short ones find fast errors, long ones slow errors.
WINDOWS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
#: Factors on the noise of the reference that are tried on the training drives.
FACTORS = (1.0, 3.0, 10.0, 30.0)
#: Share of known angles that kinematics may contradict.
TOLERATED = 0.01
#: Deviations of the reference above which a difference is a contradiction. With 3 the gate flagged a sample in a third of
#: calm drives that stop and go; with 3.5 in one of twelve (in a third for linear-regression), and in no calm drive at constant speed.
THRESHOLD = 3.5
#: The same after a contradicted sample.
CLOSING = 2.0
#: Claimed deviations that must cover the difference. In 16 spins the lowest coverage is 0.85 with 1.5 and 0.91 with 1.
CLAIMED = 1.0
#: Deviation of a bias of yaw rate (rad/s) and lateral acceleration (m/s²) before the drive, as in
#: :data:`crosstrack.solvers.sideslip.mismatch.ERRORS`.
BIASES = (0.02, 0.5)
#: Smallest deviation of the estimated bias of the reference, rad/s.
LEAST_BIAS = 0.002
#: Seconds with a credible rate after which a contradicted angle is trusted again, and the window of the rate.
HOLD, RATE = 8.0, 2
#: Seconds between two updates of the bias.
UPDATE = 1.0
#: Inputs whose range is compared with the training drives.
INPUTS = ("speed", "steering", "yaw_rate", "lateral_acceleration")
#: Name of what leaves its range if no single input does.
COMBINED = "combinations of inputs"
#: Smallest unit of a standardised distance, as a share of the largest input: speeds are often constant.
LEAST_UNIT = 0.1
#: Smallest mean square of the distances on the training drives.
LEAST_SQUARE = 1e-24
#: Tolerance of the range: share of the largest input, and deviations of its noise.
SLACK, NOISES = 0.01, 3.0
#: Seconds between two flagged samples up to which they form one time range, and ranges that a message names.
GAP, NAMED = 0.5, 4


class Gated(NamedTuple):
    """Claimed deviation (rad) of an estimate after the gates, and why it is wider.

    `contradicted` and `outside` flag the samples that kinematics contradicts and whose inputs are
    outside of the training range. `messages` has one sentence per gate that widened a deviation, with
    the time ranges.
    """

    deviation: Floats
    contradicted: NDArray[np.bool_]
    outside: NDArray[np.bool_]
    messages: tuple[str, ...]


def apply_gates(
    problem: SideslipEstimation, sideslip: Floats, deviation: Floats, spread: float = 0.0, *,
    history: bool = False,
) -> Gated:  # fmt: skip
    """Return the deviation (rad) that an estimate may claim, and why it is wider. The model's truth is not read.

    `spread` is the deviation (rad) of the angles, or of the errors of a filter, that were learned. With
    0 nothing was learned and the training range is not compared. If `history`, recent inputs are
    compared too; `deviation` accounts for them otherwise.
    """
    drive = problem.recording
    learned = spread > 0.0 and bool(problem.training)
    reference = calibrate_reference(problem, deviation) if learned else problem
    difference = find_contradictions(reference, sideslip, deviation)
    contradicted = difference != 0.0
    variance = deviation**2 + difference**2
    outside = np.zeros(len(drive), dtype=bool)
    messages = []
    if contradicted.any():
        largest = math.degrees(float(np.abs(difference).max()))
        messages.append(
            f"kinematics contradicts the angle at {time_ranges(drive, contradicted)} by up to {largest:.2g}°: "
            "deviations are wider there"
        )
    if learned:
        distance, names = measure_training_distance(problem)
        recent = measure_history_distance(problem) if history else np.zeros(len(drive))
        if ((recent > 0.0) & (distance == 0.0)).any() and COMBINED not in names:
            names = *names, COMBINED
        outside = (distance > 0.0) | (recent > 0.0)
        # Both the deviation so far and the recent inputs estimate the same error: the larger one counts.
        variance = np.maximum(variance + (distance * spread) ** 2, (recent * spread) ** 2)
        if outside.any():
            share = float(outside.sum() / drive.moving.sum())
            messages.append(
                f"{100 * share:.2g} % of the samples are outside of the training range of {', '.join(names)}, at "
                f"{time_ranges(drive, outside)}: deviations are wider there"
            )
    wider = np.minimum(np.sqrt(variance), np.hypot(UNKNOWN, sideslip))
    wider = np.where(variance > deviation**2, wider, deviation)
    return Gated(wider, contradicted, outside, tuple(messages))


def small_angle_error(problem: SideslipEstimation) -> Floats:
    """Return the error (rad) of small angles in the model: without slip at the rear axle the angle is arctan(b ω / u)."""
    drive = problem.recording
    turn = problem.vehicle.rear * drive.yaw_rate / np.where(drive.moving, drive.speed, np.inf)
    return np.asarray(turn - np.arctan(turn))


def time_ranges(drive: Recording, flags: NDArray[np.bool_]) -> str:
    """Return the time ranges of flagged samples as text, such as ``"3.2-4.5 s, 7 s"``.

    Ranges that are at most 0.5 s apart are joined. The longest ranges are named, in order of time.
    """
    spans = np.array(intervals(drive.times, flags, GAP))
    longest = np.sort(np.argsort(spans[:, 0] - spans[:, 1], kind="stable")[:NAMED])
    parts = [
        f"{begin:.6g} s" if begin == end else f"{begin:.6g}-{end:.6g} s"
        for begin, end in spans[longest].tolist()
    ]
    more = len(spans) - len(parts)
    return ", ".join(parts) + (f" and {more} more" if more else "")


def intervals(
    times: Floats, flags: NDArray[np.bool_], gap: float
) -> tuple[tuple[float, float], ...]:
    """Return first and last time (s) of each group of flagged samples that are at most `gap` seconds apart."""
    places = np.flatnonzero(flags)
    cuts = np.flatnonzero(np.diff(times[places]) > gap)
    first, last = times[places[np.r_[0, cuts + 1]]], times[places[np.r_[cuts, -1]]]
    return tuple(zip(first.tolist(), last.tolist(), strict=True))


# -- kinematics ----------------------------------------------------------------------------------


def calibrate_reference(problem: SideslipEstimation, deviation: Floats) -> SideslipEstimation:
    """Return the model with noises at which kinematics does not contradict the known angles of the training drives.

    Real sensors have noise, and real roads a bank, that the model does not declare: kinematics then contradicts even the
    measured angle. The factor on the declared noises is 1 if it contradicts at most 1 % of the known angles, and otherwise
    the one after the smallest sufficient factor of :data:`FACTORS`, because the estimated drive may be on another road.
    """
    drives = [(replace(drive, sideslip=None), drive.sideslip) for drive in problem.training]
    claim = 0.5 * float(np.median(deviation[problem.recording.moving]))
    most = TOLERATED * sum(len(drive) for drive in problem.training)

    def scaled(factor: float) -> SideslipEstimation:
        return replace(
            problem, training=(), truth=None, disturbance=factor * problem.disturbance,
            yaw_rate_noise=factor * problem.yaw_rate_noise,
            acceleration_noise=factor * problem.acceleration_noise,
        )  # fmt: skip

    def flagged(model: SideslipEstimation) -> int:
        found = (
            find_contradictions(replace(model, recording=drive), angle, np.full(len(angle), claim))
            for drive, angle in drives
            if angle is not None
        )
        return sum(int(np.count_nonzero(differences)) for differences in found)

    enough = (k for k, factor in enumerate(FACTORS) if flagged(scaled(factor)) <= most)
    first = next(enough, len(FACTORS))
    return scaled(FACTORS[min(first + 1, len(FACTORS) - 1) if first else 0])


def find_contradictions(problem: SideslipEstimation, sideslip: Floats, deviation: Floats) -> Floats:
    """Return the difference (rad) of the angle from its kinematic reference if it is a contradiction, else 0.

    The reference of a sample uses that sample and earlier ones, without a halt in between.
    """
    drive = problem.recording
    track = new_track(len(drive), noise_of(problem))
    gate_path(
        drive.times, drive.speed, drive.yaw_rate, drive.lateral_acceleration,
        np.ascontiguousarray(sideslip, dtype=float), np.ascontiguousarray(deviation, dtype=float), track,
    )  # fmt: skip
    return np.asarray(track.differences)


Track = namedtuple(
    "Track",
    "times moving angle claim change noise lacking bias begins origin differences rate variance size state counts "
    "sensors",
)
Track.__doc__ = """State of the kinematic gate, with one entry per sample in the arrays up to `size`.

`change`, `noise` and `lacking` are sums up to each sample: the measured change of the angle, its variance, and the neglected
braking term. `bias` is the variance of the bias of the rate before the drive. `begins`, shape (n, w), has the first sample of
each window, `origin` the starting point of each sample's reference, and `differences` those that are contradictions (rad).
`counts` has the number of samples, the first one after the last halt, and the first one of each window; `sensors` the
variances of yaw rate, acceleration and disturbance of the angle per second, and the distance of the rear axle (m), which is 0
if claims include the error of small angles.
"""


def noise_of(problem: SideslipEstimation) -> Floats:
    """Return the `sensors` of a :class:`Track` without the distance of the rear axle."""
    return np.square([*problem.sensor_noises, problem.disturbance[0], 0.0])


def new_track(room: int, sensors: Floats) -> Track:
    """Return the state before the first of at most `room` samples."""
    columns: list[Any] = [np.zeros(room) for _ in range(11)]
    columns[1:1] = [np.zeros(room, bool)]
    columns[8:8] = [np.zeros((room, len(WINDOWS)), int), np.zeros(room, int)]
    return Track._make([*columns, np.zeros(6), np.zeros(2 + len(WINDOWS), int), sensors])


@kernel(interpretable=True, allocates=False)
def gate_path(
    times: Floats, speed: Floats, yaw_rate: Floats, acceleration: Floats, angle: Floats, claim: Floats,
    track: Track,
) -> None:  # fmt: skip
    """Fill the `differences` of a track for all samples of a drive."""
    for j in range(len(track.counts)):
        track.counts[j] = 0
    for k in range(len(times)):
        gate_sample(times[k], speed[k], yaw_rate[k], acceleration[k], angle[k], claim[k], track)


@kernel(allocates=False)
def gate_sample(
    time: float, speed: float, yaw_rate: float, acceleration: float, angle: float, claim: float,
    track: Track,
) -> tuple[float, float, float]:  # fmt: skip
    """Return the angle of an estimate at a new sample, its deviation after the kinematic gate, and the contradiction (rad).

    Samples without both measurements are treated as halts: windows do not contain them.
    """
    if abs(angle) < math.inf and claim < math.inf:
        angle, claim = min(max(angle, -0.5 * math.pi), 0.5 * math.pi), min(claim, UNKNOWN)
    else:
        angle, claim = 0.0, UNKNOWN
    counts, sensors = track.counts, track.sensors
    k = counts[0]
    moving = speed >= LOW_SPEED and not math.isnan(acceleration + yaw_rate)
    inverse, rate = 0.0, 0.0 if math.isnan(yaw_rate) else -yaw_rate
    if moving:
        inverse, rate = 1.0 / speed, acceleration / speed - yaw_rate
        turn = sensors[3] * yaw_rate * inverse
        claim = min(math.hypot(claim, turn - math.atan(turn)), UNKNOWN)
    track.times[k], track.moving[k], track.angle[k], track.claim[k] = time, moving, angle, claim
    track.rate[k] = rate
    track.variance[k] = sensors[0] + sensors[1] * inverse * inverse
    track.size[k] = math.log(speed) if moving else 0.0
    track.bias[k] = BIASES[0] * BIASES[0] + BIASES[1] * inverse * (BIASES[1] * inverse)
    track.change[k] = track.noise[k] = track.lacking[k] = track.differences[k] = 0.0
    track.origin[k] = k
    if k:
        dt, j = time - track.times[k - 1], k - 1
        track.change[k] = track.change[j] + 0.5 * (rate + track.rate[j]) * dt
        noise = 0.5 * (track.variance[k] + track.variance[j]) * (dt * dt) + sensors[2] * dt
        bend = (rate - track.rate[j]) * dt
        track.noise[k] = track.noise[j] + (noise + bend * bend / 12.0)
        braking = abs(track.size[k] - track.size[j])
        track.lacking[k] = track.lacking[j] + braking * 0.5 * abs(angle + track.angle[j])
    if not moving:
        counts[1] = k + 1
    for j in range(len(WINDOWS)):
        begin = time - WINDOWS[j] * (1 + 1e-9)
        while track.times[counts[2 + j]] < begin:
            counts[2 + j] += 1
        track.begins[k, j] = counts[2 + j] if counts[2 + j] >= counts[1] else k
    compare_sample(k, track)
    counts[0] = k + 1
    apart = track.differences[k]
    deviation = claim
    if apart != 0.0:
        deviation = min(math.sqrt(claim * claim + apart * apart), math.hypot(UNKNOWN, angle))
    return angle, deviation if speed >= LOW_SPEED else UNKNOWN, apart


@kernel(allocates=False)
def compare_sample(k: int, track: Track) -> None:
    """Compare sample `k` of a track with its references, and update `differences`, `origin` and `state` of the track."""
    times, claim, change, noise = track.times, track.claim, track.change, track.noise
    angle, origin, begins, state = track.angle, track.origin, track.begins, track.state
    limit = THRESHOLD * THRESHOLD
    opened, rate, variance, last, start, doubt = False, 0.0, math.inf, -1, 0, -math.inf
    if k > 0:
        opened, rate, variance, doubt = state[0] != 0.0, state[1], state[2], state[5]
        last, start = int(state[3]), int(state[4])
    if not track.moving[k]:
        last, opened = -1, False
    else:
        variance = min(variance, track.bias[k])
        worst, reason, reach = CLOSING * CLOSING if opened else limit, k, 0.0
        least, nearest = claim[k] * claim[k], k
        for j in range(begins.shape[1]):
            if begins[k, j] < start:
                continue
            i = origin[begins[k, j]]
            if i >= k:
                continue
            span = times[k] - times[i]
            short = track.lacking[k] - track.lacking[i]
            allowed = claim[i] * claim[i] + noise[k] - noise[i] + short * short
            allowed += variance * span * span
            apart = angle[k] - angle[i] - (change[k] - change[i]) - rate * span
            rest = max(abs(apart) - CLAIMED * claim[k], 0.0)
            if rest * rest > worst * allowed:
                worst, reason, reach = rest * rest / allowed, i, allowed
                track.differences[k] = apart
            if allowed < least:
                least, nearest = allowed, i
        if reason < k:
            i = begins[k, RATE]
            span = times[k] - times[i]
            apart = angle[k] - angle[i] - (change[k] - change[i])
            allowed = 2.0 * claim[reason] * claim[reason] + noise[k] - noise[i]
            if not opened or apart * apart > limit * (allowed + track.bias[k] * span * span):
                doubt = times[k]
            span = times[k] - times[reason]
            rest = max(abs(track.differences[k]) - CLAIMED * claim[k], 0.0)
            if times[k] - doubt >= HOLD and rest * rest <= limit * (
                reach + track.bias[k] * span * span
            ):
                track.differences[k], start, variance, rate = 0.0, k, track.bias[k], 0.0
                reason, nearest = k, k
        opened = reason < k
        origin[k] = reason if opened else nearest
        if opened:
            last = -1
        elif last < 0:
            last = k
        elif times[k] - times[last] >= UPDATE:
            span = times[k] - times[last]
            seen = (angle[k] - angle[last] - (change[k] - change[last])) / span
            spread = claim[k] * claim[k] + claim[last] * claim[last] + noise[k] - noise[last]
            spread /= span * span
            gain = variance / (variance + spread)
            rate += gain * (seen - rate)
            variance = max(variance * (1.0 - gain), LEAST_BIAS * LEAST_BIAS)
            last = k
    state[0], state[1], state[2] = 1.0 if opened else 0.0, rate, variance
    state[3], state[4], state[5] = last, start, doubt


# -- the range of the training drives ----------------------------------------------------------------


def measure_training_distance(problem: SideslipEstimation) -> tuple[Floats, tuple[str, ...]]:
    """Return the distance of each sample from the range of the training drives, and the inputs that leave it.

    Inputs are speed, steering angle, yaw rate and lateral acceleration, each divided by its deviation on
    the training drives. The range is that of each input and that of each principal component, which
    finds combinations that the training drives do not have, such as a large steering angle without a yaw
    rate. The distance is the larger of both, in deviations; it is 0 inside of the range and below 1 m/s.
    The names are ``"combinations of inputs"`` if only principal components leave the range.
    """
    drive = problem.recording
    moving = [entry.moving for entry in problem.training]
    known = np.vstack(
        [
            np.column_stack([getattr(entry, name)[on] for name in INPUTS])
            for entry, on in zip(problem.training, moving, strict=True)
        ]
    )
    here = np.column_stack([getattr(drive, name) for name in INPUTS])
    noise = np.array([0.0, 0.0, problem.yaw_rate_noise, problem.acceleration_noise])
    size = np.maximum(known.std(axis=0), LEAST_UNIT * np.abs(known).max(axis=0))
    size = np.where(size > 0.0, size, 1.0)
    middle = known.mean(axis=0)
    known, here, noise = (known - middle) / size, (here - middle) / size, noise / size
    slack = NOISES * noise + SLACK * np.abs(known).max(axis=0)
    beyond = _beyond(known, here, slack)
    beyond[~drive.moving] = 0.0
    axes = np.linalg.svd(known.T @ known / len(known))[0]
    spread = np.maximum((known @ axes).std(axis=0), LEAST_UNIT)
    slack = NOISES * np.sqrt((axes.T**2) @ noise**2) + SLACK * np.abs(known @ axes).max(axis=0)
    across = _beyond(known @ axes, here @ axes, slack) / spread
    across[~drive.moving] = 0.0
    distance = np.maximum(np.linalg.norm(beyond, axis=1), np.linalg.norm(across, axis=1))
    names = tuple(name for name, far in zip(INPUTS, beyond.T, strict=True) if far.any())
    return distance, names or (COMBINED,)


def measure_history_distance(problem: SideslipEstimation) -> Floats:
    """Return the standardised distance of each sample's recent inputs from those of the training drives.

    The recent inputs are those of the sample and of the four periods before it. Their Mahalanobis
    distance M is in units of the root mean square distance on the training drives, with q as the largest
    one there. The result is ``√(M² - q²)`` beyond q, and 0 otherwise and below 1 m/s. A linear function
    of the recent inputs with the deviation σ over the training drives changes by ``σ √(M² - q²)`` in the
    root mean square over all directions of the excess. The tolerances of the inputs' ranges are added to
    the covariance as noise.
    """
    window = Window(float(np.median([drive.period for drive in problem.training])))
    known = training_set(problem.training, window).features
    here = window.features(problem.recording)
    middle, largest = known.mean(axis=0), np.abs(known).max(axis=0)
    largest = np.where(largest > 0.0, largest, 1.0)
    noise = np.repeat([problem.yaw_rate_noise, problem.acceleration_noise, 0.0, 0.0], window.lags)
    known, here = (known - middle) / largest, (here - middle) / largest
    tolerance = SLACK**2 + (noise / largest) ** 2
    inverse = np.linalg.inv(known.T @ known / len(known) + np.diag(tolerance))
    usual, squares = (np.einsum("ij,jk,ik->i", part, inverse, part) for part in (known, here))
    beyond = np.where(problem.recording.moving, squares - usual.max(), 0.0)
    # Equal inputs in training have no spread: another input is then as far as it can be.
    distance: Floats = np.sqrt(np.maximum(beyond, 0.0) / max(float(usual.mean()), LEAST_SQUARE))
    return distance


def _beyond(known: Floats, here: Floats, slack: Floats) -> Floats:
    """Return the distance from the range of each column."""
    low, high = known.min(axis=0) - slack, known.max(axis=0) + slack
    distance: Floats = np.maximum(np.maximum(low - here, here - high), 0.0)
    return distance
