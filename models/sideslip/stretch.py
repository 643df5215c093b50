"""Consecutive samples with their linearised model, and the deviation of the angle given them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .dynamics import Linearised
from .model import SideslipEstimation

__all__ = ["Stretch"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Stretch:
    """Consecutive samples with linearised model, measurements and noise.

    `measured`, shape (n, 2), are yaw rate (rad/s) and lateral acceleration (m/s²) with the deviations
    `noise`, and `used` marks the samples whose measurements are used. `disturbance`, shape (n - 1, 2),
    are the deviations of the noise added to the state between samples. `mean` is the expected state at
    the first sample, before its measurement, and `root` the lower Cholesky factor of its covariance.
    """

    linear: Linearised
    measured: Floats
    used: NDArray[np.bool_]
    noise: Floats
    disturbance: Floats
    mean: Floats
    root: Floats

    @classmethod
    def of(cls, model: SideslipEstimation, linear: Linearised) -> Stretch:
        """Return the stretch of all samples of `model` with their linearised model."""
        drive = model.recording
        return cls(
            linear, np.stack([drive.yaw_rate, drive.lateral_acceleration], axis=1), drive.moving,
            np.array([model.yaw_rate_noise, model.acceleration_noise]),
            model.disturbance * np.sqrt(np.diff(drive.times))[:, None], model.initial,
            np.diag(model.initial_deviation),
        )  # fmt: skip

    def part(
        self, first: int, last: int, mean: Floats, root: Floats, linear: Linearised | None = None
    ) -> Stretch:
        """Return the samples `first` … `last`, both included, with a new prior and, optionally, a new model.

        `mean` and `root` are the expected state at the first sample and the lower Cholesky factor of its
        covariance.
        """
        step, shift, slope, level = self.linear
        if linear is None:
            linear = Linearised(
                step[first:last], shift[first:last], slope[first : last + 1],
                level[first : last + 1],
            )  # fmt: skip
        return Stretch(
            linear, self.measured[first : last + 1], self.used[first : last + 1], self.noise,
            self.disturbance[first:last], mean, root,
        )  # fmt: skip

    @property
    def count(self) -> int:
        """Number of samples."""
        return len(self.measured)

    @cached_property
    def scale(self) -> Floats:
        """Unit of the state columns (rad, rad/s): the median disturbance, shape (2,)."""
        usual = np.median(self.disturbance, axis=0) if len(self.disturbance) else np.diag(self.root)
        return np.asarray(usual)

    @cached_property
    def deviations(self) -> Floats:
        """Standard deviation of the angle at each sample given all measurements, rad, shape (n,).

        The covariance given earlier samples is combined with the information from later ones: the two-filter
        form of a smoother (Fraser and Potter 1969).
        """
        step, _, slope, _ = self.linear
        seen = np.swapaxes(slope / self.noise[:, None], 1, 2) @ (slope / self.noise[:, None])
        seen[~self.used] = 0.0
        eye = np.eye(2)
        before = np.empty((self.count, 2, 2))
        covariance = self.root @ self.root.T
        for k in range(self.count):
            # (P⁻¹ + S)⁻¹ without inverting P, which may be nearly singular.
            before[k] = np.linalg.solve(eye + covariance @ seen[k], covariance)
            if k < self.count - 1:
                covariance = step[k] @ before[k] @ step[k].T + np.diag(self.disturbance[k] ** 2)
        after = np.zeros((2, 2))
        result = np.empty(self.count)
        for k in range(self.count - 1, -1, -1):
            result[k] = np.linalg.solve(eye + before[k] @ after, before[k])[0, 0]
            if k:
                after = after + seen[k]
                spread = np.diag(self.disturbance[k - 1] ** 2)
                after = step[k - 1].T @ after @ np.linalg.solve(eye + spread @ after, step[k - 1])
        return np.sqrt(np.maximum(result, 0.0))
