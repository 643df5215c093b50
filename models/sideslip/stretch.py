"""Samples in a row with the linear model at each, and what is known of the angle from them."""

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
    """Terms of consecutive samples.

    Parameters
    ----------
    linear : Linearised
        The model at each of them.
    measured : ndarray, shape (n, 2)
        Yaw rate and lateral acceleration.
    used : ndarray of bool, shape (n,)
        Whether what was measured counts.
    noise : ndarray, shape (2,)
        Deviation of what was measured.
    disturbance : ndarray, shape (n - 1, 2)
        Deviation of what is added to the state after each sample but the last.
    mean : ndarray, shape (2,)
        The state expected at the first sample, before what was measured there.
    root : ndarray, shape (2, 2)
        The lower Cholesky factor of its covariance.
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
        """Return all samples of a model."""
        drive = model.recording
        return cls(
            linear,
            np.stack([drive.yaw_rate, drive.lateral_acceleration], axis=1),
            drive.moving,
            np.array([model.yaw_rate_noise, model.acceleration_noise]),
            model.disturbance * np.sqrt(np.diff(drive.times))[:, None],
            model.initial,
            np.diag(model.initial_deviation),
        )

    def part(
        self, first: int, last: int, mean: Floats, root: Floats, linear: Linearised | None = None
    ) -> Stretch:
        """Return the samples `first` … `last` with another expectation at the first, `linear` where given."""
        step, shift, slope, level = self.linear
        if linear is None:
            linear = Linearised(
                step[first:last],
                shift[first:last],
                slope[first : last + 1],
                level[first : last + 1],
            )
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
        """Unit of the state's columns, rad and rad/s: a typical disturbance."""
        usual = np.median(self.disturbance, axis=0) if len(self.disturbance) else np.diag(self.root)
        return np.asarray(usual)

    @cached_property
    def deviations(self) -> Floats:
        """Deviation of the angle at each sample, given what was measured at all, rad, shape (n,).

        The covariance given what came before, and the information from what comes after (the two-filter form of a
        smoother, Fraser and Potter 1969).
        """
        step, _, slope, _ = self.linear
        seen = np.swapaxes(slope / self.noise[:, None], 1, 2) @ (slope / self.noise[:, None])
        seen[~self.used] = 0.0
        eye = np.eye(2)
        before = np.empty((self.count, 2, 2))
        covariance = self.root @ self.root.T
        for k in range(self.count):
            # (P⁻¹ + S)⁻¹ without the inverse of what may be nearly singular.
            before[k] = np.linalg.solve(eye + covariance @ seen[k], covariance)
            if k < self.count - 1:
                covariance = step[k] @ before[k] @ step[k].T + np.diag(self.disturbance[k] ** 2)
        after = np.zeros((2, 2))
        found = np.empty(self.count)
        for k in range(self.count - 1, -1, -1):
            found[k] = np.linalg.solve(eye + before[k] @ after, before[k])[0, 0]
            if k:
                after = after + seen[k]
                spread = np.diag(self.disturbance[k - 1] ** 2)
                after = step[k - 1].T @ after @ np.linalg.solve(eye + spread @ after, step[k - 1])
        return np.sqrt(np.maximum(found, 0.0))
