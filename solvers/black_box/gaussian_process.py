"""Gaussian process of a black box: a quadratic trend plus a Matérn 5/2 kernel with one length per variable."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, lapack
from scipy.spatial.distance import cdist

__all__ = ["GaussianProcess"]

Floats = NDArray[np.float64]

#: Lower bound, upper bound, mean and standard deviation of the logarithm of a length, of the variances (Matérn,
#: quadratic) and of the noise; the priors are normal.
_LENGTH = (-3.0, 4.6, 0.7, 1.5)
_OTHERS = ((-14.0, 4.0, -1.0, 2.0), (-16.0, 8.0, 0.0, 3.0), (-21.0, -2.0, -14.0, 4.0))
_SQRT5 = math.sqrt(5.0)


class GaussianProcess:
    """Posterior of a function, given values at points whose coordinates are of the order of 1.

    The kernel is the sum of the quadratic polynomials, k(x, y) = v (1 + x·y)², and of the Matérn kernel with
    smoothness 5/2 and one length per variable; C. E. Rasmussen and C. K. I. Williams, *Gaussian Processes for Machine
    Learning*, 2006, sections 4.2 and 5.4. Attribute `theta`, shape (d + 3,), has the logarithms of the lengths, of the
    variances of Matérn kernel and polynomials, and of the noise, which maximise the posterior density.
    """

    def __init__(self, dimension: int) -> None:
        self.d = dimension
        rows = np.array([_LENGTH] * dimension + list(_OTHERS))
        self.limits, self.prior, self.deviation = rows[:, :2], rows[:, 2], rows[:, 3]
        self.theta: Floats = self.prior.copy()

    def condition(self, x: Floats, y: Floats) -> None:
        """Compute the posterior for points of shape (n, d) and their values, with the present parameters."""
        self.x = x
        matern, _, inner = self._terms(x)
        s, v, noise = np.exp(self.theta[self.d :])
        self._factor = _cholesky(s * matern + v * inner**2, noise)
        self._weights: Floats = cho_solve(self._factor, y)

    def fit(self, x: Floats, y: Floats, iterations: int) -> None:
        """Improve the parameters by L-BFGS-B, then compute the posterior."""
        from scipy.optimize import minimize

        result = minimize(
            self._loss(x, y),
            np.clip(self.theta, *self.limits.T),
            jac=True,
            method="L-BFGS-B",
            bounds=self.limits,
            options={"maxiter": iterations, "maxfun": 2 * iterations},
        )
        self.theta = result.x
        self.condition(x, y)

    def predict(self, points: Floats) -> tuple[Floats, Floats]:
        """Return the mean and the standard deviation at points of shape (m, d)."""
        s, v, _ = np.exp(self.theta[self.d :])
        matern, _, inner = self._terms(points)
        cross = s * matern + v * inner**2
        half, _ = lapack.dtrtrs(self._factor[0], cross.T, lower=1)
        variance = s + v * (1.0 + (points**2).sum(axis=1)) ** 2 - (half**2).sum(axis=0)
        return cross @ self._weights, np.sqrt(np.maximum(variance, 1e-18))

    def lower(self, point: Floats, kappa: float) -> tuple[float, Floats]:
        """Return mean - kappa standard deviations at one point, shape (d,), and the gradient."""
        s, v, _ = np.exp(self.theta[self.d :])
        (matern,), (steep,), (inner,) = self._terms(point[None])
        cross = s * matern + v * inner**2
        slopes = (2.0 * v * inner)[:, None] * self.x
        slopes -= (s * steep)[:, None] * (point - self.x) / np.exp(2.0 * self.theta[: self.d])
        solved, own = cho_solve(self._factor, cross), 1.0 + point @ point
        deviation = math.sqrt(max(s + v * own**2 - cross @ solved, 1e-18))
        gradient = slopes.T @ (self._weights + kappa / deviation * solved)
        gradient -= kappa / deviation * 2.0 * v * own * point
        return float(cross @ self._weights) - kappa * deviation, gradient

    def _terms(self, points: Floats) -> tuple[Floats, Floats, Floats]:
        """Return Matérn kernel, its slope per squared distance, and 1 + x·y, shape (m, n), without variances."""
        lengths = np.exp(self.theta[: self.d])
        far = _SQRT5 * cdist(points / lengths, self.x / lengths)
        decay = np.exp(-far)
        steep = 5.0 / 3.0 * (1.0 + far) * decay
        return (1.0 + far + far**2 / 3.0) * decay, steep, 1.0 + points @ self.x.T

    def _loss(self, x: Floats, y: Floats) -> Callable[[Floats], tuple[float, Floats]]:
        """Return the negative logarithm of the posterior density of the parameters, with its gradient."""
        self.x = x

        def loss(theta: Floats) -> tuple[float, Floats]:
            self.theta = theta
            s, v, noise = np.exp(theta[self.d :])
            matern, steep, inner = self._terms(x)
            factor = _cholesky(s * matern + v * inner**2, noise)
            weights = cho_solve(factor, y)
            inverse, _ = lapack.dpotri(factor[0], lower=1)
            slope = np.tril(inverse) + np.tril(inverse, -1).T - np.outer(weights, weights)
            scaled, steep = x / np.exp(theta[: self.d]), s * slope * steep
            away = (theta - self.prior) / self.deviation
            gradient = away / self.deviation
            gradient[: self.d] += steep.sum(axis=1) @ scaled**2 - (scaled * (steep @ scaled)).sum(0)
            variances = s * (slope * matern).sum(), v * (slope * inner**2).sum()
            gradient[self.d :] += 0.5 * np.array([*variances, noise * np.trace(slope)])
            value = 0.5 * y @ weights + np.log(np.diagonal(factor[0])).sum() + 0.5 * away @ away
            return float(value), gradient

        return loss


def _cholesky(matrix: Floats, noise: float) -> tuple[Floats, bool]:
    """Return the lower Cholesky factor of the matrix plus noise, increased until the factor exists."""
    noise = max(noise, 1e-13 * float(matrix.diagonal().mean()))
    while True:
        try:
            factor: tuple[Floats, bool] = cho_factor(
                matrix + noise * np.eye(len(matrix)), lower=True
            )
            return factor
        except np.linalg.LinAlgError:
            noise *= 10.0
