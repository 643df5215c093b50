"""Identification of a vehicle's parameters from drives with a known angle.

The prediction errors of a Kalman filter that also measures the angle are minimised by nonlinear least squares
(L. Ljung, System Identification, 2nd edition, 1999, section 7.2). Its gains are those of the former estimate:
with gains that depend on the parameters, larger errors could be bought with larger predicted errors. If the errors
exceed twice the declared noise, a second search starts from typical values, and the more likely result is returned.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, suggestion
from ...jit import kernel
from ..estimates import Estimate
from ..fields import Real, required
from .data import UNKNOWN, Recording, Tyre, Vehicle
from .dynamics import advance, congruence, measured, parameters
from .model import SideslipEstimation

__all__ = ["BIASES", "Identification", "identify"]

Floats = NDArray[np.float64]

#: Parameters of a vehicle that can be estimated, all > 0.
FIELDS = (
    "mass", "yaw_inertia", "front", "rear", "cornering_front", "cornering_rear", "friction",
)  # fmt: skip
#: Constant errors of inputs and sensors that can be estimated, with their units: rad, rad/s and m/s².
BIASES = {
    "steering_bias": 0.05, "sideslip_bias": 0.05, "yaw_rate_bias": 0.05,
    "lateral_acceleration_bias": 0.5,
}  # fmt: skip
#: Deviation of the logarithm of a parameter, or of a bias in its unit, before the drives.
PRIOR = 10.0
#: Deviation of the same after the drives, above which the parameter is not determined.
LOOSE = 0.5
#: Rounds of least squares, and the change that ends them: of a parameter in deviations, and of the variance of a noise
#: relative to that of the prediction error.
ROUNDS, SETTLED = 20, 0.05
#: Noise of the known angles (rad) in the first round, and the least factor on a variance in a round; its square bounds
#: the factor of all rounds.
ANGLE_NOISE, LEAST = 0.001, 0.01
#: Stiffnesses, and their typical ratio to the static load (1/rad).
STIFFNESSES, STIFFNESS = ("cornering_front", "cornering_rear"), 10.0
#: Largest logarithm of the ratio of an estimate to its start, and largest prediction error.
MOST, MOST_ERROR = 20.0, 1e9
#: Time (s) over which prediction errors may be correlated, and the parts per parameter for their covariance.
BLOCK, PARTS = 2.0, 5


@dataclass(frozen=True, eq=False)
class Identification(Estimate):
    """Identified parameters of a vehicle with their covariance.

    Parameters
    ----------
    vehicle : Vehicle
        The vehicle with the estimates.
    undetermined : tuple of str
        Parameters with a relative deviation above 0.5, and biases with one above 0.025 rad, 0.025 rad/s or
        0.25 m/s². Their values depend on the vehicle before the identification; `correlations` names the
        parameters that can replace them. All parameters, if the search did not converge in 20 rounds or
        `freedom` is below 1.
    noise : ndarray, shape (3,)
        Deviations of the noise of angle (rad), yaw rate (rad/s) and lateral acceleration (m/s²) that
        explain the prediction errors. The covariance assumes that the tyre law is right; with a wrong law
        the truth may be many deviations away, although the noise exceeds the declared one little.
    """

    vehicle: Vehicle
    undetermined: tuple[str, ...]
    noise: Floats

    def __str__(self) -> str:
        """Return the estimates, ± one standard deviation, and the parameters that are not determined."""
        text = super().__str__()
        for name in self.undetermined:
            row = np.abs(self.correlations[self.names.index(name)])
            row[self.names.index(name)] = 0.0
            text += f"; {name} is not determined"
            if row.max(initial=0.0) > 0.9:
                text += f" (correlation {row.max():.3f} with {self.names[int(row.argmax())]})"
        return text


@np.errstate(all="ignore")  # prediction errors that overflow are bounded
def identify(
    model: SideslipEstimation, names: Sequence[str] | None = None, *,
    prior: Mapping[str, float] | None = None,
) -> Identification:  # fmt: skip
    """Return parameters of the vehicle of `model`, estimated from its training drives, with covariance.

    These sensors measure no force: with linear tyres, mass, yaw inertia and both stiffnesses are
    determined up to a common factor only. One of them must be known, or have a `prior`.

    Parameters
    ----------
    model : SideslipEstimation
        Model with training drives, the vehicle to start from, its tyre law, disturbance and noise.
    names : sequence of str, optional
        Fields of :class:`Vehicle`, and constant errors of the training drives: ``"steering_bias"``,
        ``"sideslip_bias"``, ``"yaw_rate_bias"`` and ``"lateral_acceleration_bias"``. By default both
        cornering stiffnesses, the yaw inertia and, unless tyres are linear, the friction.
    prior : mapping of str to float, optional
        Relative standard deviations of parameters of the vehicle that are known beforehand, such as
        ``{"mass": 0.02}``.

    Returns
    -------
    Identification
        Estimates, covariance, vehicle, and the parameters that the drives do not determine.

    Raises
    ------
    InvalidData
        The model has no training drives, a name is unknown or repeated, or a value is not allowed.
    """
    required("model", model, SideslipEstimation)
    if not model.training:
        raise InvalidData(
            "training must hold at least one drive with a known angle", field="training"
        )
    start = model.vehicle
    chosen = _checked(names, start)
    known = required("prior", {} if prior is None else prior, Mapping)  # type: ignore[type-abstract]
    known = {name: Real(0, strict=True).coerce(f"prior[{name}]", value, {})
             for name, value in known.items()}  # fmt: skip
    for name in known:
        if name not in chosen or name in BIASES:
            raise InvalidData(f"prior names {name!r}, which is not estimated", field="prior")
    loose = np.array([known.get(name, PRIOR) for name in chosen])
    units = np.array([BIASES.get(name, getattr(start, name, 1.0)) for name in chosen])
    bias = np.array([name in BIASES for name in chosen])
    noise = np.square(
        [*model.disturbance, ANGLE_NOISE, model.yaw_rate_noise, model.acceleration_noise]
    )
    tracks = [Track(drive, noise) for drive in model.training]

    def values_at(x: Floats) -> Floats:
        result: Floats = units * np.where(bias, x, np.exp(np.clip(x, -MOST, MOST)))
        return result

    def errors_at(x: Floats, *, gains: bool = False) -> Floats:
        values: dict[str, Any] = dict(zip(chosen, values_at(x).tolist(), strict=True))
        shifts = [values.pop(name, 0.0) for name in BIASES]
        p = parameters(dataclasses.replace(start, **values))
        return np.concatenate([track.errors(p, shifts, gains=gains) for track in tracks])

    from scipy.optimize import least_squares

    blocks = np.concatenate([track.blocks + 1000000 * k for k, track in enumerate(tracks)])
    declared = noise[2:].copy()
    used = np.concatenate([drive.moving for drive in model.training])
    # The two initial states of each drive are free.
    freedom = 3 * int(np.count_nonzero(used)) - 2 * len(tracks) - len(chosen)

    def residuals(x: Floats) -> Floats:
        rest = np.clip(np.nan_to_num(errors_at(x), nan=MOST_ERROR), -MOST_ERROR, MOST_ERROR)
        return np.concatenate([rest.ravel(), x / loose])

    def search(x: Floats) -> tuple[Any, ...]:
        """Return the cost of the result, whether it converged, the result, and the noise that explains the errors."""
        noise[2:], settled, loss = declared, False, math.inf
        for _ in range(ROUNDS):
            errors_at(x, gains=True)
            spread = np.concatenate([track.spread for track in tracks])[used]
            result = least_squares(residuals, x, jac="3-point", x_scale=np.minimum(loose, 1.0))
            slopes, rest = result.jac[: 3 * len(used)], result.fun[: 3 * len(used)]
            inverse = np.linalg.inv(slopes.T @ slopes + np.diag(loose**-2.0))
            moved = np.abs(result.x - x) / np.sqrt(np.diag(inverse))
            x, errors = result.x, rest.reshape(-1, 3)[used]
            loss = float(np.sum(np.log(spread) + errors**2))
            # The noise that explains the size of the errors, per degree of freedom.
            size = np.median(spread, axis=0)
            excess = size * (np.mean(errors**2, axis=0) * errors.size / max(freedom, 1) - 1.0)
            better = np.maximum(
                noise[2:] + 0.5 * excess, LEAST * np.maximum(noise[2:], LEAST * declared)
            )
            settled = moved.max() < SETTLED and bool(
                np.all(np.abs(better - noise[2:]) < SETTLED * size)
            )
            if settled:
                break
            noise[2:] = better
        return loss, settled, x, slopes, rest, errors, inverse, noise[2:].copy()

    best = search(np.zeros(len(chosen)))
    if not best[1] or np.any(best[-1][1:] > 4.0 * declared[1:]):
        # The errors may be those of a wrong minimum: search from typical values, too.
        typical = dict(zip(STIFFNESSES, STIFFNESS * np.array(start.loads), strict=True))
        typical.update(yaw_inertia=start.mass * start.front * start.rear, friction=1.0)
        ratios = [typical.get(name, 1.0) / unit for name, unit in zip(chosen, units, strict=True)]
        free = ~bias & (loose == PRIOR) & np.isin(chosen, [*typical])
        best = min(best, search(np.log(np.where(free, ratios, 1.0))), key=lambda found: found[0])
    _, settled, x, slopes, rest, errors, inverse, level = best
    deviations, shape = np.sqrt(np.diag(inverse)), inverse
    parts = np.unique(blocks, return_inverse=True)[1]
    if parts.max() + 1 >= PARTS * len(chosen):
        # Errors may be correlated within a part of a drive (H. White, Econometrica 48, 1980).
        sums = np.zeros((parts.max() + 1, len(chosen)))
        np.add.at(sums, np.repeat(parts, 3), slopes * rest[:, None])
        shape = inverse @ (sums.T @ sums + np.diag(loose**-2.0)) @ inverse
        deviations = np.maximum(deviations, np.sqrt(np.diag(shape)))
    vague = not settled or freedom < 1
    scale = deviations / np.sqrt(np.diag(shape))
    values = values_at(x)
    factors = np.where(bias, units, values)
    fitted: dict[str, Any] = {
        name: float(value) for name, value in zip(chosen, values, strict=True) if name not in BIASES
    }
    return Identification(
        names=chosen, values=values, covariance=shape * np.outer(scale * factors, scale * factors),
        variance=float(np.sum(errors**2)) / max(freedom, 1), freedom=freedom,
        vehicle=dataclasses.replace(start, **fitted),
        undetermined=tuple(np.array(chosen)[~(deviations <= LOOSE) | vague].tolist()),
        noise=np.sqrt(level),
    )  # fmt: skip


def _checked(names: Any, vehicle: Vehicle) -> tuple[str, ...]:
    """Return the names of the parameters to estimate, or raise if one is unknown or repeated."""
    if names is None:
        friction = () if vehicle.tyre is Tyre.LINEAR else ("friction",)
        return "cornering_front", "cornering_rear", "yaw_inertia", *friction
    allowed = [*FIELDS, *BIASES]
    chosen = (names,) if isinstance(names, str) or not isinstance(names, Sequence) else tuple(names)
    for k, name in enumerate(chosen):
        if name not in allowed:
            raise InvalidData(
                f"names[{k}] must be one of {', '.join(allowed)}, got {name!r}; "
                f"{suggestion(str(name), allowed)}".rstrip("; "),
                field="names",
            )
    if not chosen or len(set(chosen)) < len(chosen):
        raise InvalidData("names must be different parameters, at least one", field="names")
    return chosen


class Track:
    """Prediction errors along one drive, of the variances `noise` per second and of the measurements."""

    def __init__(self, drive: Recording, noise: Floats) -> None:
        self.drive, self.noise = drive, noise
        n = len(drive)
        angles: Any = drive.sideslip
        self.data = np.column_stack([angles, drive.yaw_rate, drive.lateral_acceleration])
        self.gains, self.spread = np.zeros((n, 3, 2)), np.ones((n, 3))
        self.blocks = np.floor((drive.times - drive.times[0]) / BLOCK).astype(np.int64)

    def errors(self, p: Floats, shifts: list[float], *, gains: bool = False) -> Floats:
        """Return the prediction errors in predicted deviations, shape (n, 3); renew the gains if `gains`."""
        drive, errors = self.drive, np.zeros_like(self.data)
        predict_path(
            drive.times, drive.speed, drive.steering - shifts[0], self.data - shifts[1:],
            drive.moving, p, self.noise, gains, self.gains, self.spread, errors,
        )  # fmt: skip
        return errors


@kernel
def predict_path(
    times: Floats, speed: Floats, steering: Floats, data: Floats, usable: NDArray[np.bool_],
    p: Floats, noise: Floats, renew: bool, gains: Floats, spread: Floats, errors: Floats,
) -> None:  # fmt: skip
    """Run an extended Kalman filter that measures angle, yaw rate and acceleration one after the other.

    If `renew`, `gains`, shape (n, 3, 2), and the variances `spread` of the errors are computed;
    otherwise they are used.
    """
    x, y, a, b, c = 0.0, 0.0, UNKNOWN * UNKNOWN, 0.0, 1.0
    for k in range(len(times)):
        for j in range(3 if usable[k] else 0):
            value, g, h = x, 1.0, 0.0
            if j == 1:
                value, g, h = y, 0.0, 1.0
            elif j == 2:
                value, g, h = measured(x, y, speed[k], steering[k], p)
            if renew:
                d, e = a * g + b * h, b * g + c * h
                s = g * d + h * e + noise[2 + j]
                spread[k, j], gains[k, j, 0], gains[k, j, 1] = s, d / s, e / s
                a, b, c = a - d * d / s, b - d * e / s, c - e * e / s
            v = data[k, j] - value
            errors[k, j] = v / spread[k, j] ** 0.5
            x += gains[k, j, 0] * v
            y += gains[k, j, 1] * v
        if k + 1 < len(times):
            dt = times[k + 1] - times[k]
            x, y, q, r, s, t = advance(
                x, y, dt, speed[k], speed[k + 1] - speed[k], steering[k],
                steering[k + 1] - steering[k], p,
            )  # fmt: skip
            if renew:
                a, b, c = congruence(q, r, s, t, a, b, c)
                a, c = a + noise[0] * dt, c + noise[1] * dt
